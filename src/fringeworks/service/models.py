"""What the service takes and answers, as typed models: its OpenAPI document is made from them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

API_VERSION = "1.0.0"
"""Version of the interface. The first number is part of every address (``/v1``) and changes when a
program that uses the interface has to change."""
MOST_LETTERS = 64
"""Largest number of letters of names and keys that programs choose."""
MOST_POSE_LETTERS = 400
"""Largest number of letters of a robot's pose: sixteen numbers of a matrix."""

Kind = Literal["scan", "measure"]
State = Literal["waiting", "running", "done", "failed", "cancelled", "lost"]
OPEN_STATES = ("waiting", "running")
"""States of jobs that have not ended."""
Format = Literal["npz", "ply", "depth"]
FrameName = Literal["camera", "base"]
WORD = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
"""Names of recipes: files in one folder."""
NUMBER = "^(last|[0-9]{1,9})$"
"""Number of a job in an address."""
Word = Annotated[str, Field(pattern=WORD, max_length=MOST_LETTERS)]


class _Given(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Wanted(_Given):
    """What scans and measurements have in common."""

    name: str | None = Field(
        None, max_length=MOST_LETTERS, description="Any name, such as that of the part."
    )
    key: str | None = Field(
        None,
        min_length=1,
        max_length=MOST_LETTERS,
        description="A request with the key of an earlier one gets that one's job: a program that "
        "missed the answer sends its request again.",
    )
    recipe: Word | None = Field(None, description="Recipe that judges the part, without `.toml`.")
    frame: FrameName = Field("camera", description="Coordinates of the points.")
    robot_pose: str | None = Field(
        None,
        max_length=MOST_POSE_LETTERS,
        description="Pose of the flange at these frames, as the robot writes it, for a camera in "
        "its hand.",
    )
    poses_as: str = Field(
        "", max_length=MOST_LETTERS, description="How the robot writes its poses, as `ur`."
    )
    formats: list[Format] = Field(
        ["npz"],
        max_length=3,
        description="Files that are written with the result; others are made when asked for.",
    )


class ScanRequest(_Wanted):
    """A scan: frames of the plan, and their points."""

    auto_exposure: bool = Field(False, description="Choose exposure and gain first.")
    hdr: int = Field(1, ge=1, le=8, description="Number of exposures that are fused.")
    average: int = Field(1, ge=1, le=255, description="Frames averaged for each picture.")
    fast: bool = Field(False, description="Rely on the delay that the set-up has measured.")
    keep_frames: bool = Field(False, description="Keep the frames, to measure them again.")


class MeasureRequest(_Wanted):
    """Measure the kept frames of a scan again, such as by another recipe."""

    scan: int = Field(ge=1, description="Number of a scan whose frames were kept.")


class FindingInfo(BaseModel):
    """Something that was seen in the frames or the points."""

    kind: str
    severity: Literal["note", "warning", "error"]
    text: str
    seen: str
    causes: list[str]
    advice: str
    figures: dict[str, float | None]


class CheckInfo(BaseModel):
    """A quantity of the part, and whether it keeps to its tolerance."""

    name: str
    quantity: str
    value: float | None
    sigma: float | None
    unit: str
    low: float | None
    high: float | None
    verdict: Literal["pass", "fail", "undecided"]
    why: str


class Timing(BaseModel):
    """Where the time went, s."""

    waiting_s: float = Field(description="From the request to the first picture.")
    taking_s: float = Field(description="Taking the frames.")
    computing_s: float = Field(description="From frames to points, findings and verdict.")
    writing_s: float = Field(description="Until the result was on the disk.")
    total_s: float = Field(description="From the request to the result on the disk.")


class ResultInfo(BaseModel):
    """What a job gave."""

    rows: int
    columns: int
    points: int = Field(description="Pixels with a point.")
    median_sigma_mm: float | None
    frame: FrameName
    verdict: Literal["pass", "fail", "undecided"] | None = Field(
        description="Null where no recipe was named."
    )
    recipe: str | None
    checks: list[CheckInfo]
    findings: list[FindingInfo]
    timing: Timing
    frames_kept: bool


class JobInfo(BaseModel):
    """A scan or a measurement: how far it is, and what came of it."""

    number: int
    kind: Kind
    name: str | None
    key: str | None
    state: State
    place: int | None = Field(description="Jobs before it, for one that waits.")
    accepted: str = Field(description="UTC, ISO 8601.")
    ended: str | None
    attempts: int = Field(description="How often it was begun.")
    step: int = Field(description="Frames that were taken.")
    steps: int = Field(description="Frames of the scan; 0 where it is not known.")
    problem: str | None = Field(description="Why there is no result.")
    request: ScanRequest | MeasureRequest
    result: ResultInfo | None


class JobList(BaseModel):
    """Jobs, the newest first."""

    jobs: list[JobInfo]


class Findings(BaseModel):
    """What was found by a job."""

    number: int
    findings: list[FindingInfo]


class VerdictInfo(BaseModel):
    """What a recipe says of the part."""

    number: int
    recipe: str
    verdict: Literal["pass", "fail", "undecided"]
    checks: list[CheckInfo]


class RigInfo(BaseModel):
    """The calibrated rig."""

    camera_px: tuple[int, int] = Field(description="Columns and rows.")
    projector_px: tuple[int, int]
    robot: Literal["hand", "base"] | None = Field(
        description="Where the camera is on a robot; null without a hand–eye calibration."
    )


class Status(BaseModel):
    """What the scanner is doing."""

    version: str
    api: str
    state: Literal["idle", "busy", "ending"]
    running: int | None
    waiting: list[int]
    queue_limit: int
    last: int | None = Field(description="Number of the last result.")
    uptime_s: float
    worker_restarts: int
    projector: str
    camera: str
    recipes: list[str]
    rig: RigInfo


class Health(BaseModel):
    """Whether the service answers and can take work."""

    ok: bool
    words: str


class Problem(BaseModel):
    """Why a request was refused."""

    problem: str


class Event(BaseModel):
    """What web sockets get: a job that was accepted, goes on, or ended."""

    event: Literal["hello", "accepted", "running", "step", "ended"]
    job: JobInfo | None
    missed: int = Field(description="Events that were dropped because the client reads too slowly.")


def as_json(model: BaseModel) -> dict[str, Any]:
    """A model as JSON values."""
    return model.model_dump(mode="json")
