"""Two frames, or one: from fringes to displacements and heights over a reference plane."""

from ..types import (
    DisplacementMap as DisplacementMap,
    ReferencePlaneGeometry as ReferencePlaneGeometry,
)
from ..rig.calibration.planes import (
    PixelCalibration as PixelCalibration,
    PlaneCalibration as PlaneCalibration,
)
from ..pipeline.pairs import (
    calibrate_plane as calibrate_plane,
)
from ..rig.calibration.planes import (
    height_by_pixel as height_by_pixel,
)
from .reference_plane import (
    displacement_from_height as displacement_from_height,
    height_from_displacement as height_from_displacement,
    to_surface as to_surface,
)
from .bound import (
    bound_px as bound_px,
)
from .registry import (
    Method as Method,
    MethodOption as MethodOption,
    Smoothing as Smoothing,
    Solution as Solution,
)
from .analyse import (
    get_method as get_method,
)
from .prepared import (
    PreparedPair as PreparedPair,
    prepare as prepare,
)
from .carrier import (
    Carrier as Carrier,
)
from .unwrap import (
    Unwrapped as Unwrapped,
)
from .methods.wavelet import (
    wavelet_frequencies as wavelet_frequencies,
    wavelet_ridge as wavelet_ridge,
)
from .methods.windowed_fourier import (
    Ridge as Ridge,
    windowed_fourier_filter as windowed_fourier_filter,
    windowed_fourier_ridge as windowed_fourier_ridge,
)
