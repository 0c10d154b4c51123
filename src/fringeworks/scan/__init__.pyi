"""Scans: showing patterns and grabbing frames, with the right timing and exposure."""

from .bench import (
    take as take,
    Take as Take,
    open_bench as open_bench,
    Bench as Bench,
)
from .series import (
    CaptureSeries as CaptureSeries,
    capture_series as capture_series,
)
from .setup import (
    Setup as Setup,
    SetupStopped as SetupStopped,
    SetupTests as SetupTests,
)
from ..files.setup import (
    StoredSetup as StoredSetup,
)
from ..types import (
    Delay as Delay,
)
from .delay import (
    measure_delay as measure_delay,
)
from .frames import (
    take_frames as take_frames,
)
from .live import (
    LiveCloud as LiveCloud,
)
from .live_calibration import (
    TakenPose as TakenPose,
    calibrate_live as calibrate_live,
    PoseTaker as PoseTaker,
    take_poses as take_poses,
)
from .exposure import (
    auto_exposure as auto_exposure,
    exposure_series as exposure_series,
)
from .hdr import (
    capture_hdr as capture_hdr,
)
from .together import (
    CameraGroup as CameraGroup,
    capture_together as capture_together,
)
from .turntable import (
    scan_turntable as scan_turntable,
)
from .poses import (
    PoseJudgement as PoseJudgement,
    judge_poses as judge_poses,
)
