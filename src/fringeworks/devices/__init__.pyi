"""Devices: projectors that show pictures and cameras that grab frames, real and virtual."""

from ..types import (
    CameraSettings as CameraSettings,
)
from ..types import (
    Region as Region,
)
from .bench import (
    virtual_bench as virtual_bench,
)
from .clock import (
    Clock as Clock,
)
from .folder_camera import (
    FolderCamera as FolderCamera,
)
from .genicam import (
    GenicamCamera as GenicamCamera,
)
from .memory_projector import (
    MemoryProjector as MemoryProjector,
)
from .opening import (
    camera_kind as camera_kind,
)
from .opening import (
    list_devices as list_devices,
)
from .opening import (
    open_camera as open_camera,
)
from .opening import (
    open_projector as open_projector,
)
from .opening import (
    projector_kind as projector_kind,
)
from .opening import (
    scanner_kind as scanner_kind,
)
from .protocols import (
    Camera as Camera,
)
from .protocols import (
    CameraLimits as CameraLimits,
)
from .protocols import (
    Grab as Grab,
)
from .protocols import (
    Projector as Projector,
)
from .protocols import (
    TriggeredCamera as TriggeredCamera,
)
from .protocols import (
    VideoMode as VideoMode,
)
from .registry import (
    ListedDevice as ListedDevice,
)
from .webcam import (
    WebcamCamera as WebcamCamera,
)
from .window import (
    WindowProjector as WindowProjector,
)
