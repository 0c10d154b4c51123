"""The routes of the service; its OpenAPI document is made from them."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from typing import Annotated, Any, BinaryIO, NamedTuple

from fastapi import APIRouter, FastAPI, Query, Request, WebSocket
from fastapi import Path as InPath
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from starlette.exceptions import HTTPException

from fringeworks import _core
from fringeworks.service.clouds import MEDIA, SUFFIXES, cloud_file, made_cloud
from fringeworks.service.desk import Desk, Ending, NoSuchJob, QueueFull, is_open
from fringeworks.service.events import Hub
from fringeworks.service.metrics import CONTENT_TYPE
from fringeworks.service.models import (
    API_VERSION,
    NUMBER,
    Event,
    Findings,
    Format,
    FrameName,
    Health,
    JobInfo,
    JobList,
    MeasureRequest,
    Problem,
    RigInfo,
    ScanRequest,
    State,
    Status,
    VerdictInfo,
)
from fringeworks.service.refusals import plain_words, wrong_field
from fringeworks.types import FileProblem, InputError

CHUNK_BYTES = 1 << 22
"""Bytes that are read and sent at a time: reading 4 MiB takes about a millisecond, and a client
that reads slowly holds no more in memory."""
MOST_WAIT_S = 60.0
"""Longest time that a request waits for a job, s: proxies end quiet connections after a minute."""
MOST_MADE = 8
"""Clouds that wait to be written in another format; more requests are refused, because each of them
takes the memory of a cloud."""
RETRY_S = 2
"""Time after which a refused client asks again, s: about that of a scan."""

Number = Annotated[
    str,
    InPath(pattern=NUMBER, description="Of a job, or `last` for the last result."),
]
WaitS = Annotated[
    float,
    Query(ge=0.0, le=MOST_WAIT_S, description="Wait so long for the job to end, s."),
]
PROBLEMS: dict[int | str, dict[str, Any]] = {
    401: {"model": Problem, "description": "The token is missing or wrong."},
    403: {"model": Problem, "description": "Another page asked."},
    413: {"model": Problem, "description": "The body is too large."},
    421: {"model": Problem, "description": "The host name is not served."},
    422: {"model": Problem, "description": "The request cannot be done, and why."},
    503: {"model": Problem, "description": "Too much waits, or the service ends."},
}
"""Refusals that every route may give."""
NOT_THERE: dict[int | str, dict[str, Any]] = {
    404: {"model": Problem, "description": "There is no such job, or it has no such result."},
    409: {"model": Problem, "description": "The job has not ended, or has no result, and why."},
}
BINARY: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The file. `depth` is two maps of rows × columns, little-endian float32: "
        "depth along the camera's axis, then its σ, mm; NaN where nothing was measured.",
        "content": {
            kind: {"schema": {"type": "string", "format": "binary"}}
            for kind in sorted(set(MEDIA.values()))
        },
        "headers": {
            name: {"schema": {"type": "integer"}, "description": told}
            for name, told in {
                "X-Rows": "Rows of the camera's frame.",
                "X-Columns": "Columns of the camera's frame.",
                "X-Job": "Number of the job.",
            }.items()
        },
    }
}


class Parts(NamedTuple):
    """What the routes use."""

    desk: Desk
    hub: Hub
    maker: ThreadPoolExecutor
    """Writes clouds in other formats, one at a time."""


def service_app(desk: Desk) -> FastAPI:
    """Return the application of a service, without its guard."""
    parts = Parts(desk, Hub(desk), ThreadPoolExecutor(1, "clouds"))

    @asynccontextmanager
    async def running(_: FastAPI) -> AsyncIterator[None]:
        parts.hub.start()
        desk.start()
        yield
        await run_in_threadpool(desk.close)
        parts.maker.shutdown(wait=False, cancel_futures=True)

    app = FastAPI(
        title="fringeworks service",
        version=API_VERSION,
        summary="A headless 3-D scanner.",
        description="Points with a standard deviation, one scan at a time. The web socket "
        "`/v1/events` sends an `Event` for every job that is accepted, goes on or ends.",
        docs_url=None,
        redoc_url=None,
        lifespan=running,
        separate_input_output_schemas=False,
    )
    _add_problems(app, desk)
    app.include_router(_about(parts), responses=PROBLEMS)
    app.include_router(_work(parts), responses=PROBLEMS)
    app.include_router(_results(parts), responses=PROBLEMS | NOT_THERE)
    app.add_api_websocket_route("/v1/events", _events(parts.hub))
    _describe(app)
    return app


def _events(hub: Hub) -> Callable[[WebSocket], Any]:
    async def events(socket: WebSocket) -> None:
        await hub.serve(socket)

    return events


def _describe(app: FastAPI) -> None:
    """Add the type of events, which OpenAPI has no place for, to the document."""
    usual = app.openapi

    def described() -> dict[str, Any]:
        document = usual()
        made = Event.model_json_schema(ref_template="#/components/schemas/{model}")
        made.pop("$defs", None)
        document["components"]["schemas"].setdefault("Event", made)
        document["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        document["security"] = [{"token": []}]
        return document

    app.openapi = described  # type: ignore[method-assign]


def _add_problems(app: FastAPI, desk: Desk) -> None:
    """Turn what goes wrong into a sentence."""

    def said(status: int, sentence: str) -> JSONResponse:
        desk.metrics.refused(status)
        headers = {"retry-after": str(RETRY_S)} if status == 503 else {}
        return JSONResponse({"problem": sentence}, status, headers)

    async def of_request(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return said(422, wrong_field(error.errors()[0], request.headers.get("content-type")))

    async def of_input(_: Request, error: Exception) -> Response:
        kinds = {QueueFull: 503, Ending: 503, NoSuchJob: 404, FileProblem: 503}
        status = next((code for kind, code in kinds.items() if isinstance(error, kind)), 422)
        return said(status, str(error))

    async def of_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        return said(error.status_code, plain_words(error.detail, request.method, request.url.path))

    app.add_exception_handler(RequestValidationError, of_request)
    app.add_exception_handler(InputError, of_input)
    app.add_exception_handler(HTTPException, of_http)


def _about(parts: Parts) -> APIRouter:
    """Routes that say how the service is."""
    desk, router = parts.desk, APIRouter(tags=["about"])

    @router.get("/health", summary="Whether the service can take work; needs no token.")
    async def health(answer: Response) -> Health:
        ok = not desk.ending
        answer.status_code = 200 if ok else 503
        return Health(ok=ok, words="ready" if ok else "the service ends")

    @router.get(
        "/metrics",
        summary="Counts and times for Prometheus.",
        response_class=Response,
        responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
    )
    async def metrics() -> Response:
        text = desk.metrics.text(
            waiting=len(desk.waiting),
            limit=desk.limit,
            busy=desk.running is not None,
            uptime_s=time.monotonic() - desk.started_s,
            version=_core.version,
        )
        return Response(text, media_type=CONTENT_TYPE)

    @router.get("/v1/status", summary="What the scanner is doing.")
    async def status() -> Status:
        return _status(desk)

    return router


def _status(desk: Desk) -> Status:
    rig, running = desk.rig, desk.running
    return Status(
        version=_core.version,
        api=API_VERSION,
        state="ending" if desk.ending else "idle" if running is None else "busy",
        running=running,
        waiting=desk.waiting,
        queue_limit=desk.limit,
        last=desk.last,
        uptime_s=time.monotonic() - desk.started_s,
        worker_restarts=desk.metrics.restarts,
        projector=desk.scanner.projector or "of the set-up",
        camera=desk.scanner.camera or "of the set-up",
        recipes=desk.store.recipes(),
        rig=RigInfo(
            camera_px=rig.camera.shape[::-1],
            projector_px=rig.projector.shape[::-1],
            robot=None if rig.robot is None else rig.robot.mount,
        ),
    )


def _work(parts: Parts) -> APIRouter:
    """Routes that begin and end jobs."""
    desk, router = parts.desk, APIRouter(prefix="/v1", tags=["work"])

    @router.post("/scans", status_code=202, summary="Scan: take frames and measure points.")
    async def scan(wanted: ScanRequest) -> JobInfo:
        return await run_in_threadpool(desk.accept, wanted)

    @router.post("/measurements", status_code=202, summary="Measure kept frames again.")
    async def measure(wanted: MeasureRequest) -> JobInfo:
        return await run_in_threadpool(desk.accept, wanted)

    @router.get("/jobs", summary="Jobs, the newest first.")
    async def jobs(
        state: Annotated[State | None, Query()] = None,
        limit: Annotated[int, Query(ge=1, le=1000)] = 50,
    ) -> JobList:
        return JobList(jobs=desk.jobs(state, limit))

    @router.get("/jobs/{number}", summary="One job.", responses=NOT_THERE)
    async def job(number: Number, wait_s: WaitS = 0.0) -> JobInfo:
        return await _ended(parts, _number(desk, number), wait_s)

    @router.delete("/jobs/{number}", summary="Cancel a job.", responses=NOT_THERE)
    async def cancel(number: Number) -> JobInfo:
        return await run_in_threadpool(desk.cancel, _number(desk, number))

    return router


def _results(parts: Parts) -> APIRouter:
    """Routes that hand out results."""
    desk, router = parts.desk, APIRouter(prefix="/v1/jobs/{number}", tags=["results"])

    @router.get(
        "/cloud", summary="The points, as a file.", response_class=Response, responses=BINARY
    )
    async def cloud(
        number: Number,
        form: Annotated[Format, Query(alias="format")] = "npz",
        frame: Annotated[FrameName | None, Query(description="By default the scan's.")] = None,
        wait_s: WaitS = 0.0,
    ) -> Response:
        asked = time.monotonic()
        job = _done(await _ended(parts, _number(desk, number), wait_s))
        assert job.result is not None
        chosen: FrameName = frame or ("camera" if form == "depth" else job.result.frame)
        opened = await _made(parts, job, form, chosen)
        return _file(parts, job, opened, form, asked)

    @router.get("/findings", summary="What was found in frames and points.")
    async def findings(number: Number, wait_s: WaitS = 0.0) -> Findings:
        job = _done(await _ended(parts, _number(desk, number), wait_s))
        assert job.result is not None
        return Findings(number=job.number, findings=job.result.findings)

    @router.get("/verdict", summary="What the recipe says of the part.")
    async def verdict(number: Number, wait_s: WaitS = 0.0) -> VerdictInfo:
        job = _done(await _ended(parts, _number(desk, number), wait_s))
        result = job.result
        if result is None or result.verdict is None or result.recipe is None:
            raise HTTPException(
                404, f"job {job.number}: expected a verdict, got none: the scan named no recipe"
            )
        return VerdictInfo(
            number=job.number, recipe=result.recipe, verdict=result.verdict, checks=result.checks
        )

    return router


def _number(desk: Desk, given: str) -> int:
    if given != "last":
        return int(given)
    if desk.last is None:
        raise HTTPException(404, "there is no result yet")
    return desk.last


async def _ended(parts: Parts, number: int, wait_s: float) -> JobInfo:
    """A job, when it has ended or the time is over."""
    until = time.monotonic() + wait_s
    async with parts.hub.listening() as listener:
        while is_open(job := parts.desk.seen(number)) and (left := until - time.monotonic()) > 0:
            try:
                async with asyncio.timeout(left):
                    await listener.events.get()
            except TimeoutError:
                pass
    return job


def _done(job: JobInfo) -> JobInfo:
    """A job with a result; others are refused with the reason."""
    if job.state == "done":
        return job
    why = f": {job.problem}" if job.problem else ""
    raise HTTPException(409, f"job {job.number} is {job.state}{why}")


async def _made(parts: Parts, job: JobInfo, form: Format, frame: FrameName) -> BinaryIO:
    """The file of a cloud, open; written first where it is not there."""
    store, number = parts.desk.store, job.number
    # A new result is handed out while it becomes whole.
    for folder in (store.half(number), store.folder(number)):
        with suppress(OSError):
            return cloud_file(folder, form, frame).open("rb")
    if form == "depth" and frame == "base":
        raise HTTPException(422, "depth: expected frame=camera: depth is along the camera's axis")
    if parts.maker._work_queue.qsize() >= MOST_MADE:
        raise HTTPException(503, f"more than {MOST_MADE} clouds wait to be written; ask again")
    loop = asyncio.get_running_loop()
    given = (store, number, form, frame, parts.desk.rig, job.request)
    path = await loop.run_in_executor(parts.maker, made_cloud, *given)
    try:
        return path.open("rb")
    except OSError:
        raise HTTPException(404, f"the files of job {number} were deleted") from None


def _file(parts: Parts, job: JobInfo, opened: BinaryIO, form: Format, asked: float) -> Response:
    """A file in large parts; how long the first client waited for the last byte is counted."""
    measured = parts.desk.measured.get(job.number)

    async def content() -> AsyncIterator[bytes]:
        with opened:
            # A new result is in the system's memory: the first part takes a millisecond.
            part = opened.read(CHUNK_BYTES)
            while part:
                yield part
                if len(part) < CHUNK_BYTES:
                    break
                part = await run_in_threadpool(opened.read, CHUNK_BYTES)
        if measured is not None and asked < measured:
            parts.desk.metrics.delivered(time.monotonic() - measured)

    assert job.result is not None
    headers = {
        "content-length": str(os.fstat(opened.fileno()).st_size),
        "content-disposition": f'attachment; filename="{job.number:06d}{SUFFIXES[form]}"',
        "cache-control": "no-store",
        "x-rows": str(job.result.rows),
        "x-columns": str(job.result.columns),
        "x-job": str(job.number),
    }
    return StreamingResponse(content(), media_type=MEDIA[form], headers=headers)
