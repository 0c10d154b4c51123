"""Scans: showing patterns and grabbing frames, with the right timing and exposure."""

from .bench import (
    Bench as Bench,
)
from .bench import (
    Take as Take,
)
from .bench import (
    open_bench as open_bench,
)
from .bench import (
    take as take,
)
from .delay import (
    Delay as Delay,
)
from .delay import (
    measure_delay as measure_delay,
)
from .exposure import (
    auto_exposure as auto_exposure,
)
from .exposure import (
    exposure_series as exposure_series,
)
from .frames import (
    take_frames as take_frames,
)
from .hdr import (
    capture_hdr as capture_hdr,
)
from .live import (
    LiveCloud as LiveCloud,
)
from .live_calibration import (
    PoseTaker as PoseTaker,
)
from .live_calibration import (
    TakenPose as TakenPose,
)
from .live_calibration import (
    calibrate_live as calibrate_live,
)
from .live_calibration import (
    take_poses as take_poses,
)
from .poses import (
    PoseJudgement as PoseJudgement,
)
from .poses import (
    judge_poses as judge_poses,
)
from .setup import (
    Setup as Setup,
)
from .setup import (
    SetupStopped as SetupStopped,
)
from .setup import (
    SetupTests as SetupTests,
)
from .setup_file import (
    StoredSetup as StoredSetup,
)
from .turntable import (
    scan_turntable as scan_turntable,
)
