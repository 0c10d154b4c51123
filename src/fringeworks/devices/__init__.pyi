"""Devices: projectors that show pictures and cameras that grab frames, real and virtual."""

from .protocols import (
    Camera as Camera,
    Projector as Projector,
    TriggeredCamera as TriggeredCamera,
    LineCamera as LineCamera,
    PtpCamera as PtpCamera,
    ColourCamera as ColourCamera,
    ColourProjector as ColourProjector,
)
from ..types import (
    CameraSettings as CameraSettings,
)
from .protocols import (
    CameraLimits as CameraLimits,
)
from ..types import (
    Region as Region,
)
from .protocols import (
    VideoMode as VideoMode,
    Grab as Grab,
)
from .clock import (
    Clock as Clock,
)
from .window import (
    WindowProjector as WindowProjector,
)
from .memory_projector import (
    MemoryProjector as MemoryProjector,
)
from .sequencer import (
    SequenceProjector as SequenceProjector,
    SequenceSettings as SequenceSettings,
)
from .dlpc900 import (
    Dlpc900 as Dlpc900,
    DlpStatus as DlpStatus,
)
from .dlpc350 import (
    Dlpc350 as Dlpc350,
)
from .trigger_box import (
    TriggerBox as TriggerBox,
)
from .grbl import (
    GrblTable as GrblTable,
)
from .webcam import (
    WebcamCamera as WebcamCamera,
)
from .genicam import (
    GenicamCamera as GenicamCamera,
)
from .gentl import (
    GentlCamera as GentlCamera,
)
from .folder_camera import (
    FolderCamera as FolderCamera,
)
from .bench import (
    virtual_bench as virtual_bench,
    virtual_rig as virtual_rig,
)
from .opening import (
    open_camera as open_camera,
    open_projector as open_projector,
    camera_kind as camera_kind,
    projector_kind as projector_kind,
    scanner_kind as scanner_kind,
    list_devices as list_devices,
)
from .registry import (
    ListedDevice as ListedDevice,
)
