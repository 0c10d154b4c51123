"""Smooth errors of camera and projector that Brown's model does not hold, as fields (theory §8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.field_equations import Linearised, Pair
from fringeworks.rig.calibration.field_modes import Modes
from fringeworks.rig.calibration.leave_out import MIN_PREDICTING
from fringeworks.rig.calibration.parameters import RIG_SIZE
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.lens_field import correction, correction_sigma
from fringeworks.types import BoolMap, FloatMap, LensField, Rig

FIRST_LENGTHS = (1.0 / 5.0, 1.0 / 10.0)
"""Lengths over which a field changes, in widths of the frame, with which a calibration is asked
whether it has one: a lens that is off by its next coefficient, and a sine of four periods."""
LENGTHS = (*FIRST_LENGTHS, 1.0 / 18.0)
"""Lengths of which the evidence chooses where there is one; the last is that of seven periods."""
SCALES_PX = np.geomspace(1e-3, 1.0, 25)
"""Standard deviations of a field that are compared, px; all are equally probable before. Corners
show no smaller ones, and with larger ones a board is hardly found."""
MAX_ROUNDS = 10
"""Largest number of rounds of estimation and adjustment; four are usual."""
SETTLED = 0.1
"""Change of a field between two rounds, over its standard deviation, below which it has settled."""


@dataclass(frozen=True, eq=False)
class Fields:
    """What the fields of an adjustment's devices add to it."""

    covariance: FloatMap
    """What not knowing the fields adds to the covariance of the rig's 24 parameters."""
    freedom: float
    """Number of parameters of the fields that the corners determine."""
    size_px: tuple[float, float]
    """Root mean square of the fields of camera and projector at the corners, without what the
    devices' parameters could take up, px; 0 for none."""
    sigma_px: tuple[float, float]
    """Root mean square of their standard deviations there, px."""

    @classmethod
    def none(cls) -> Fields:
        """No field."""
        return cls(np.zeros((RIG_SIZE, RIG_SIZE)), 0.0, (0.0, 0.0), (0.0, 0.0))

    @property
    def any(self) -> bool:
        """Whether a device has a field."""
        return max(self.size_px) > 0

    def inflated(self, rig: Rig, factor: float) -> Rig:
        """The adjusted rig with the errors of its fields, and all standard deviations raised."""
        assert rig.covariance is not None
        covariance = (rig.covariance + self.covariance) * factor**2
        camera, projector = (
            device
            if device.field is None
            else replace(
                device, field=replace(device.field, sigma_px=device.field.sigma_px * factor)
            )
            for device in (rig.camera, rig.projector)
        )
        return replace(rig, camera=camera, projector=projector, covariance=covariance)

    def scatter_factor(self, corners: int) -> float:
        """Factor by which the scatter of residuals is too small, because the fields took a part."""
        values = 2.0 * corners * sum(size > 0 for size in self.size_px)
        return float(np.sqrt(values / max(values - self.freedom, 1.0))) if values else 1.0


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Modes and scale of a device's field, as the evidence has them."""

    modes: Modes
    length: float
    scale_px: float
    log_evidence: float
    """Of a field, averaged over all lengths and scales, over that of none."""


def with_fields(
    sightings: Sequence[Sighting], adjusted: Adjusted, *, free: BoolMap
) -> tuple[Adjusted, Fields]:
    """Estimate a field of each device, jointly with everything else, where there is evidence.

    Parameters
    ----------
    sightings : sequence of Sighting
        Of one camera.
    adjusted : Adjusted
        Their adjustment without fields.
    free : (24,) bool array

    Returns
    -------
    The adjustment, with fields in its rig's devices; the same where they have none. And what the
    fields add to its errors.

    Notes
    -----
    A field is a priori a Gaussian surface with mean zero, whose scale and length are unknown. Its
    evidence is the probability of the corners, with all other parameters, averaged over the field
    (MacKay, Neural Computation 4, 1992, doi:10.1162/neco.1992.4.3.415). It is compared with that of
    no field; a field that the corners hardly show is shrunk. Errors that the corners of one pose
    share look like a field there, but the other poses do not predict them: the field of all other
    poses must predict every pose better than none does, on the whole (Geisser and Eddy, JASA 74,
    1979, doi:10.1080/01621459.1979.10481632). Weights, scatter and fields are estimated in turn
    until they settle. Splined models of lenses are those of mrcal; here Brown's model remains, and
    the spline holds what it leaves.
    """
    asked: tuple[int, ...] = (0, 1) if len(sightings) > MIN_PREDICTING else ()
    while asked:
        found, fields, chosen = _settled_fields(sightings, adjusted, free, asked)
        has = [k for k in asked if chosen[k] is not None]
        if not has:
            break
        trial = _Trial(sightings, found, free)
        predict = [k for k in has if trial.gain(k, chosen) > 0.0]
        if predict == has:
            return found, fields
        asked = tuple(predict)
    return adjusted, Fields.none()


def _settled_fields(
    sightings: Sequence[Sighting], adjusted: Adjusted, free: BoolMap, asked: Sequence[int]
) -> tuple[Adjusted, Fields, list[_Chosen | None]]:
    """Estimate fields of the devices that are asked, and everything else, until they settle."""
    plain, fields = adjusted, Fields.none()
    now = Linearised(sightings, adjusted, free)
    chosen = _first(now, asked)
    for _ in range(MAX_ROUNDS):
        if chosen == [None, None]:
            return plain, Fields.none(), chosen
        before = adjusted.rig
        rig, fields = _estimated(now, chosen)
        poses, smooth = adjusted.poses, adjusted.smooth
        adjusted = adjust(sightings, rig, poses, free=free, smooth=smooth)
        now = Linearised(sightings, adjusted, free)
        settled = _settled(now, before)
        has = [one is not None for one in chosen]
        for k in asked:
            # The other device is asked once this one's field holds all that it explains.
            if chosen[k] is not None or settled:
                chosen[k] = _best(now, k, chosen[1 - k], _lengths(chosen[k]))
        if settled and has == [one is not None for one in chosen]:
            break
    return adjusted, fields, chosen


class _Trial:
    """An adjustment as the poses without each of them have it."""

    def __init__(self, sightings: Sequence[Sighting], adjusted: Adjusted, free: BoolMap) -> None:
        self.parts = [Linearised(sightings, adjusted, free)]
        pose = self.parts[0].corners.pose
        for k in range(len(adjusted.poses)):
            others = replace(
                adjusted,
                poses=tuple(T for n, T in enumerate(adjusted.poses) if n != k),
                weighting=adjusted.weighting.of_rows(pose != k),
            )
            rest = [s for n, s in enumerate(sightings) if n != k]
            self.parts.append(Linearised(rest, others, free))

    def gain(self, device: int, chosen: Sequence[_Chosen | None]) -> float:
        """By how much a field predicts every pose from the others better than none: logarithm of
        the ratio of probabilities, summed over the poses."""
        own = chosen[device]
        assert own is not None
        scale = int(np.argmin(np.abs(SCALES_PX - own.scale_px)))
        logs = [
            _log_evidence(part, device, own.modes, chosen[1 - device])[scale] for part in self.parts
        ]
        return float(sum(logs[0] - one for one in logs[1:]))


def _first(now: Linearised, asked: Sequence[int]) -> list[_Chosen | None]:
    """The device with the most evidence of a field, if any, and its modes."""
    found = [_best(now, k, None, FIRST_LENGTHS) if k in asked else None for k in range(2)]
    known = [-np.inf if one is None else one.log_evidence for one in found]
    best = int(np.argmax(known))
    return [one if k == best else None for k, one in enumerate(found)]


def _lengths(chosen: _Chosen | None) -> tuple[float, ...]:
    """Lengths to compare: all at first, then the one that was found and its neighbours."""
    if chosen is None:
        return FIRST_LENGTHS
    place = LENGTHS.index(chosen.length)
    return LENGTHS[max(place - 1, 0) : place + 2]


def _best(
    now: Linearised, device: int, other: _Chosen | None, lengths: Sequence[float]
) -> _Chosen | None:
    """The best modes of a device, beside those of the other device; None where none is better."""
    pinhole = (now.rig.camera, now.rig.projector)[device]
    tried = [Modes.of(pinhole, length) for length in lengths]
    logs = np.stack([_log_evidence(now, device, modes, other) for modes in tried])
    averaged = float(scipy.special.logsumexp(logs) - np.log(logs.size))
    if averaged <= 0.0:
        return None
    place, scale = (int(k) for k in np.unravel_index(np.argmax(logs), logs.shape))
    return _Chosen(tried[place], lengths[place], float(SCALES_PX[scale]), averaged)


def _log_evidence(now: Linearised, device: int, modes: Modes, other: _Chosen | None) -> FloatMap:
    """Logarithm of the evidence of a device's field of every scale over that of none."""
    rest = None if other is None else other.modes
    of: Pair = (rest, modes) if device else (modes, rest)
    equations = now.fields(of)
    own, further = equations.part(device), equations.part(1 - device)
    M, v = equations.matrix[own, own], equations.right[own]
    if other is not None:
        # The other field is averaged over as well.
        inner = equations.matrix[further, further].copy()
        inner[np.diag_indices_from(inner)] += other.scale_px**-2.0
        gain = np.linalg.solve(inner, equations.matrix[further, own]).T
        M = M - gain @ equations.matrix[further, own]
        v = v - gain @ equations.right[further]
    if device == 0:
        directions = now.turned(modes)
        M, v = directions.T @ M @ directions, directions.T @ v
    values, vectors = np.linalg.eigh(M)
    values, along = np.maximum(values, 0.0), vectors.T @ v
    gained = SCALES_PX[:, None] ** 2
    share = along**2 * gained / (1.0 + gained * values)
    return np.asarray(0.5 * np.sum(share - np.log1p(gained * values), axis=1))


def _estimated(now: Linearised, chosen: Sequence[_Chosen | None]) -> tuple[Rig, Fields]:
    """The rig with the fields of the chosen modes, jointly, and what they add to its errors.

    Notes
    -----
    The errors of a field act in part as errors of the device's parameters and, for the projector,
    as a turn. This part, as far as it is seen at the corners, is put into the covariance of the
    parameters; σ of the field is that of the rest, which is nearly independent of them.
    """
    camera, projector = (None if one is None else one.modes for one in chosen)
    equations = now.fields((camera, projector))
    directions = [] if camera is None else [now.turned(camera)]
    directions += [] if projector is None else [np.eye(projector.count)]
    precision = np.concatenate(
        [
            np.full(part.shape[1], one.scale_px**-2.0)
            for part, one in zip(directions, filter(None, chosen), strict=True)
        ]
    )
    N = scipy.linalg.block_diag(*directions)
    covariance = np.linalg.inv(N.T @ equations.matrix @ N + np.diag(precision))
    amplitudes = N @ (covariance @ (N.T @ equations.right))
    root = N @ np.linalg.cholesky(0.5 * (covariance + covariance.T))
    moved, of = equations.moved.copy(), list[LensField | None]()
    for k, modes in enumerate((camera, projector)):
        part = equations.part(k)
        if modes is None:
            of.append(None)
            continue
        taken = now.taken(k, modes)
        moved[:, part] += now.as_parameters(k, taken)
        by = modes.at(modes.places()) - now.tangent(k, modes.places()) @ taken
        sigma = np.linalg.norm(np.nan_to_num(by) @ root[part], axis=2)
        of.append(modes.field(amplitudes[part], sigma))
    added = moved @ root
    rig = replace(
        now.rig,
        camera=replace(now.rig.camera, field=of[0]),
        projector=replace(now.rig.projector, field=of[1]),
    )
    freedom = len(precision) - float(np.diag(covariance) @ precision)
    sizes = [_size(now, k, field) for k, field in enumerate(of)]
    sigmas = [
        0.0 if f is None else _rms(correction_sigma(f, now.places(k))) for k, f in enumerate(of)
    ]
    return rig, Fields(added @ added.T, freedom, (sizes[0], sizes[1]), (sigmas[0], sigmas[1]))


def _size(now: Linearised, device: int, field: LensField | None) -> float:
    """Root mean square of a field at the corners that the device's parameters cannot take up."""
    if field is None:
        return 0.0
    by = now.tangent(device, now.places(device))
    by = by.reshape(-1, by.shape[2])
    wanted = correction(field, now.places(device)).ravel()
    scale = np.linalg.norm(by, axis=0)
    return _rms(wanted - by / scale @ np.linalg.lstsq(by / scale, wanted)[0])


def _rms(values: FloatMap) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _settled(now: Linearised, before: Rig) -> bool:
    """Whether the fields changed by less than their σ since an earlier rig."""
    for k, (device, earlier) in enumerate(
        ((now.rig.camera, before.camera), (now.rig.projector, before.projector))
    ):
        if (device.field is None) != (earlier.field is None):
            return False
        if device.field is not None and earlier.field is not None:
            places = now.places(k)
            change = correction(device.field, places) - correction(earlier.field, places)
            if _rms(change) > SETTLED * _rms(correction_sigma(device.field, places)):
                return False
    return True
