"""Two frames, or one: from fringes to displacements and heights over a reference plane."""

from ..pipeline.pairs import (
    calibrate_plane as calibrate_plane,
)
from ..rig.calibration.planes import (
    PixelCalibration as PixelCalibration,
)
from ..rig.calibration.planes import (
    PlaneCalibration as PlaneCalibration,
)
from ..rig.calibration.planes import (
    height_by_pixel as height_by_pixel,
)
from ..types import (
    DisplacementMap as DisplacementMap,
)
from ..types import (
    ReferencePlaneGeometry as ReferencePlaneGeometry,
)
from .analyse import (
    get_method as get_method,
)
from .bound import (
    bound_px as bound_px,
)
from .carrier import (
    Carrier as Carrier,
)
from .methods.wavelet import (
    wavelet_frequencies as wavelet_frequencies,
)
from .methods.wavelet import (
    wavelet_ridge as wavelet_ridge,
)
from .methods.windowed_fourier import (
    Ridge as Ridge,
)
from .methods.windowed_fourier import (
    windowed_fourier_filter as windowed_fourier_filter,
)
from .methods.windowed_fourier import (
    windowed_fourier_ridge as windowed_fourier_ridge,
)
from .prepared import (
    PreparedPair as PreparedPair,
)
from .prepared import (
    prepare as prepare,
)
from .reference_plane import (
    displacement_from_height as displacement_from_height,
)
from .reference_plane import (
    height_from_displacement as height_from_displacement,
)
from .reference_plane import (
    to_surface as to_surface,
)
from .registry import (
    Method as Method,
)
from .registry import (
    MethodOption as MethodOption,
)
from .registry import (
    Smoothing as Smoothing,
)
from .registry import (
    Solution as Solution,
)
from .unwrap import (
    Unwrapped as Unwrapped,
)
