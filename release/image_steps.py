"""Run the steps of the image in an empty environment, where no container engine is at hand.

``python release/image_steps.py --wheel dist/*.whl`` installs the wheel as the Dockerfile does,
makes a virtual scanner in place of ``/data``, runs the command of the image, and asks for its
health and a scan.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).parent.parent
TOKEN = "a-token-of-the-image"
READY_S = 90.0
"""Longest time until the service answers, s."""
MAKE_RIG = (
    "import sys, fringeworks as fw; fw.files.write_rig(sys.argv[1], fw.devices.virtual_rig())"
)


def steps() -> tuple[str, list[str], list[str]]:
    """The installation, the command and the health check of the image's last stage."""
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    last = text[text.rindex("\nFROM ") :]
    install = re.search(r"^RUN (pip install .*? && pip check)\s+&&", last, re.MULTILINE)
    health = re.search(r"^HEALTHCHECK .*?CMD (\[.*\])$", last, re.MULTILINE)
    begin = re.search(r"^ENTRYPOINT (\[.*\])$", last, re.MULTILINE)
    given = re.search(r"^CMD (\[.*\])$", last, re.MULTILINE)
    assert install is not None
    assert health is not None
    assert begin is not None
    assert given is not None
    return install[1], json.loads(begin[1]) + json.loads(given[1]), json.loads(health[1])


def run(wheel: Path, folder: Path, port: int) -> int:
    """Run the steps; number of the points of a scan."""
    install, command, health = steps()
    data, environment = folder / "data", folder / "venv"
    data.mkdir()
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    alone = {
        "PATH": f"{environment / 'bin'}:/usr/bin:/bin",
        "HOME": str(folder),
        "FRINGEWORKS_TOKEN": TOKEN,
    }
    kept = ("PIP_INDEX_URL", "PIP_CERT", "SSL_CERT_FILE", "HTTPS_PROXY", "https_proxy")
    alone |= {name: os.environ[name] for name in kept if name in os.environ}
    install = install.replace("/tmp/wheels/*.whl", str(wheel))
    hashed = ROOT / "requirements" / "hashed-service.txt"
    install = install.replace("/tmp/hashed.txt", str(hashed))
    subprocess.run(["/bin/sh", "-c", install], check=True, env=alone)
    python = str(environment / "bin" / "python")
    subprocess.run([python, "-c", MAKE_RIG, str(data / "rig.toml")], check=True, env=alone)
    words = "--projector virtual --camera virtual:plane --out"
    subprocess.run(
        ["fringeworks", "setup", *words.split(), str(data / "setup.toml")], check=True, env=alone
    )

    def placed(words: list[str]) -> list[str]:
        return [word.replace("/data", str(data)).replace("8138", str(port)) for word in words]

    with subprocess.Popen(placed(command), env=alone) as service:
        try:
            until = time.monotonic() + READY_S
            while subprocess.run(
                placed(health), env=alone, stderr=subprocess.DEVNULL, check=False
            ).returncode:
                assert time.monotonic() < until, "the service did not answer"
                time.sleep(0.5)
            return scanned(port)
        finally:
            service.terminate()


def scanned(port: int) -> int:
    """Scan once; the number of points."""
    base = f"http://127.0.0.1:{port}/v1"
    headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}

    def ask(path: str, body: bytes | None = None) -> dict[str, object]:
        with urllib.request.urlopen(urllib.request.Request(base + path, body, headers)) as answer:
            return dict(json.loads(answer.read()))

    number = ask("/scans", b"{}")["number"]
    job = ask(f"/jobs/{number}?wait_s=60")
    assert job["state"] == "done", job
    result = job["result"]
    assert isinstance(result, dict)
    return int(result["points"])


def main() -> None:
    """Run the steps and say what came of them."""
    options = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    options.add_argument("--wheel", type=Path, required=True)
    options.add_argument("--port", type=int, default=8155)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        points = run(given.wheel.resolve(), Path(folder), given.port)
    print(f"the steps of the image ran: healthy, and a scan of {points} points")


if __name__ == "__main__":
    main()
