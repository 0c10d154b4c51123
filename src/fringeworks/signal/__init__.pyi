"""What is in a frame before analysis: noise, the response of projector and camera, denoising."""

from ..pipeline.stacks import (
    measure_response as measure_response,
)
from ..types import (
    CameraNoise as CameraNoise,
)
from .denoise import (
    Decomposition as Decomposition,
)
from .denoise import (
    Denoiser as Denoiser,
)
from .denoise import (
    decompose_frame as decompose_frame,
)
from .denoise import (
    decompose_rows as decompose_rows,
)
from .response import (
    apply_response as apply_response,
)
