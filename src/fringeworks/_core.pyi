"""Kernels in Rust.

Callers pass C-contiguous arrays of the stated dtype; others raise ``TypeError`` or ``ValueError``.
"""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DecodeSettings",
    "Triangles",
    "Triangulation",
    "average_phasor",
    "count_residues",
    "decode_frames",
    "decompose_rows",
    "invert_rows",
    "invert_windowed",
    "joint_albedo",
    "mark_isolated",
    "measure_points",
    "moving_means",
    "optimised",
    "raise_factors",
    "relocate_surfaces",
    "row_envelopes",
    "row_extrema",
    "smooth_within_walls",
    "typical_step",
    "unwrap_reliability",
    "version",
    "wall_sides",
    "warp_windowed",
    "wavelet_ridge_rows",
]
optimised: bool
version: str

def invert_rows(
    reference: NDArray[np.float64],
    object: NDArray[np.float64],
    mask: NDArray[np.uint8],
    *,
    guide: NDArray[np.float32] | None = None,
    method: str,
    degree: int,
    n_resample: int,
    period: float,
    prominence: float,
    floor: float,
    noise: float,
    max_displacement: float,
    tolerance: float,
    albedo_tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]: ...
def row_extrema(
    row: NDArray[np.float64], *, period: float, prominence: float, floor: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8]]: ...
def unwrap_reliability(
    phase: NDArray[np.float32],
    mask: NDArray[np.uint8],
    roughness: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]: ...
def count_residues(phase: NDArray[np.float32], mask: NDArray[np.uint8]) -> int: ...
def average_phasor(
    phase: NDArray[np.float32], weight: NDArray[np.float32], *, sigma: float, reach: int
) -> NDArray[np.complex64]: ...
def joint_albedo(
    value: NDArray[np.float32],
    slope: NDArray[np.float32],
    object: NDArray[np.float32],
    edge_weight: NDArray[np.float32],
    cliff: NDArray[np.uint8],
    *,
    stiffness: float,
    huber: float,
    iterations: Sequence[int],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def warp_windowed(
    spline: NDArray[np.float32],
    reference_ok: NDArray[np.uint8],
    object_ok: NDArray[np.uint8],
    displacement: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]: ...
def invert_windowed(
    spline: NDArray[np.float32],
    object: NDArray[np.float32],
    reference_ok: NDArray[np.uint8],
    object_ok: NDArray[np.uint8],
    start: NDArray[np.float32],
    albedo: NDArray[np.float32] | None = None,
    walls: NDArray[np.uint8] | None = None,
    *,
    scales: Sequence[float],
    iterations: int,
    period: float,
    confidence: float,
    object_noise: float,
    reference_noise: float,
    drift: float,
    max_sigma: float,
    min_explained: float,
) -> tuple[
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.uint8],
    float,
]: ...
def wavelet_ridge_rows(
    rows: NDArray[np.float32],
    *,
    frequencies: Sequence[float],
    omega: float,
    smoothness: float,
) -> tuple[NDArray[np.complex64], NDArray[np.float32]]: ...
def decompose_rows(
    rows: NDArray[np.float64], *, max_imfs: int, max_sifts: int, flat: float, patience: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32], int]: ...
def row_envelopes(
    rows: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def mark_isolated(
    coordinate: NDArray[np.float32],
    sigma: NDArray[np.float32],
    reason: NDArray[np.uint8],
    *,
    typical: float,
    repeats: float,
) -> int: ...
def moving_means(
    values: NDArray[Any], *, sides_y: Sequence[int], sides_x: Sequence[int]
) -> NDArray[Any]:
    """Means of neighbours, once for each of the odd sides along y and x.

    ``values`` and the result are float32 or float64 (h, w). The border's values go on beyond it.
    """

def raise_factors(
    coordinate: NDArray[np.float32],
    sigma: NDArray[np.float32],
    factors: NDArray[np.float32],
    *,
    step: int,
    side: int,
    most: float,
    excess: float,
    shared: float,
) -> None: ...
def typical_step(coordinate: NDArray[np.float32], *, repeats: float) -> float: ...
def measure_points(
    x: tuple[Sequence[NDArray[Any]], DecodeSettings] | None,
    y: tuple[Sequence[NDArray[Any]], DecodeSettings] | None,
    rig: Triangulation,
    maps: dict[str, Any],
    *,
    smooth: tuple[float, float] | None,
    residual_sigmas: float,
    residual_px: float,
) -> None: ...
def decode_frames(
    frames: Sequence[NDArray[Any]], plan: DecodeSettings, maps: dict[str, Any]
) -> None: ...

@final
class DecodeSettings:
    def __new__(
        cls,
        *,
        sets: Sequence[
            tuple[
                list[int],
                list[float],
                list[tuple[float, float, float]],
                float,
                float,
                list[float],
                list[float],
            ]
        ],
        code: dict[str, Any] | None,
        combinations: NDArray[np.float32],
        frequencies: NDArray[np.float32],
        amplification: NDArray[np.float32],
        room: NDArray[np.float32],
        remainder: list[int],
        alternative: NDArray[np.float32],
        order_variance: tuple[float, float],
        middle: float,
        half: float,
        repeats: float,
        circular: bool,
        read_variance: float,
        gain: float,
        saturation: float,
        min_snr: float,
        min_modulation: float,
        max_disagreement: float,
        usual_inflation: float,
        confidence: float,
        order_confidence: float,
    ) -> DecodeSettings: ...

_AxisMaps = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]

@final
class Triangulation:
    def __new__(
        cls,
        *,
        camera: Sequence[float],
        projector: Sequence[float],
        rotation: Sequence[float],
        translation: Sequence[float],
        spread: NDArray[np.float32],
        spread_along_x: bool,
        spread_length: float,
        camera_shape: tuple[int, int],
        projector_size: tuple[int, int],
    ) -> Triangulation: ...
    def run(
        self,
        x: _AxisMaps | None,
        y: _AxisMaps | None,
        maps: dict[str, Any],
        *,
        residual_sigmas: float,
        residual_px: float,
    ) -> None: ...

@final
class Triangles:
    def __new__(cls, vertices: NDArray[np.float64], faces: NDArray[np.uint32]) -> Triangles: ...
    def hit(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64], near: float
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]: ...

def relocate_surfaces(
    spline: NDArray[np.float32],
    object: NDArray[np.float32],
    reference_ok: NDArray[np.uint8],
    object_ok: NDArray[np.uint8],
    displacement: NDArray[np.float32],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    *,
    clean: NDArray[np.uint8],
    present: NDArray[np.float32],
    reach: int,
    margin: int,
    base: int,
    max_change: float,
    same: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]: ...
def wall_sides(
    spline: NDArray[np.float32],
    object: NDArray[np.float32],
    reference_ok: NDArray[np.uint8],
    object_ok: NDArray[np.uint8],
    displacement: NDArray[np.float32],
    offset: NDArray[np.float32],
    gain: NDArray[np.float32],
    walls: NDArray[np.uint8],
) -> NDArray[np.int64]: ...
def smooth_within_walls(
    values: NDArray[np.float32], walls: NDArray[np.uint8], sigma: float
) -> NDArray[np.float32]: ...
