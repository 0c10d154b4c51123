"""Kernels in Rust.

Callers pass C-contiguous arrays of the stated dtype (``Any``: float64 where nothing else is said);
others raise ``TypeError`` or ``ValueError``.

Functions, and the keys of dictionaries, have their names in the crate ``fringeworks``. Its
documentation says what they mean.
"""

from collections.abc import Sequence
from typing import Any, TypedDict, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DecodeSettings",
    "Triangles",
    "Triangulation",
    "add_residual_chi",
    "area_means",
    "average_phasor",
    "blur_shift",
    "box_means",
    "column_harmonics",
    "count_residues",
    "decode_frames",
    "decompose_rows",
    "edge_rings",
    "error_sums",
    "fit_moving",
    "fit_samples",
    "fitted_inside",
    "form_distances",
    "form_moments",
    "form_scores",
    "gram",
    "interpolate_linear",
    "invert_rows",
    "invert_windowed",
    "joint_albedo",
    "mark_isolated",
    "measure_points",
    "median_of_nine",
    "moving_means",
    "near_groups",
    "optimised",
    "pack_vertices",
    "phase_residuals",
    "quantiles",
    "raise_factors",
    "read_grey_png",
    "relocate_surfaces",
    "ripple_scores",
    "ripple_sums",
    "ripple_values",
    "robust_fit",
    "row_extrema",
    "second_magnitudes",
    "similar_groups",
    "smooth_windows",
    "smooth_within_walls",
    "third_chi_squares",
    "trimmed_variance",
    "turn_back",
    "typical_step",
    "unwrap_reliability",
    "version",
    "vote_cells",
    "vote_orders",
    "wall_sides",
    "warp_by_flow",
    "warp_windowed",
    "wavelet_ridge_rows",
    "weighted_sums",
    "widen",
    "window_sums",
]
optimised: bool
version: str

class _InvertRowsOptions(TypedDict):
    method: str
    """"ifa", "sifa", "gsifa" or "exact"."""
    degree: int
    n_resample: int
    period: float
    prominence: float
    floor: float
    noise: float
    max_displacement: float
    tolerance: float
    albedo_tolerance: float

def invert_rows(
    reference: NDArray[Any],
    object: NDArray[Any],
    mask: NDArray[np.uint8],
    options: _InvertRowsOptions,
    guide: NDArray[np.float32] | None = None,
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

class _Reweighting(TypedDict):
    fits: int
    """The first half goes towards least absolute deviations, the others have Tukey's weights."""
    least: float
    """Lower bound on a deviation in the weights for least absolute deviations, over the scatter."""
    most: float
    """Deviation beyond which a value has no weight, over the scatter."""

class _AlbedoModel(TypedDict):
    value: NDArray[np.float32]
    slope: NDArray[np.float32]
    object: NDArray[np.float32]
    edge_weight: NDArray[np.float32]
    cliff: NDArray[np.uint8]

def joint_albedo(
    model: _AlbedoModel, *, stiffness: float, huber: float, iterations: Sequence[int]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...

class _Pair(TypedDict):
    spline: NDArray[np.float32]
    object: NDArray[np.float32]
    reference_ok: NDArray[np.uint8]
    object_ok: NDArray[np.uint8]
    albedo: NDArray[np.float32] | None

class _WindowedLimits(TypedDict):
    object_noise: float
    reference_noise: float
    reference_left: float
    drift: float
    max_sigma: float
    min_explained: float

class _WindowedOptions(TypedDict):
    scales: Sequence[float]
    iterations: int
    period: float
    confidence: float
    limits: _WindowedLimits

def invert_windowed(
    pair: _Pair,
    start: NDArray[np.float32],
    options: _WindowedOptions,
    walls: NDArray[np.uint8] | None = None,
) -> tuple[
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.uint8],
    float,
]:
    """Displacement, σ of the noise, modulation ratio, offset, misfit, mean squared difference from
    finer windows, scale, and correlation of the noise."""

def warp_windowed(
    pair: _Pair, displacement: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]: ...

class _Surfaces(TypedDict):
    displacement: NDArray[np.float32]
    offset: NDArray[np.float32]
    gain: NDArray[np.float32]

class _Search(TypedDict):
    clean: NDArray[np.uint8]
    present: NDArray[np.float32]
    reach: int
    margin: int
    base: int
    max_change: float
    same: float

def relocate_surfaces(
    pair: _Pair, surfaces: _Surfaces, search: _Search
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]: ...
def wall_sides(pair: _Pair, surfaces: _Surfaces, walls: NDArray[np.uint8]) -> NDArray[np.int64]: ...
def smooth_within_walls(
    values: NDArray[np.float32], walls: NDArray[np.uint8], sigma: float
) -> NDArray[np.float32]: ...
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

def box_means(values: NDArray[Any], *, side: int, border: str = "edge") -> NDArray[Any]:
    """Means of squares of an odd side; float32 or float64 (h, w).

    ``border`` is "edge" (the border's values go on), "mirror" (without the border itself) or
    "zero". A value that is not finite spoils the rest of its column.
    """

def weighted_sums(
    values: NDArray[np.float32],
    *,
    weights_y: Sequence[float],
    weights_x: Sequence[float],
    border: str = "edge",
    step: int = 1,
) -> NDArray[np.float32]:
    """Weighted sums of the neighbours of every ``step``-th pixel along y and x, from the first on.

    Odd numbers of weights; the middle one is that of the pixel.
    """

def median_of_nine(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Medians of squares of 3 px; NaN where one is."""

def widen(marks: NDArray[np.bool_], *, reach: int) -> NDArray[np.bool_]:
    """What is within a distance of a mark along rows, columns and diagonals."""

def area_means(values: NDArray[np.float32], *, rows: int, columns: int) -> NDArray[np.float32]:
    """A smaller map, whose pixels are means of the areas that they cover."""

def interpolate_linear(
    values: NDArray[Any], *, rows: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[Any]:
    """Values at all pairs of some rows and columns; float32 or float64.

    The border's values go on beyond it. A NaN among the places gives NaN.
    """

class _Scale(TypedDict):
    step: int
    side: int

class _ScatterLimits(TypedDict):
    most: float
    excess: float
    shared: float

class _EdgeSteps(TypedDict):
    most: float
    repeats: float

class _Lights(TypedDict):
    modulation: NDArray[np.float32]
    background: NDArray[np.float32]
    shift: NDArray[np.float32]
    told: NDArray[np.float32]
    faint: float

def blur_shift(
    coordinate: NDArray[np.float32],
    sigma: NDArray[np.float32],
    lights: _Lights,
    steps: _EdgeSteps,
    slope: NDArray[np.float32],
) -> None: ...
def edge_rings(
    coordinate: NDArray[np.float32],
    sigma: NDArray[np.float32],
    steps: _EdgeSteps,
    rings: NDArray[np.uint8],
) -> list[tuple[float, float, float]]:
    """Count, sum (px²) and sum of squares (px⁴) of the errors at 1, 2, 3 and 4 px from a step."""

def raise_factors(
    coordinate: NDArray[np.float32],
    sigma: NDArray[np.float32],
    factors: NDArray[np.float32],
    scale: _Scale,
    limits: _ScatterLimits,
) -> None: ...

class _Shown(TypedDict):
    design: NDArray[np.float32]
    """(n, 3): what every frame shows of A, c and s."""
    solver: NDArray[np.float32]
    """(3, n): what A, c and s take from every frame."""
    harmonics: NDArray[np.float32]
    """(n, 2K): what every frame shows of B cos kφ and B sin kφ."""
    orders: Sequence[int]
    """The K orders k, rising from 2."""

class _SampleScatter(TypedDict):
    dark: float
    """Variance of a sample at the brightness 0, counts²."""
    gain: float
    floor: float
    """What a squared modulation adds to the variance."""
    saturation: float
    most: float
    """Largest χ² per degree of freedom that counts."""

def add_residual_chi(
    planes: Sequence[NDArray[Any]],
    shown: _Shown,
    scatter: _SampleScatter,
    lit: NDArray[np.bool_],
    sums: tuple[NDArray[np.float32], NDArray[np.float32]],
) -> None:
    """Add the χ² of the residuals of a set, and its degrees of freedom, to sums of both."""

class _Angles(TypedDict):
    turned: Sequence[NDArray[np.float32]]
    """Angle by which the phase of every frame has turned, in units of ``per_unit``."""
    per_unit: float
    """Radians of a unit."""
    shifts: Sequence[float]
    """Shift of every frame, rad."""

def fit_moving(
    samples: Sequence[NDArray[np.float32]], angles: _Angles
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A, c, s and the squared residuals of a set whose phase turns."""

def turn_back(
    samples: Sequence[NDArray[np.float32]],
    angles: _Angles,
    cosine: NDArray[np.float32],
    sine: NDArray[np.float32],
    kept: NDArray[np.bool_],
) -> None:
    """Turn the samples of a set back, in place, but for marked pixels."""

def warp_by_flow(
    values: NDArray[np.float32], flow: NDArray[np.float32], time: float
) -> NDArray[np.float32]:
    """A map as it would be some frames earlier, what moves along the flow moved back."""

def pack_vertices(
    xyz: NDArray[np.float32],
    sigma: NDArray[np.float32],
    noise: NDArray[np.float32],
    reason: NDArray[np.uint8],
    shade: NDArray[np.float32] | None = None,
    *,
    scale: float = 1.0,
) -> NDArray[np.uint8]:
    """Bytes of the points whose reason is 0, row after row: x, y, z, σ, noise, float32; with a
    shade also red, green and blue, uint8, which is the shade times ``scale``.

    ``xyz`` is (h, 3 w); ``shade`` is brightness (h, w) or colour (h, 3 w).
    """

def read_grey_png(content: bytes) -> NDArray[Any] | None:
    """uint8 or uint16, row after row; ``None`` for PNG that are not plain grey."""

def typical_step(coordinate: NDArray[np.float32], *, repeats: float) -> float: ...
def quantiles(values: NDArray[Any], shares: Sequence[float]) -> list[float]:
    """Quantiles of float32 or float64 values for rising shares; NaN where a value is NaN."""

def trimmed_variance(
    square: NDArray[np.float64], *, median: float, limit: float, mean: float, steps: int
) -> float:
    """Mean of the sums of squares below ``limit`` variances, over the ``mean`` of such sums for a
    variance of 1, in steps that start from their median."""

def similar_groups(
    key: NDArray[Any], values: NDArray[Any], groups: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keys and values, rearranged so that ``array_split`` gives groups of similar keys."""

def fit_samples(
    planes: Sequence[NDArray[Any]], design: NDArray[Any], solver: NDArray[Any]
) -> NDArray[np.float64]:
    """Fit every pixel of (1, n) planes: (8, n) array of A, c, s, the sum of squared residuals, and
    mean, variance, largest and smallest sample."""

def fitted_inside(
    fitted: tuple[NDArray[Any], NDArray[Any], NDArray[Any]],
    design: NDArray[Any],
    *,
    low: float,
    high: float,
) -> NDArray[np.bool_]:
    """Mark the fitted samples of A, c and s between two limits, (frames, n)."""

def form_distances(body: str, values: NDArray[Any], points: NDArray[Any]) -> NDArray[np.float64]:
    """Signed distances of points (n, 3) from a plane, sphere or cylinder."""

def form_moments(
    body: str,
    values: NDArray[Any],
    points: NDArray[Any],
    weight: NDArray[Any],
) -> NDArray[np.float64]:
    """Sums of the products of the derivatives of the weighted distances by the body's values, and
    of the distances as the last, (values + 1, values + 1)."""

def form_scores(
    body: str, values: NDArray[Any], points: NDArray[Any], share: float
) -> NDArray[np.float64]:
    """For each of several bodies of a kind (m, values), the distance within which a share of the
    points (n, 3) lies, (m,)."""

def near_groups(
    points: NDArray[Any], count: int, groups: int, reach: float, seed: int
) -> NDArray[np.uint32]:
    """Indices of ``count`` different points each within ``reach`` of a random one of the points
    (n, 3), at random; (m, count), m ≤ ``groups``: places with too few points have none."""

def error_sums(
    errors: tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[np.int64]],
    weights: NDArray[Any],
    directions: NDArray[Any],
    groups: int,
) -> tuple[float, float, NDArray[np.float64]]:
    """How errors of points add up in a quantity that changes by ``weights`` for displacements along
    ``directions``, (1, 3) or (n, 3).

    ``errors`` are the derivatives of the points by their values (n, 3), noise, common errors, blur,
    and the number of each point's group. Returns the variance by noise, the change by blur, and of
    each group the change by the common errors and the weighted direction, (groups, 4).
    """

def robust_fit(
    design: NDArray[Any],
    values: NDArray[Any],
    certainty: NDArray[Any],
    how: _Reweighting,
) -> tuple[NDArray[np.float64], float, NDArray[np.float64], NDArray[np.float64]]:
    """Coefficients of a linear model, scatter of the values about it, the normal matrices of all
    fits (fits, coefficients²), and the weights of the last one.

    ``design`` has a row for each coefficient, ``certainty`` is one over each value's σ.
    """

def gram(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of the products of all pairs of rows of a (P, n) array, (P, P)."""

def second_magnitudes(frame: NDArray[Any]) -> NDArray[Any]:
    """Magnitudes of second differences along both axes of a float32 or float64 (h, w) array:
    (h - 2, w - 2)."""

def third_chi_squares(
    coordinate: NDArray[np.float32], sigma: NDArray[np.float32], *, most: float
) -> NDArray[np.float32]:
    """χ² of the third differences along rows that are known and not larger than ``most``, (n,)."""

class _SampleMaps(TypedDict):
    coordinate: NDArray[np.float32]
    background: NDArray[np.float32]
    used: NDArray[np.bool_]

class _SampleSet(TypedDict):
    phase: NDArray[np.float32]
    modulation: NDArray[np.float32]
    period: float
    variance: float

class _SampleNoise(TypedDict):
    read_variance: float
    gain: float
    min_modulation: float

def phase_residuals(
    maps: _SampleMaps, set: _SampleSet, noise: _SampleNoise
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Phases less those of the coordinate at the used pixels, turns, and ``variance`` times the
    variance of the noise over the squared modulation."""

class _Wanted(TypedDict):
    fringes: float
    least: int
    most: int
    windows: tuple[int, int]
    jump: float

def smooth_windows(
    turns: NDArray[np.float32], usable: NDArray[np.bool_], wanted: _Wanted
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Unwrapped phases of windows without edges along rows, rad, and indices of their pixels."""

def window_sums(
    phase: NDArray[Any], basis: NDArray[Any], orders: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Sums of the products of the phases' harmonics, (windows, P, P), of these and the phases,
    (windows, P), and of squared phases, without what the rows of ``basis`` explain."""

class _SetWaves(TypedDict):
    phase: NDArray[Any]
    orders: Sequence[Sequence[int]]

def ripple_sums(waves: _SetWaves, values: NDArray[Any]) -> NDArray[np.float64]:
    """Sums of the products of all pairs of rows: cosine and sine of all orders of all sets, rows of
    values, and ones; ``phase`` has a row of rad for every set."""

def ripple_values(waves: _SetWaves, coefficients: NDArray[Any]) -> NDArray[np.float64]:
    """The ripple of every set, (M, n), from the coefficients of its cosines and sines."""

def ripple_scores(
    waves: _SetWaves,
    factors: NDArray[Any],
    mean: NDArray[Any],
    group: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Sums of the products of all pairs of scores. Scores are sums over neighbours of one ``group``
    of cosines and sines less their ``mean``, times the (M, n) ``factors`` of their set."""

def column_harmonics(
    phase: NDArray[np.float32], used: NDArray[np.bool_], orders: Sequence[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sums of cosine and sine of the orders of phases over used pixels: a row per wave with that of
    every column, and two rows for the first order with those of every row of the picture."""

class _PointLimits(TypedDict):
    residual_sigmas: float
    residual_px: float

def measure_points(
    x: tuple[Sequence[NDArray[Any]], DecodeSettings] | None,
    y: tuple[Sequence[NDArray[Any]], DecodeSettings] | None,
    rig: Triangulation,
    maps: dict[str, Any],
    *,
    typical: tuple[float, float] | None,
    limits: _PointLimits,
) -> None: ...
def decode_frames(
    frames: Sequence[NDArray[Any]], settings: DecodeSettings, maps: dict[str, Any]
) -> None: ...

class _VoteRules(TypedDict):
    radius: int
    error_rate: float
    near_error_rate: float
    largest_misfit: float
    own_doubt: float
    usual_misfit: tuple[float, float]

class _CellRules(TypedDict):
    radius: int
    ahead: int
    others: float
    continued: float

def vote_cells(settings: DecodeSettings, maps: dict[str, Any], rules: _CellRules) -> int:
    """Fringe orders of ambiguous pixels by the Gray-code cells of their neighbours; number of
    changes.

    ``maps`` has ``coordinate``, ``sigma`` and ``reason``, which are changed, the lists ``phases``
    (rad) and ``variances`` (rad²) with one (h, w) array each, and the list ``cells`` with the
    middle and the half width (px) of the range that the bits of every pixel leave.
    """

def vote_orders(settings: DecodeSettings, maps: dict[str, Any], rules: _VoteRules) -> int:
    """Fringe orders of ambiguous pixels by the phases of their neighbours; number of changes.

    ``maps`` has ``coordinate``, ``sigma`` and ``reason``, which are changed, and the lists
    ``phases`` (rad) and ``variances`` (rad²) with a (h, w) array for each set.
    """

class _Table(TypedDict):
    turns: Sequence[float]
    brightness: Sequence[float]

class _Harmonics(TypedDict):
    orders: Sequence[int]
    shares: list[float]

class _PhaseSet(TypedDict):
    frames: list[int]
    shifts: list[float]
    design: list[tuple[float, float, float]]
    offsets: list[float]
    period: float
    floor: float
    whole: bool
    harmonics: _Harmonics
    table: _Table

class _GrayCode(TypedDict):
    bits: list[int]
    inverse: list[int]
    white_black: tuple[int, int] | None
    levels: int
    inverted: int
    step: float
    offset: float
    cells: int
    doubt_share: float
    alien_share: float
    widest: float
    blurred: float
    slack: float
    guard: float
    confidence: float

class _Chain(TypedDict):
    combinations: NDArray[np.float32]
    frequencies: NDArray[np.float32]
    amplification: NDArray[np.float32]
    margin: NDArray[np.float32]
    remainder: list[int]
    alternative: NDArray[np.float32]
    order_variance: tuple[float, float]
    middle: float
    half: float
    repeats: float
    circular: bool

class _Noise(TypedDict):
    read_variance: float
    gain: float

class _DecodeLimits(TypedDict):
    saturation: float
    min_snr: float
    min_modulation: float
    max_disagreement: float
    usual_inflation: float
    confidence: float
    order_confidence: float

@final
class DecodeSettings:
    def __new__(
        cls,
        *,
        sets: Sequence[_PhaseSet],
        gray_code: _GrayCode | None,
        chain: _Chain,
        noise: _Noise,
        limits: _DecodeLimits,
    ) -> DecodeSettings: ...

class _AxisMaps(TypedDict):
    coordinate: NDArray[np.float32]
    sigma: NDArray[np.float32]
    reason: NDArray[np.uint8]

class _Field(TypedDict):
    first: Sequence[float]
    step: Sequence[float]
    columns: int
    control: Sequence[float]
    """Corrections of column and row, point after point of each row."""

class _Rig(TypedDict):
    camera: Sequence[float]
    """Focal lengths, principal point, and five coefficients of the distortion."""
    projector: Sequence[float]
    rotation: Sequence[float]
    translation: Sequence[float]
    camera_field: _Field | None
    projector_field: _Field | None

class _Spread(TypedDict):
    coefficients: NDArray[np.float32]
    along_x: bool
    length: float

@final
class Triangulation:
    def __new__(
        cls,
        rig: _Rig,
        spread: _Spread,
        *,
        camera_shape: tuple[int, int],
        projector_size: tuple[int, int],
    ) -> Triangulation: ...
    def triangulate(
        self,
        x: _AxisMaps | None,
        y: _AxisMaps | None,
        maps: dict[str, Any],
        *,
        limits: _PointLimits,
    ) -> None: ...

@final
class Triangles:
    def __new__(cls, vertices: NDArray[np.float64], faces: NDArray[np.uint32]) -> Triangles: ...
    def hit(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64], near: float
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]: ...
    def nearest(self, points: NDArray[np.float64], reach: float) -> NDArray[np.int32]: ...
