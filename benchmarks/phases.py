"""Demodulation, unwrapping and decomposition."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.harness import Result, against, peer_module, rows, work
from benchmarks.peers import cwt_fcwt_rows, cwt_scipy, fourier_scipy_rows, wff_scipy
from fringeworks import unwrap
from fringeworks.pair import wavelet_frequencies, wavelet_ridge, windowed_fourier_filter
from fringeworks.pair.bandpass import band_pass
from fringeworks.signal.denoise import decompose_rows

TURN = 2.0 * np.pi


def hill(n: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A phase with a gradient of up to 0.6 rad/px in noise, and what is left of it wrapped."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:n, :n].astype(float)
    bump = np.exp(-((x - 0.5 * n) ** 2 + (y - 0.5 * n) ** 2) / (0.08 * n**2))
    truth = 0.3 * x + 0.1 * y + 0.1 * n * bump + noise * rng.standard_normal(x.shape)
    return truth, np.angle(np.exp(1j * truth)).astype(np.float32)


def wrong_share(truth: np.ndarray):
    """Share of pixels that are off by turns."""

    def measure(phase: np.ndarray) -> float:
        order = np.round((phase - truth) / TURN)
        return float(np.mean(order != np.median(order)))

    return measure


def unwrapped(
    n: int, noise: float, peer: str, package: str, theirs: Callable[..., np.ndarray], **limits: Any
) -> Result:
    """``unwrap`` against another solver of the same map."""
    truth, wrapped = hill(n, noise)
    return against(
        f"unwrap {n} x {n}, noise {noise} rad",
        peer,
        version(package),
        lambda: unwrap(wrapped).phase,
        lambda: theirs(wrapped),
        wrong_share(truth),
        repeats=3,
        **limits,
    )


@work
def unwrap_2048() -> list[Result]:
    """Sorting by reliability against scikit-image, noise 0.3 rad."""
    other = peer_module("skimage.restoration").unwrap_phase
    limits = {"limit_ratio": 6.0, "limit_accuracy": 0.0}
    name = "scikit-image unwrap_phase"
    return [unwrapped(2048, 0.3, name, "scikit-image", lambda w: np.asarray(other(w)), **limits)]


@work
def unwrap_noisy() -> list[Result]:
    """The guided solver against kamui, noise 0.8 rad."""
    other = peer_module("kamui").unwrap_dimensional
    limits = {"limit_ratio": 15.0, "limit_accuracy": 2e-4}
    name = "kamui unwrap_dimensional"
    return [
        unwrapped(n, 0.8, name, "kamui", lambda w: np.asarray(other(w)), **limits)
        for n in (1024, 2048)
    ]


@work
def unwrap_radar() -> list[Result]:
    """The guided solver against two solvers of radar interferograms, noise 0.8 rad."""

    def field(wrapped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.exp(1j * wrapped).astype(np.complex64), np.full(wrapped.shape, 0.8, np.float32)

    def snaphu() -> Result:
        solver = peer_module("snaphu")

        def theirs(wrapped: np.ndarray) -> np.ndarray:
            with silent():
                return np.asarray(solver.unwrap(*field(wrapped), nlooks=1.0)[0])

        return unwrapped(512, 0.8, "SNAPHU, smooth, MCF", "snaphu", theirs)

    def whirlwind() -> Result:
        solver = peer_module("whirlwind")

        def theirs(wrapped: np.ndarray) -> np.ndarray:
            return np.asarray(solver.unwrap(*field(wrapped), 1.0)[0])

        return unwrapped(1024, 0.8, "whirlwind", "whirlwind-insar", theirs)

    return rows(snaphu, whirlwind)


@contextmanager
def silent() -> Iterator[None]:
    """Keep what a program in C prints off the screen."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def phase_rms(truth: np.ndarray, border: int):
    """Root mean square phase error inside a border, rad."""
    inner = (slice(border, -border), slice(border, -border))

    def measure(phasor: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.angle(phasor * np.exp(-1j * truth))[inner] ** 2)))

    return measure


@work
def windowed_fourier_512() -> list[Result]:
    """WFF on the field of four noisy frames of a quadratic phase; accuracy 20 px off the border."""
    n = 512
    y, x = np.mgrid[:n, :n] - n / 2
    truth = 0.5 * 0.0018 * (x**2 + y**2)
    results = []
    for noise, limit in ((0.3, 0.016), (1.0, 0.0385)):
        rng = np.random.default_rng(0)
        frames = [
            np.cos(truth - k * np.pi / 2) + noise * rng.standard_normal((n, n)) for k in range(4)
        ]
        field = (0.5 * (frames[0] - frames[2] + 1j * (frames[1] - frames[3]))).astype(np.complex64)
        results.append(
            against(
                f"WFF 512 x 512, sigma 10, noise {noise}",
                "complex64 scipy.fft, hard threshold 3 sigma",
                version("scipy"),
                lambda field=field: windowed_fourier_filter(field),
                lambda field=field, noise=noise: wff_scipy(field, threshold=3 * noise),
                phase_rms(truth, 20),
                limit_ratio=5.0,
                limit_accuracy=limit,
            )
        )
    return results


@work
def wavelet_512() -> list[Result]:
    """Ridge phase over 32 scales of 512 rows; accuracy 16 px off the border."""
    n = 512
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:n, :n].astype(float)
    truth = TURN * x / 16 + 6 * np.exp(-((x - 256) ** 2 + (y - 256) ** 2) / (2 * 80.0**2))
    frame = (np.cos(truth) + 0.1 * rng.standard_normal(x.shape)).astype(np.float32)
    frequencies = wavelet_frequencies(1 / 16, 32, 1.8)

    def against_peer(peer: str, module: str, theirs: Callable[..., np.ndarray]) -> Result:
        peer_module(module)
        return against(
            "CWT ridge 512 x 512 x 32",
            peer,
            version(module),
            lambda: wavelet_ridge(frame, frequencies=frequencies)[0],
            lambda: theirs(frame, frequencies),
            phase_rms(truth, 16),
            limit_ratio=2.0,
            limit_accuracy=0.028,
        )

    return rows(
        lambda: against_peer("scipy.fft, 2 workers", "scipy", cwt_scipy),
        lambda: against_peer("fCWT by rows, 2 threads", "fcwt", cwt_fcwt_rows),
    )


@work
def fourier_2048() -> list[Result]:
    """Wrapped phase difference of a pair by band-pass along the rows."""
    n, period = 2048, 16.0
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:n, :n].astype(float)
    truth = 8.0 * np.exp(-((x - n / 2) ** 2 + (y - n / 2) ** 2) / (2 * 300.0**2))
    frames = [
        100 + 60 * np.cos(TURN * x / period - phase) + 2 * rng.standard_normal((n, n))
        for phase in (0.0, truth)
    ]

    def ours(dimensions: int) -> np.ndarray:
        a, b = (band_pass(f, (1 / period, 0.0), dimensions=dimensions)[0] for f in frames)
        return a * np.conj(b)

    def theirs() -> np.ndarray:
        return fourier_scipy_rows(*frames, period)

    return [
        against(
            f"FTP pair 2048 x 2048, {dimensions}-D",
            "scipy.fft by rows, 2 workers",
            version("scipy"),
            lambda dimensions=dimensions: ours(dimensions),
            theirs,
            phase_rms(truth, 20),
            limit_ratio=2.0 if dimensions == 1 else None,
            limit_accuracy=0.02,
        )
        for dimensions in (1, 2)
    ]


@work
def emd_rows() -> list[Result]:
    """All modes of fringe rows; the peer's time is that of one row in eight, times eight."""
    rng = np.random.default_rng(0)
    x = np.arange(1024)
    wave = np.cos(TURN * x / 25 + 3 * np.exp(-(((x - 512) / 150) ** 2)))
    frame = 127 + 100 * np.linspace(0.6, 1, 512)[:, None] * wave + 20 * np.sin(x / 300)
    frame += 2 * rng.standard_normal(frame.shape)
    few = frame[::8]
    emd = peer_module("emd")

    def theirs() -> list[np.ndarray]:
        return [emd.sift.sift(row).T for row in few]

    def off(found) -> float:
        if isinstance(found, list):
            sums, expected = np.array([imfs.sum(axis=0) for imfs in found]), few
        else:
            sums, expected = found.imfs.sum(axis=1) + found.residue, frame
        return float(np.abs(sums - expected).max() / np.abs(frame).max())

    # The peer stops by Huang's standard deviation alone, at 0.1: the mean's energy over the mode's.
    rules = {
        "the peer's stopping rule": {"flat": 0.1**0.5, "patience": 0},
        "both criteria": {},
    }
    results = []
    for name, options in rules.items():
        result = against(
            f"EMD 512 x 1024, all IMFs, {name}",
            "emd.sift.sift",
            version("emd"),
            lambda options=options: decompose_rows(frame, **options),
            theirs,
            off,
            limit_accuracy=1e-12,
        )
        assert result.peer_seconds is not None
        assert result.ratio is not None
        assert result.spread is not None
        low, high = result.spread
        results.append(
            replace(
                result,
                peer_seconds=8 * result.peer_seconds,
                ratio=8 * result.ratio,
                spread=(8 * low, 8 * high),
                limit_ratio=50.0,
            )
        )
    return results
