"""What a first week needs, in the order of the light; the submodules hold the rest.

Each name is loaded from its module on first use (``_lazy.py``).
"""

__version__: str

# Submodules: one for each room.
from . import (
    patterns as patterns,
    devices as devices,
    scan as scan,
    signal as signal,
    pair as pair,
    stack as stack,
    rig as rig,
    views as views,
    surface as surface,
    evaluate as evaluate,
    simulate as simulate,
    files as files,
    data as data,
    report as report,
    batch as batch,
)

# Types.
from .types import (
    Pair as Pair,
)
from .stack.frames import (
    Stack as Stack,
)
from .patterns.plan import (
    PatternPlan as PatternPlan,
)
from .types import (
    Decoded as Decoded,
    HeightMap as HeightMap,
    PointCloud as PointCloud,
    TriangleMesh as TriangleMesh,
    Rig as Rig,
    Recipe as Recipe,
)
from .signal.response import (
    Response as Response,
)
from .pipeline.stacks import (
    Measurement as Measurement,
)
from .pipeline.pairs import (
    Reconstruction as Reconstruction,
)
from .rig.calibration.calibrate import (
    Calibration as Calibration,
)
from .types import (
    Finding as Finding,
    Reason as Reason,
    Provenance as Provenance,
)

# Errors.
from .types import (
    InputError as InputError,
    FileProblem as FileProblem,
    DeviceProblem as DeviceProblem,
    MissingPackage as MissingPackage,
    FramesContradictPlan as FramesContradictPlan,
    RigMismatch as RigMismatch,
    BoardNotFound as BoardNotFound,
    UnknownMethod as UnknownMethod,
)

# One verb for each stage.
from .patterns.propose import (
    propose as propose,
)
from .patterns.encode import (
    encode as encode,
)
from .devices.opening import (
    open_devices as open_devices,
)
from .scan.setup import (
    set_up as set_up,
)
from .scan.capture import (
    capture as capture,
)
from .scan.live import (
    live as live,
)
from .signal.denoise import (
    denoise as denoise,
)
from .pair.analyse import (
    analyse as analyse,
)
from .pipeline.pairs import (
    reconstruct as reconstruct,
)
from .pair.unwrap import (
    unwrap as unwrap,
)
from .pipeline.verbs import (
    decode as decode,
)
from .rig.triangulate import (
    triangulate as triangulate,
)
from .pipeline.verbs import (
    calibrate as calibrate,
    measure as measure,
)
from .pipeline.merging import (
    merge as merge,
)
from .evaluate.form import (
    fit as fit,
)
from .evaluate.inspect import (
    inspect as inspect,
)
from .evaluate.deviation import (
    deviation as deviation,
)
from .evaluate.compare import (
    compare as compare,
)
from .pair.analyse import (
    methods as methods,
)
from .pair.plugins import (
    method as method,
)
from .devices.registry import (
    load_plugin as load_plugin,
)
from .evaluate.selftest.run import (
    selftest as selftest,
)
from .report.figures import (
    save_figure as save_figure,
)
from .report.page.report import (
    write_report as write_report,
)
from .files.read_write import (
    read as read,
    write as write,
)
from .studio.run import (
    run_studio as run_studio,
)
from .service.run import (
    run_service as run_service,
)
