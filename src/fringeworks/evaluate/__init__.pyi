"""Errors against a known truth, and comparison of methods."""

from ..types import (
    Alignment as Alignment,
)
from ..types import (
    Area as Area,
)
from ..types import (
    BestFit as BestFit,
)
from ..types import (
    DatumPlanes as DatumPlanes,
)
from ..types import (
    DatumPoints as DatumPoints,
)
from ..types import (
    KnownPose as KnownPose,
)
from ..types import (
    PartModel as PartModel,
)
from ..types import (
    PartTolerance as PartTolerance,
)
from .best_method import (
    best_methods as best_methods,
)
from .captures import (
    CaptureComparison as CaptureComparison,
)
from .captures import (
    compare_captures as compare_captures,
)
from .compare import (
    CompareOptions as CompareOptions,
)
from .compare import (
    SceneOptions as SceneOptions,
)
from .compare import (
    compare_everywhere as compare_everywhere,
)
from .deviation import (
    Deviation as Deviation,
)
from .form import (
    FormEvaluation as FormEvaluation,
)
from .inspect import (
    Check as Check,
)
from .inspect import (
    Inspection as Inspection,
)
from .inspect import (
    judge_part as judge_part,
)
from .selftest.promises import (
    Judged as Judged,
)
from .selftest.promises import (
    Promise as Promise,
)
from .selftest.promises import (
    promise_table as promise_table,
)
from .selftest.run import (
    SelfTest as SelfTest,
)
from .spots import (
    Spot as Spot,
)
from .spots import (
    find_spots as find_spots,
)
from .truth_errors import (
    Errors as Errors,
)
from .truth_errors import (
    errors as errors,
)
from .vibrations import (
    AreaTracker as AreaTracker,
)
from .vibrations import (
    Displacement as Displacement,
)
from .vibrations import (
    Vibration as Vibration,
)
from .vibrations import (
    vibration as vibration,
)
