"""What is in a frame before analysis: noise, the response of projector and camera, denoising."""

from ..types import (
    CameraNoise as CameraNoise,
)
from .response import (
    apply_response as apply_response,
)
from ..pipeline.stacks import (
    measure_response as measure_response,
)
from .denoise import (
    Denoiser as Denoiser,
    Decomposition as Decomposition,
    decompose_frame as decompose_frame,
    decompose_rows as decompose_rows,
)
