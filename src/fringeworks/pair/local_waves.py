"""The strongest local wave of a field at every point of a lattice (theory §5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.pair.bandpass import Analytic
from fringeworks.pair.lattice import Lattice, shift_wave
from fringeworks.pair.ridge import Hessian, MapsYX, blend, curvature, strongest, window_factor
from fringeworks.types import FloatMap

CONTINUATION_DEPTH = 2.0
"""Distance from the field's end of the waves that continue it into the border, σ.

Waves closer to the end are measured with windows that reach into the border. An empirical choice.
"""


@dataclass(frozen=True)
class LocalWaves:
    """The strongest wave at every lattice point on the field."""

    phasor: Analytic
    """Phase and amplitude."""
    frequencies: MapsYX
    """Along y and x, rad/px."""
    hessian: Hessian
    """Second derivatives of the phase (yy, xx, xy), rad/px²."""

    def at(self, lattice: Lattice, rows: slice) -> tuple[Analytic, FloatMap, FloatMap]:
        """Phasor and frequencies along y and x at the pixels of some rows, (r, w)."""
        return blend(
            self.phasor, self.frequencies, self.hessian, lattice.pitch, lattice.shape, rows
        )


def measured_waves(lattice: Lattice, values: Analytic, threshold: float) -> LocalWaves:
    """The strongest waves of a field, measured twice.

    ``threshold`` is that of the coefficients which continue the field beyond its border, in units
    of a coefficient of a window of unit energy.
    """
    waves = _local_waves(lattice, lattice.extended(values, threshold))
    # With frequency and curvature known, the border can be continued more accurately.
    return _local_waves(lattice, _continued(lattice, values, waves))


def _local_waves(lattice: Lattice, padded: Analytic) -> LocalWaves:
    """Find the strongest waves and remove the window's factor from their coefficients."""
    coefficient, frequencies, offsets = _strongest_waves(lattice, padded)
    hessian = curvature(frequencies, lattice.pitch, lattice.sigma_px)
    # A window of unit energy turns an amplitude of 1 into 2σ√π.
    scale = 2.0 * lattice.sigma_px * np.sqrt(np.pi) * lattice.density
    factor = window_factor(offsets, hessian, lattice.sigma_px)
    return LocalWaves((coefficient / (scale * factor)).astype(np.complex64), frequencies, hessian)


def _continued(lattice: Lattice, field: Analytic, waves: LocalWaves) -> Analytic:
    """Add a border that continues the field by the waves some distance inside it."""
    padded = lattice.pad(field)
    h, w = lattice.shape
    sides = []
    for axis, side, pitch in zip((lattice.y, lattice.x), (h, w), lattice.pitch, strict=True):
        # The lattice is periodic: the second half of the border precedes the field.
        at = np.arange(axis.length)
        at = np.where(at >= (side + axis.length) / 2, at - axis.length, at)
        depth = min(CONTINUATION_DEPTH * lattice.sigma_px, 0.5 * (side - 1))
        node = np.round(np.clip(at, depth, side - 1 - depth) / pitch).astype(np.intp)
        node = np.minimum(node, int((side - 1) / pitch))
        sides.append((node, (at - node * pitch).astype(np.float32)))
    (node_y, dy), (node_x, dx) = sides
    wy, wx = waves.frequencies
    cyy, cxx, cxy = waves.hessian
    for rows, columns in ((slice(h, None), slice(None)), (slice(0, h), slice(w, None))):
        nodes = np.ix_(node_y[rows], node_x[columns])
        y, x = dy[rows][:, None], dx[columns][None, :]
        phase = wy[nodes] * y + wx[nodes] * x
        phase = phase + 0.5 * (cyy[nodes] * y * y + cxx[nodes] * x * x) + cxy[nodes] * y * x
        padded[rows, columns] = waves.phasor[nodes] * np.exp(1j * phase)
    return padded


def _strongest_waves(lattice: Lattice, padded: Analytic) -> tuple[Analytic, MapsYX, MapsYX]:
    """Find the largest coefficient at every lattice point.

    Returns the coefficient, the frequency of the peak, and the distance of the peak from the
    coefficient's own frequency, both along (y, x), rad/px.
    """
    # Undo the demodulation by whole bins, so that the phase is that of the lattice point.
    columns = np.stack([shift_wave(first, lattice.x.samples) for first in lattice.x.first])
    inside = lattice.inside
    stacks = []
    for first, spectra in zip(lattice.y.first, lattice.spectra(padded), strict=True):
        rows = shift_wave(first, lattice.y.samples)
        shifted = spectra * rows[None, :, None] * columns[:, None, :]
        stacks.append(shifted[:, : inside[0], : inside[1]])
    value, j, i, dj, di = strongest(np.stack(stacks))
    steps = [float(np.diff(axis.frequencies[:2])[0]) for axis in (lattice.y, lattice.x)]
    offsets = (dj * steps[0], di * steps[1])
    frequencies = (
        lattice.y.frequencies[j] + offsets[0],
        lattice.x.frequencies[i] + offsets[1],
    )
    return value, frequencies, offsets
