"""The service: every route by its schema, its queue, its files, and those who may ask."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import numpy as np
import pytest
import uvicorn
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import fringeworks as fw
from fringeworks.files.setup import StoredSetup
from fringeworks.service.models import API_VERSION
from fringeworks.serving.guard import MOST_BYTES
from tests.json_schema import wrong
from tests.service_running import HEADERS, RECIPE, TOKEN, Running, mounted, quick_rig

pytestmark = pytest.mark.system
DOCUMENT = Path(__file__).parent.parent / "docs" / "service-openapi.json"


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("service")
    running = Running(folder, rig=mounted(quick_rig()))
    (folder / "srv" / "recipes" / "part.toml").write_text(RECIPE)
    yield running
    running.close()


@pytest.fixture(scope="module")
def kept(served):
    """A scan with everything: kept frames, a verdict, points in the robot's base."""
    job = served.scan(name="part", recipe="part", frame="base", keep_frames=True)
    found = served.ended(job)
    assert found["state"] == "done", found
    return found


REQUESTS = [
    ("get", "/health", {}, None, 200),
    ("get", "/metrics", {}, None, 200),
    ("get", "/v1/status", {}, None, 200),
    ("post", "/v1/scans", {}, {}, 202),
    ("post", "/v1/scans", {}, {"frame": "base", "average": 2, "formats": ["depth", "ply"]}, 202),
    ("post", "/v1/scans", {}, {"average": 0}, 422),
    ("post", "/v1/scans", {}, {"unknown": 1}, 422),
    ("post", "/v1/scans", {}, {"recipe": "../part"}, 422),
    ("post", "/v1/scans", {}, {"recipe": "other"}, 422),
    ("post", "/v1/scans", {}, {"robot_pose": "1,2,3,4,5,6"}, 422),
    ("post", "/v1/measurements", {}, {"scan": "kept"}, 202),
    ("post", "/v1/measurements", {}, {"scan": 99}, 422),
    ("get", "/v1/jobs", {}, None, 200),
    ("get", "/v1/jobs", {"state": "done", "limit": 1}, None, 200),
    ("get", "/v1/jobs", {"state": "bad"}, None, 422),
    ("get", "/v1/jobs/{number}", {}, None, 200),
    ("get", "/v1/jobs/{number}", {"wait_s": 1000}, None, 422),
    ("delete", "/v1/jobs/{number}", {}, None, 200),
    ("get", "/v1/jobs/{number}/cloud", {}, None, 200),
    ("get", "/v1/jobs/{number}/cloud", {"format": "depth"}, None, 200),
    ("get", "/v1/jobs/{number}/cloud", {"format": "ply", "frame": "camera"}, None, 200),
    ("get", "/v1/jobs/{number}/cloud", {"format": "depth", "frame": "base"}, None, 422),
    ("get", "/v1/jobs/{number}/cloud", {"format": "bad"}, None, 422),
    ("get", "/v1/jobs/{number}/findings", {}, None, 200),
    ("get", "/v1/jobs/{number}/verdict", {}, None, 200),
]


def agrees(document, method, path, answer):
    """Assert that an answer is one that the document tells of."""
    told = document["paths"][path][method]["responses"]
    assert str(answer.status_code) in told, answer.text
    kind = answer.headers["content-type"].partition(";")[0]
    content = told[str(answer.status_code)]["content"]
    assert kind in content, (kind, list(content))
    if kind == "application/json":
        assert wrong(answer.json(), content[kind]["schema"], document) == []


def test_every_route_answers_as_its_schema_says(served, kept):
    document = served.web.get("/openapi.json").json()
    tried = set()
    for method, path, query, wanted, status in REQUESTS:
        place = path.format(number=kept["number"])
        body = {"scan": kept["number"]} if wanted == {"scan": "kept"} else wanted
        answer = served.web.request(method, place, params=query, json=body)
        assert answer.status_code == status, (path, query, body, answer.text[:300])
        agrees(document, method, path, answer)
        tried.add((method, path))
        if status == 202:
            served.ended(answer.json())
        # Without the token, each says so as the document does; health needs none.
        bare = httpx.request(method, served.address + place, params=query, json=body)
        if path != "/health":
            assert bare.status_code in (401, 403)
            agrees(document, method, path, bare)
        if "{number}" in path:
            missing = served.web.request(method, path.format(number=4444))
            assert missing.status_code == 404, missing.text
            agrees(document, method, path, missing)
    assert tried == {(m, p) for p, methods in document["paths"].items() for m in methods}


def test_the_document_is_the_one_that_is_published(served):
    """Whoever changes the interface changes its version; docs/make_service_openapi.py writes it."""
    document = served.web.get("/openapi.json").json()
    assert document["info"]["version"] == API_VERSION
    assert document == json.loads(DOCUMENT.read_text("utf-8"))


def test_the_files_of_a_scan_are_its_points(served, kept):
    number = kept["number"]
    cloud = served.web.get(f"/v1/jobs/{number}/cloud", params={"frame": "camera"})
    assert cloud.headers["x-job"] == str(number)
    arrays = np.load(io.BytesIO(cloud.content))
    rows, columns = int(cloud.headers["x-rows"]), int(cloud.headers["x-columns"])
    assert arrays["xyz_mm"].shape == (rows, columns, 3) == (*quick_rig().camera.shape, 3)
    # As the library measures the same frames, within the recipe's area.
    frames = served.folder / "srv" / "captures" / f"{number:06d}"
    points = fw.measure(frames, quick_rig()).points
    ok = arrays["reason"] == 0
    assert 100 < ok.sum() == kept["result"]["points"]
    assert np.array_equal(arrays["xyz_mm"][ok], points.xyz_mm[ok])
    assert np.array_equal(arrays["sigma_mm"][ok], points.sigma_mm[ok])
    raw = served.web.get(f"/v1/jobs/{number}/cloud", params={"format": "depth"}).content
    depth, sigma = np.frombuffer(raw, "<f4").reshape(2, rows, columns)
    assert np.array_equal(depth, arrays["xyz_mm"][..., 2], equal_nan=True)
    assert np.array_equal(sigma, arrays["sigma_mm"], equal_nan=True)
    # In the base, moved by the robot's transform, with its error in σ.
    moved = np.load(io.BytesIO(served.web.get(f"/v1/jobs/{number}/cloud").content))
    shift = moved["xyz_mm"][ok] - arrays["xyz_mm"][ok]
    assert np.allclose(shift, [100.0, 200.0, 300.0], atol=1e-3)
    assert (moved["sigma_mm"][ok] > arrays["sigma_mm"][ok]).all()
    ply = served.web.get(f"/v1/jobs/{number}/cloud", params={"format": "ply"}).content
    assert ply.startswith(b"ply") and b"base" in ply[:2000]  # noqa: PT018, one file


def test_a_verdict_and_a_second_recipe(served, kept):
    verdict = served.web.get(f"/v1/jobs/{kept['number']}/verdict").json()
    assert verdict["verdict"] == "fail"
    (check,) = verdict["checks"]
    assert check["value"] > 0.001
    assert "above the largest allowed" in check["why"]
    (served.folder / "srv" / "recipes" / "wide.toml").write_text(RECIPE.replace("0.001", "90.0"))
    answer = served.web.post("/v1/measurements", json={"scan": kept["number"], "recipe": "wide"})
    again = served.ended(answer.json())
    assert again["result"]["verdict"] == "pass"
    assert again["result"]["points"] == kept["result"]["points"]
    plain = served.ended(served.scan())
    assert served.web.get(f"/v1/jobs/{plain['number']}/verdict").status_code == 404


def test_a_key_is_one_job(served):
    first = served.scan(key="part-17", name="a")
    assert served.scan(key="part-17", name="a")["number"] == first["number"]
    other = served.web.post("/v1/scans", json={"key": "part-17", "name": "b"})
    assert other.status_code == 422
    assert "another request" in other.json()["problem"]
    served.ended(first)
    assert served.scan(key="part-17", name="a")["number"] == first["number"]


@pytest.mark.usefixtures("kept")
def test_the_metrics_are_what_prometheus_reads(served):
    text = served.web.get("/metrics").text
    line = re.compile(r'([a-z_]+)(\{[a-z_]+="[^"]*"(?:,[a-z_]+="[^"]*")*\})? (-?[0-9.e+-]+)')
    kinds, values = {}, {}
    for one in text.splitlines():
        if one.startswith("# TYPE "):
            _, _, name, kind = one.split()
            kinds[name] = kind
        elif not one.startswith("# HELP "):
            found = line.fullmatch(one)
            assert found, one
            values[found[1] + (found[2] or "")] = float(found[3])
            base = re.sub(r"_(bucket|sum|count)$", "", found[1])
            assert base in kinds or found[1] in kinds, one
    assert kinds["fringeworks_stage_seconds"] == "histogram"
    done = sum(v for k, v in values.items() if 'state="done"' in k)
    assert values['fringeworks_stage_seconds_count{stage="computing"}'] == done >= 1
    assert values['fringeworks_stage_seconds_bucket{stage="computing",le="+Inf"}'] == done


def test_the_delivery_to_a_client_who_waits_is_timed(served):
    def delivered():
        text = served.web.get("/metrics").text
        return int(re.search(r'_count{stage="delivering"} (\d+)', text)[1])

    before = delivered()
    job = served.scan()
    place = f"/v1/jobs/{job['number']}/cloud"
    assert served.web.get(place, params={"wait_s": 60}).status_code == 200
    assert delivered() == before + 1
    assert served.web.get(place).status_code == 200
    assert delivered() == before + 1  # this one did not wait


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        (HEADERS, 202),
        (HEADERS | {"origin": "own"}, 202),
        (HEADERS | {"origin": "https://evil.example"}, 403),
        (HEADERS | {"host": "evil.example"}, 421),
        (HEADERS | {"sec-fetch-site": "cross-site"}, 403),
        ({}, 403),
        ({"origin": "own"}, 401),
        ({"authorization": "Bearer wrong"}, 403),
        ({"authorization": f"Basic {TOKEN}"}, 403),
        ({"authorization": "Bearer"}, 403),
        ({"authorization": "Bearer wrong", "origin": "own"}, 401),
    ],
)
def test_who_may_scan(served, headers, status):
    given = {k: served.address if v == "own" else v for k, v in headers.items()}
    answer = httpx.post(f"{served.address}/v1/scans", json={}, headers=given)
    assert answer.status_code == status
    if status == 202:
        served.ended(answer.json())
    else:
        assert answer.json()["problem"]


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        # Every scan of a program that leaves its key empty would get the first one's job.
        ({"key": ""}, "key: expected 1 or more letters, got none"),
        ({"frame": "world"}, "frame: expected 'camera' or 'base', got world"),
        ({"formats": ["npz", "obj"]}, "formats.1: expected 'npz', 'ply' or 'depth', got obj"),
        ({"formats": "npz"}, "formats: expected a list, got npz"),
        ({"hdr": 99}, "hdr: expected 8 or less, got 99"),
        ({"hdr": 1.5}, "hdr: expected a whole number, got 1.5"),
        ({"average": "many"}, "average: expected a whole number, got many"),
        ({"fast": 7}, "fast: expected true or false, got 7"),
        ({"name": 7}, "name: expected text, got 7"),
        ({"name": "n" * 100}, "name: expected 64 letters or fewer, got nnnn"),
        ({"recipe": "../x"}, "recipe: expected letters and digits, with . _ and -"),
        ([1], "request: expected a JSON object, got something else"),
        ({"fast": True}, "fast: expected a set-up with a measured delay, got none"),
        ({"fast": True, "hdr": 3}, "fast cannot be combined with hdr"),
        ({"robot_pose": "1,2,3"}, "robot pose: expected 6, 7, 12 or 16 numbers for a pose, got 3"),
        ({"robot_pose": "x=1 y=2"}, "robot pose: expected"),
    ],
)
def test_a_wrong_request_is_the_clients_fault(served, wanted, said):
    answer = served.web.post("/v1/scans", json=wanted)
    assert answer.status_code == 422
    assert answer.json()["problem"].startswith(said)


def test_a_body_without_its_type_is_told_the_header(served):
    answer = served.web.post("/v1/scans", content=b'{"name": "part"}')
    assert answer.status_code == 422
    said = "request: expected the header Content-Type: application/json, got none"
    assert answer.json()["problem"] == said
    answer = served.web.put("/v1/jobs/1")
    assert answer.status_code == 405
    assert answer.json()["problem"].startswith("PUT /v1/jobs/1: there is no such request; GET /op")


def test_a_browser_signs_in_with_the_token(served):
    with httpx.Client(base_url=served.address) as browser:
        assert browser.get("/v1/status").status_code == 401
        assert browser.get("/v1/status", params={"token": TOKEN}).status_code == 200
        assert browser.get("/v1/status").json()["api"] == API_VERSION


def request_text(method, path, *lines):
    head = [f"{method} {path} HTTP/1.1", "Host: 127.0.0.1:PORT", f"Authorization: Bearer {TOKEN}"]
    return "\r\n".join([*head, *lines]) + "\r\n\r\n"


def test_garbage_is_refused_in_words(served):
    garbage = np.random.default_rng(0).bytes(10_000_000)
    answer = served.web.post("/v1/scans", content=garbage)
    assert (answer.status_code, answer.json()["problem"]) == (
        413,
        f"A request has at most {MOST_BYTES:,} bytes.",
    )

    def untold():
        for start in range(0, len(garbage), 100_000):
            yield garbage[start : start + 100_000]

    answer = served.web.post("/v1/scans", content=untold())
    assert answer.status_code == 413
    small = served.web.post("/v1/scans", content=garbage[:100_000])
    assert small.status_code == 422
    assert len(small.text) < 500
    deep = served.web.post("/v1/scans", content=b"[" * 1_000_000)
    assert deep.status_code in (400, 422)
    head = request_text("POST", "/v1/scans").replace("PORT", str(served.port)).encode()
    assert " 400 " in served.raw(garbage[:3000] + b"\r\n\r\n")
    assert " 4" in served.raw(head[:-4] + b"\r\nX: " + b"a" * 200_000 + b"\r\n\r\n")
    assert served.web.get("/health").json()["ok"]


def test_clients_that_vanish_lose_nothing(served):
    """A scan whose client is gone is done; half a body scans nothing; half a download harms nobody."""
    last = served.ended(served.scan())["number"]
    body = b'{"name": "vanished"}'
    head = request_text(
        "POST", "/v1/scans", "Content-Type: application/json", f"Content-Length: {len(body)}"
    )
    head = head.replace("PORT", str(served.port)).encode()
    served.raw(head + body, read=False)
    served.raw(head + body[:5], read=False)
    until = time.monotonic() + 30
    while (found := served.web.get("/v1/jobs").json()["jobs"][0])["number"] != last + 1:
        assert time.monotonic() < until
    assert served.ended(found)["state"] == "done"
    assert found["name"] == "vanished"
    download = request_text("GET", "/v1/jobs/last/cloud").replace("PORT", str(served.port))
    for _ in range(5):
        served.raw(download.encode(), read=False)
    assert served.web.get("/v1/jobs").json()["jobs"][0]["number"] == last + 1
    assert served.web.get("/v1/jobs/last/cloud").status_code == 200


def test_two_scans_at_once_are_done_one_after_the_other(served):
    jobs = []
    threads = [threading.Thread(target=lambda: jobs.append(served.scan())) for _ in range(3)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    ended = sorted((served.ended(job) for job in jobs), key=lambda job: job["number"])
    assert [job["state"] for job in ended] == ["done"] * 3
    assert len({job["number"] for job in ended}) == 3
    assert [job["ended"] for job in ended] == sorted(job["ended"] for job in ended)


def test_a_web_socket_tells_what_happens(served):
    document = served.web.get("/openapi.json").json()
    event = document["components"]["schemas"]["Event"]
    place = served.address.replace("http", "ws") + "/v1/events"
    with pytest.raises(InvalidStatus):
        connect(place)
    with connect(place, additional_headers=HEADERS) as socket:
        assert json.loads(socket.recv(10))["event"] == "hello"
        number = served.scan()["number"]
        seen = []
        while not seen or seen[-1]["event"] != "ended":
            one = json.loads(socket.recv(30))
            assert wrong(one, event, document) == []
            if one["job"]["number"] == number:
                seen.append(one)
        assert [one["event"] for one in seen if one["event"] != "step"] == [
            *("accepted", "running", "ended"),
        ]
        assert seen[-1]["job"]["state"] == "done"


def test_the_worker_may_be_killed(served):
    """Each scan is done in a new process, or failed in words."""
    before = served.web.get("/v1/status").json()["worker_restarts"]
    jobs, killed = [], 0
    for _ in range(3):
        jobs.append(served.scan())
        killed += served.kill_worker()
        jobs.append(served.scan())
    ended = [served.ended(job) for job in jobs]
    assert {job["state"] for job in ended} <= {"done", "failed"}
    assert all(job["problem"] for job in ended if job["state"] == "failed")
    assert sum(job["state"] == "done" for job in ended) >= 5
    status = served.web.get("/v1/status").json()
    assert killed
    assert status["worker_restarts"] >= before
    assert status["state"] == "idle"


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """A service whose scans take seconds."""
    running = Running(tmp_path_factory.mktemp("slow"), "--queue", "2", scene="slow")
    yield running
    running.close()


def test_a_full_queue_is_said_and_jobs_are_cancelled(slow):
    jobs = [slow.scan()]
    until = time.monotonic() + 30
    while slow.web.get("/v1/status").json()["running"] != jobs[0]["number"]:
        assert time.monotonic() < until
    jobs += [slow.scan(), slow.scan()]
    refused = slow.web.post("/v1/scans", json={})
    assert refused.status_code == 503
    assert refused.headers["retry-after"]
    assert "expected fewer than 2 jobs that wait" in refused.json()["problem"]
    assert slow.web.get("/health").json()["ok"]
    early = slow.web.get(f"/v1/jobs/{jobs[2]['number']}/cloud")
    assert early.status_code == 409
    assert "is waiting" in early.json()["problem"]
    for job in reversed(jobs):
        slow.web.delete(f"/v1/jobs/{job['number']}")
    assert [slow.ended(job)["state"] for job in jobs] == ["cancelled"] * 3
    assert slow.ended(slow.scan())["state"] == "done"


def test_a_restart_goes_on_with_the_queue(tmp_path):
    """After a power cut, the scan that ran is named as lost, and those that waited are done."""
    running = Running(tmp_path, scene="slow")
    first, second, third = running.scan(), running.scan(), running.scan(name="third")
    until = time.monotonic() + 30
    while running.web.get(f"/v1/jobs/{first['number']}").json()["step"] < 2:
        assert time.monotonic() < until
    running.kill()
    (tmp_path / "srv" / "queue" / "000009.json").write_text("{")
    (tmp_path / "srv" / "results" / ".fringeworks-000001").mkdir(exist_ok=True)
    running.begin()
    try:
        lost = running.ended(first)
        assert lost["state"] == "lost"
        assert "scan it again" in lost["problem"]
        assert running.ended(9)["state"] == "lost"
        assert [running.ended(job)["state"] for job in (second, third)] == ["done", "done"]
        assert running.ended(third)["name"] == "third"
        assert running.scan()["number"] == 10
        assert not list((tmp_path / "srv" / "results").glob(".fringeworks-*1"))
        other = subprocess.run(
            running.command, capture_output=True, text=True, check=False, timeout=60
        )
        assert (other.returncode, other.stderr.count("\n")) == (2, 1)
        assert "another service uses this folder" in other.stderr
    finally:
        running.close()


def test_an_ordered_end_keeps_the_queue(tmp_path):
    """The scan that runs is done or named, and the one that waits is done after the restart."""
    running = Running(tmp_path, scene="slow")
    first, second = running.scan(), running.scan()
    until = time.monotonic() + 30
    while running.web.get(f"/v1/jobs/{first['number']}").json()["step"] < 2:
        assert time.monotonic() < until
    running.close()
    assert (tmp_path / "srv" / "queue" / "000002.json").is_file()
    running.begin()
    try:
        assert running.ended(first)["state"] in ("done", "lost")
        assert running.ended(second)["state"] == "done"
    finally:
        running.close()


def test_a_camera_that_fails_is_said(tmp_path):
    running = Running(tmp_path, scene="broken")
    try:
        job = running.ended(running.scan())
        assert job["state"] == "failed"
        assert "it was unplugged" in job["problem"]
        cloud = running.web.get(f"/v1/jobs/{job['number']}/cloud")
        assert cloud.status_code == 409
        assert "unplugged" in cloud.json()["problem"]
        base = running.web.post("/v1/scans", json={"frame": "base"})
        assert base.status_code == 422
        assert "where the camera is on the robot" in base.json()["problem"]
    finally:
        running.close()


def test_slow_headers_and_bodies_are_ended(monkeypatch):
    """One process for both limits, which are shortened."""
    from fringeworks.service import protocol
    from fringeworks.serving import guard

    monkeypatch.setattr(protocol, "HEADERS_S", 0.5)
    monkeypatch.setattr(guard, "BODY_S", 0.5)

    async def app(scope, receive, send):
        if scope["type"] == "http":
            while (await receive()).get("more_body"):
                pass
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"in"})

    guarded = guard.Guard(app, token=TOKEN, programs=True)
    config = uvicorn.Config(guarded, port=0, http=protocol.TimedProtocol, lifespan="off")
    server = uvicorn.Server(config)

    async def talk(*parts, pause_s):
        port = server.servers[0].sockets[0].getsockname()[1]
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for part in parts:
            writer.write(part)
            await asyncio.sleep(pause_s)
        answer = await asyncio.wait_for(reader.read(2000), 10)
        writer.close()
        return answer.decode()

    async def all_of_it():
        serving = asyncio.create_task(server.serve())
        while not server.started:
            await asyncio.sleep(0.01)
        head = request_text("POST", "/x", "Content-Length: 20").encode()
        slow_head = await talk(head[:10], head[10:12], head[12:14], pause_s=0.3)
        nothing = await talk(pause_s=0.0)
        slow_body = await talk(head, b"a", b"b", b"c", pause_s=0.25)
        good = await talk(head + b"a" * 20, pause_s=0.0)
        server.should_exit = True
        await serving
        return slow_head, nothing, slow_body, good

    slow_head, nothing, slow_body, good = asyncio.run(all_of_it())
    assert " 408 " in slow_head.splitlines()[0]
    assert "headers" in slow_head
    assert " 408 " in nothing.splitlines()[0]
    assert " 408 " in slow_body.splitlines()[0]
    assert "body of a request must arrive" in slow_body
    assert " 200 " in good.splitlines()[0]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("serve srv --rig none.toml --projector virtual --camera virtual", "none.toml"),
        ("serve srv --rig rig.toml", "expected a projector and a camera, or a set-up"),
        ("serve srv --rig rig.toml --setup none.toml", "none.toml"),
        ("serve srv --rig rig.toml --projector virtual --camera virtual --queue 0", "queue, keep"),
        ("serve a.txt --rig rig.toml --projector virtual --camera virtual", "written to"),
    ],
)
def test_mistakes_are_one_sentence(tmp_path, monkeypatch, capsys, words, said):
    from fringeworks.cli.commands import run

    monkeypatch.chdir(tmp_path)
    fw.files.write_rig("rig.toml", quick_rig())
    Path("a.txt").touch()
    assert run(words.split()) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_missing_package_is_named(tmp_path):
    script = "import sys; sys.modules['uvicorn'] = None; import fringeworks as fw; "
    call = f"fw.run_service({str(tmp_path)!r}, 'rig.toml', projector='a', camera='b')"
    said = subprocess.run(
        [sys.executable, "-c", script + call], capture_output=True, text=True, check=False
    ).stderr
    assert "MissingPackage: service: expected the package uvicorn" in said
    assert "pip install 'fringeworks[service]'" in said


PAGE = (DOCUMENT.parent / "service.md").read_text("utf-8")


@pytest.mark.usefixtures("kept")
def test_the_commands_of_the_page_run(served, tmp_path):
    """Each with the address of this service; jobs of the page are those of its own scan."""
    lines = [line.strip() for line in PAGE.splitlines() if line.startswith("    curl ")]
    assert len(lines) == 5
    number = "1"
    for line in lines:
        words = line.replace("http://127.0.0.1:8138", served.address)
        words = words.replace("/jobs/1", f"/jobs/{number}")
        done = subprocess.run(
            ["/bin/sh", "-c", f"TOKEN={TOKEN}; {words} -w ' %{{http_code}}'"],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=True,
        )
        said, _, status = done.stdout.rpartition(" ")
        assert status in ("200", "202"), done.stdout
        if "scans" in line:
            number = str(json.loads(said)["number"])
    assert (tmp_path / "part.ply").read_bytes().startswith(b"ply")


def test_the_program_of_the_page_runs(served, monkeypatch, capsys):
    (text,) = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    monkeypatch.setenv("FRINGEWORKS_TOKEN", TOKEN)
    exec(compile(text.replace("http://127.0.0.1:8138", served.address), "service.md", "exec"), {})
    assert re.fullmatch(r"\d+ points, median σ 0\.\d+ mm\n", capsys.readouterr().out)


def test_every_route_is_on_the_page():
    for path in json.loads(DOCUMENT.read_text("utf-8"))["paths"]:
        assert path.rpartition("/")[2].replace("{number}", "N") in PAGE, path


@pytest.mark.parametrize("line", [0, 1])
def test_the_service_starts_as_the_page_prints_it(tmp_path, line):
    """Both lines, word for word but for the port; the token is where the page reads it."""
    printed = [text.strip() for text in PAGE.splitlines() if text.startswith("    fringeworks ")]
    assert len(printed) == 2
    rig = fw.devices.virtual_rig()
    plan = fw.simulate.fringe_plan(rig, both=False)
    fw.files.write_rig(tmp_path / "rig.toml", rig)
    fw.files.write_plan(tmp_path / "plan.toml", plan)
    size = rig.projector.width_px, rig.projector.height_px
    known = {"projector": "virtual", "camera": "virtual", "settings": fw.devices.CameraSettings()}
    known |= {"projector_name": "p", "camera_name": "c", "noise": fw.signal.CameraNoise(1.0, 0.0)}
    known |= {"plan": plan, "predicted_sigma_px": 0.05, "size_px": size, "min_period_px": 8.0}
    known |= {"modulation": 60.0, "gamma": 1.0, "contrast": 20.0}
    fw.files.write_setup(tmp_path / "setup.toml", StoredSetup(**known))
    words = [*printed[line].split()[1:], "--port", "0"]
    process = subprocess.Popen(
        [sys.executable, "-m", "fringeworks", *words],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
        env={k: v for k, v in os.environ.items() if k != "FRINGEWORKS_TOKEN"}
        | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    try:
        address = re.search(r"http://\S+?(?=/$)", process.stdout.readline().strip())[0]
        token = (tmp_path / "scanner" / "token").read_text().strip()
        headers = {"authorization": f"Bearer {token}"}
        with httpx.Client(base_url=address, headers=headers, timeout=90) as web:
            for _ in range(600):
                with contextlib.suppress(httpx.TransportError):
                    if web.get("/health").status_code == 200:
                        break
                time.sleep(0.1)
            job = web.post("/v1/scans", json={"name": "part 17"}).json()
            cloud = web.get(f"/v1/jobs/{job['number']}/cloud?format=ply&wait_s=60")
            assert cloud.status_code == 200, cloud.text
            assert cloud.content.startswith(b"ply")
    finally:
        process.terminate()
        process.wait(30)
        process.stdout.close()
