"""The findings of the judgement: what was seen, the likely causes, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.frame_motion import by_motion, steadily
from fringeworks.stack.kernel_settings import MIN_SNR, Decoding, Limits, PhaseFrames
from fringeworks.stack.real_frames import RealFrames
from fringeworks.stack.shifts import step_errors
from fringeworks.stack.step_convention import Convention
from fringeworks.stack.unmeasured import BEYOND_PROJECTOR, LARGE_SHARE
from fringeworks.statistics.phase_errors import PhaseErrors
from fringeworks.types import Axis, CameraNoise, Finding
from fringeworks.types.finding import MOVING
from fringeworks.types.numbers import percent

OF_LIGHT = 2.0
"""Errors of the steps, rad, over changes of the light, from which on they are none of these. Light
that changes turned the steps of simulated stacks by 0.7 to 1.2 of its share; wrong steps changed
the light by a twentieth of theirs at most."""

OF_STEADY_LIGHT = 5.0
"""The same for light that changes steadily: lines turn by up to 2.4 of its share."""

LEFT_BY_LIGHT = 0.5
"""Share of the errors of the steps that other light leaves from which on it is not their cause: it
leaves their noise where it is, and all of them where steps are wrong."""

NOTABLE_DEG = 0.3
"""Error of a phase step from which on it is reported as one, degrees. Empirical."""

NOTABLE_RIPPLE_RAD = 0.02
"""Ripple of a response from which on it is reported, rad rms: γ of 1.1 makes it in three steps."""

NOTABLE_GAIN = 0.003
"""Change of the light from frame to frame from which on it is reported as one. Empirical."""

SHARP_LINES = "lines that the camera sees sharper than their steps"
"""Cause of the ripple of lines."""

NO_GAIN = 5e-5
"""Shot noise over the noise floor below which it is none, 1/count. The floor is this share of the
largest count or more (``ARITHMETIC_ERROR``), so that the variance of shot noise is below floor²."""


def noise(found: CameraNoise, source: str, floor: float) -> Finding:
    """The measured noise; below the floor in counts, that the frames show none."""
    if found.read_counts < floor and found.gain < NO_GAIN * floor:
        seen = f"the frames show no noise above {floor:.2g} counts, the least that is assumed"
        causes = ("rendered, averaged or denoised frames",)
        figures = {"read_counts": found.read_counts, "gain": 0.0, "least_counts": floor}
        return Finding("noise", seen, causes, figures=figures, severity="note")
    shot = f", {found.gain:.3g} counts² per count" if found.gain else ""
    figures = {"read_counts": found.read_counts, "gain": found.gain}
    seen = f"noise of {found.read_counts:.3g} counts{shot}, from {source}"
    return Finding("noise", seen, figures=figures, severity="note")


def saturated(
    points: Sequence[NDArray[Any]],
    limits: Limits,
    camera_noise: CameraNoise,
    labels: list[str],
    known: bool,
) -> list[Finding]:
    """Pixels that reach the sensor's limit; nothing where few do and the limit is ``known``."""
    values = np.concatenate(points)
    values = values[:, np.isfinite(values).all(axis=0)].astype(np.float32)
    high, low = values.max(axis=0, initial=0.0), values.min(axis=0, initial=np.inf)
    reaching = high >= limits.saturation
    swing = 2.0 * MIN_SNR * np.sqrt(camera_noise.variance(low))
    lit = reaching | (high - low > swing)
    share = float(reaching.sum() / max(lit.sum(), 1))
    many = share > LARGE_SHARE
    if not reaching.any() or (known and not many):
        return []
    counts = f"{limits.saturation:.{0 if limits.saturation >= 100.0 else 3}f}"
    most = labels[int(np.argmax((values >= limits.saturation).sum(axis=1)))]
    return [
        Finding(
            "saturated",
            f"{share:.0%} of the lit pixels reach {counts} counts, from which on the sensor "
            f"saturates, most of them in frame {most}; these samples are left out",
            ("the exposure is too long", "highlights on a glossy surface") if many else (),
            "shorten the exposure, or take several exposures" if many else "",
            frames=(most,),
            figures={"share": share, "counts": limits.saturation},
            severity="warning" if many else "note",
        )
    ]


def unresolved(planned: Decoding, found: Decoding, labels: list[str]) -> list[Finding]:
    """The finest bits of a Gray code that the camera does not resolve; nothing where it does."""
    if planned.gray is None or found.gray is None:
        return []
    count = len(planned.gray.bits) - len(found.gray.bits)
    if count == 0:
        return []
    frames = tuple(labels[k] for k in (*planned.gray.bits, *planned.gray.inverse))
    kept = {labels[k] for k in (*found.gray.bits, *found.gray.inverse)}
    named = tuple(name for name in frames if name not in kept)
    bits = "bit" if count == 1 else f"{count} bits"
    effect = (
        "the fringes are told apart by the other bits"
        if planned.sets
        else "σ there is that of the cells that each pixel resolves"
    )
    return [
        Finding(
            "resolution",
            f"the camera does not resolve the finest {bits} of the Gray code along {planned.axis} "
            f"({', '.join(named)}): {effect}",
            causes=("stripes narrower than the pixels or the blur of camera and projector",),
            advice=f"cells of {found.gray.step_px:g} px are as good and take fewer frames",
            axis=planned.axis,
            frames=named,
            figures={"unresolved_bits": count, "resolved_px": found.gray.step_px},
            severity="note",
        )
    ]


def beyond_projector(found: Decoding, plan: PatternPlan) -> list[Finding]:
    """Cells of a Gray code that lie beyond the plan's projector; nothing where there are few."""
    gray, planned = found.gray, plan.gray_code(found.axis)
    if gray is None or planned is None or gray.farthest_px == 0.0:
        return []
    step = planned[1].step_px
    sizes = {"x": plan.width_px, "y": plan.height_px}
    size = sizes.pop(found.axis)
    (other,) = sizes.values()
    name = "columns" if found.axis == "x" else "rows"
    # In the plan's cells, the projector ends at the farthest one at the earliest.
    narrower = step * size / gray.farthest_px
    causes = [
        "another size of the projector than in the plan",
        f"cells of {narrower:.3g} px or less where the plan says step_px = {step:g}",
    ]
    if size < gray.farthest_px <= other + gray.step_px:
        causes.insert(0, "width and height of the projector exchanged in the plan")
    return [
        Finding(
            BEYOND_PROJECTOR,
            f"{percent(gray.beyond_share)} of the codes along {found.axis} lie beyond {size} px, "
            f"where the plan's projector ends: they show {name} up to {gray.farthest_px:.0f} px",
            causes=tuple(causes),
            advice="correct the size of the projector or its Gray code in the plan",
            axis=found.axis,
            figures={"farthest_px": gray.farthest_px, "share": gray.beyond_share},
        )
    ]


def flat_in_words(phases: PhaseFrames, axis: Axis) -> str:
    """A set whose fringes are blurred."""
    return (
        f"the fringes of {phases.period_px:.6g} px along {axis} hardly change the light of the "
        "pixels: they are blurred"
    )


def flat(phases: PhaseFrames, axis: Axis) -> Finding:
    """The finding about such a set, in a stack that can be decoded."""
    return Finding(
        "blur",
        flat_in_words(phases, axis),
        ("a camera or a projector out of focus", "fringes too fine for the camera"),
        "focus both, or use wider fringes",
        axis,
        figures={"period_px": phases.period_px},
    )


def apart(axis: Axis, found: Convention) -> Finding:
    """Fringes that do not lie where the Gray code says."""
    px = abs(found.offset_px)
    return Finding(
        "fringes beside the code",
        f"the fringes along {axis} lie {px:.2g} px from where the borders of the Gray code have "
        f"them (their phase at coordinate 0 is {360.0 * found.start_turns:.1f}°, expected 0°); "
        "coordinates may be off by as much, and σ contains it",
        causes=(
            "columns or rows that are counted from 1, or from pixel corners, where patterns are "
            "made",
            "steps that start elsewhere than the plan says",
            "a Gray code with another offset than the plan's",
            "a scene or a camera that moved between the code and the fringes",
        ),
        advice="state the shifts of the steps and the offset of the code as the patterns have them",
        axis=axis,
        figures={"offset_px": found.offset_px, "start_deg": 360.0 * found.start_turns},
    )


def bent(axis: Axis, rms_px: float) -> Finding:
    """Fringes that lie beside the Gray code by other distances at every phase and line."""
    return Finding(
        "fringes beside the code",
        f"the fringes along {axis} lie {rms_px:.2g} px rms beside where the cells of the Gray code "
        "have them, differently from line to line or within a fringe; σ contains it",
        causes=(
            "light that changes from row to row, as of a lamp under a rolling shutter",
            "a response that is not linear (γ)",
            "light between surfaces",
        ),
        advice="expose for whole periods of the light, or use more steps",
        axis=axis,
        figures={"rms_px": rms_px},
    )


def real_frames(phases: PhaseFrames, axis: Axis, labels: list[str], moved: float) -> Finding | None:
    """Steps and gains that differ from the plan; None where they hardly do.

    ``moved`` is positive where the paint moved with the fringes, negative where it did not.
    """
    if not phases.design or phases.unsure:
        return None
    found = RealFrames(np.array(phases.design))
    planned = np.asarray(phases.shifts_rad)
    off = np.degrees(step_errors(found.shifts_rad, planned))
    light, fringe = found.light_gains - 1.0, found.fringe_gains - 1.0
    largest = float(np.abs(off).max())
    if largest < NOTABLE_DEG and np.abs(light).max() < NOTABLE_GAIN:
        return None
    steps = (
        f"steps of {phases.period_px:g} px along {axis}: "
        f"{', '.join(f'{d:.1f}' for d in np.degrees(planned) + off)}°, "
        f"off by up to {largest:.1f}°"
    )
    named = tuple(labels[k] for k in phases.frames)
    most = int(np.argmax(np.abs(light)))
    share = f"{100 * np.abs(light[most]):.1f} %"
    gains = f"light of {named[most]} differs from the mean by {share}, that of the others by less"
    figures = {
        "largest_step_error_deg": largest,
        "largest_light_change": float(np.abs(light).max()),
        "largest_fringe_change": float(np.abs(fringe).max()),
    }
    seen = f"{steps}, {gains}; taken into account"
    by_light = np.radians(largest) < np.abs(light).max() * (
        OF_STEADY_LIGHT if steadily(light) else OF_LIGHT
    )
    other = np.degrees(step_errors(found.shifts_under_other_light_rad, planned))
    if not by_light and np.abs(other).max() > LEFT_BY_LIGHT * largest:
        kind, causes, advice = _turned_frames(moved, np.radians(off))
        return Finding(kind, seen, causes, advice, axis, named, figures)
    causes = ("flicker of the projector against the exposure", "a change of the light in the room")
    causes = causes[::-1] if steadily(light) else causes
    advice = "expose for whole periods of the projector's refresh, and keep the light constant"
    return Finding("flicker", seen, causes, advice, axis, named, figures)


def offsets(phases: PhaseFrames, axis: Axis, labels: list[str]) -> Finding | None:
    """Light that is the same at all pixels and differs between frames; None where there is none."""
    if not phases.offsets:
        return None
    named = tuple(labels[k] for k in phases.frames)
    most = int(np.argmax(np.abs(phases.offsets)))
    return Finding(
        "flicker",
        f"frames of {phases.period_px:g} px along {axis} differ by the same counts at all pixels, "
        f"{named[most]} by {phases.offsets[most]:.1f}, the others by less; subtracted",
        causes=("a change of the light in the room", "a black level of the camera that drifts"),
        advice="keep the light of the room constant, and away from the lens",
        axis=axis,
        frames=named,
        figures={"largest_offset_counts": float(np.abs(phases.offsets).max())},
    )


def _turned_frames(moved: float, off_rad: NDArray[np.float64]) -> tuple[str, tuple[str, ...], str]:
    """Kind, causes and advice where the phases of frames are turned."""
    rest = "keep the scene and the devices at rest, or take the frames faster"
    causes: tuple[str, ...]
    if by_motion(moved, off_rad):
        causes = ("vibration or motion during the capture", "wrong steps of the projector")
        return "motion", causes[:1] if moved > 0.0 else causes, rest
    notable = np.degrees(np.abs(off_rad).max()) > NOTABLE_DEG
    if moved == 0.0 and notable and steadily(off_rad):
        causes = ("motion during the capture", "a step that is wrong by the same amount each time")
        return "motion", causes, rest
    causes = ("wrong steps of the projector", "vibration", "a response that is not linear")
    causes = causes if moved == 0.0 else causes[::2]
    advice = "check the patterns that are really shown and the mounts of the devices"
    return "steps", causes, advice


def moving_scene(words: str) -> Finding:
    """A camera or a scene that moves all the time, and frames that decode all the same."""
    return Finding(
        MOVING,
        f"{words}, judging by how all frames agree",
        advice="keep the scene and the devices at rest, or take the frames faster",
    )


def moved_pairs(axis: Axis, apart_px: float, pull_px: float) -> Finding:
    """Bits and inverses that show the scene at different places."""
    seen = (
        f"frames of the Gray code along {axis} lie {apart_px:.2g} camera px rms beside each "
        "other, by the borders of its cells; standard deviations contain it"
    )
    causes = ("vibration or motion during the capture",)
    advice = "keep the scene and the devices at rest, or take the frames faster"
    figures = {"apart_px": apart_px, "coordinate_px": pull_px}
    return Finding("motion", seen, causes, advice, axis, figures=figures)


def ripple(
    harmonics: dict[int, complex], phases: PhaseFrames, axis: Axis, rms_rad: float
) -> Finding:
    """Ripple of the phase that stays in the result; one of the harmonics at least is not zero."""
    steps = len(phases.frames)
    largest = max(harmonics, key=lambda k: abs(harmonics[k]))
    pixels = rms_rad * phases.period_px / TURN
    seen = (
        f"ripple of {rms_rad:.3f} rad rms ({pixels:.2g} px), {largest} per fringe, in the phases "
        f"of {phases.period_px:g} px along {axis}; added to the standard deviations"
    )
    figures = {"rms_rad": rms_rad, "per_fringe": float(largest)}
    causes: tuple[str, ...]
    if phases.line_px is not None:
        causes, advice = (SHARP_LINES,), "use narrower lines and steps, or a softer focus"
    elif largest % steps == 0 or largest >= 3:
        causes = ("a response of projector and camera that is not linear (γ)", "saturated samples")
        advice = "correct the patterns for γ, measure the response, or use more steps"
    else:
        causes = ("wrong steps", "flicker or a change of the light between frames")
        advice = "estimate the real steps"
    return Finding("ripple", seen, causes, advice, axis, (), figures)


def own_response(planned: Decoding, found: Decoding) -> list[Finding]:
    """A response that was measured from the fringes and subtracted; nothing where there is none."""
    changed = [
        s for p, s in zip(planned.sets, found.sets, strict=True) if s.table_turns != p.table_turns
    ]
    rms = [float(np.std(s.table_turns)) * TURN for s in changed]
    if not rms or max(rms) < NOTABLE_RIPPLE_RAD:
        return []
    periods = ", ".join(f"{s.period_px:g}" for s in changed)
    steps = len(changed[int(np.argmax(rms))].frames)
    if any(s.line_px is not None for s in changed):
        seen = f"ripple of {max(rms):.3f} rad rms in the phases of {periods} px along {found.axis}"
        figures = {"rms_rad": max(rms), "per_fringe": float(steps)}
        seen = f"{seen}, {steps} per fringe, measured and subtracted"
        return [Finding("ripple", seen, (SHARP_LINES,), "", found.axis, (), figures, "note")]
    return [
        Finding(
            "response",
            f"the response is not linear: ripple of {max(rms):.3f} rad rms, {steps} per fringe, in "
            f"the phases of {periods} px along {found.axis}, measured and subtracted",
            causes=(
                "a response of projector and camera that is not linear (γ)",
                "saturated samples",
            ),
            advice="correct the patterns for γ, or use more steps",
            axis=found.axis,
            figures={"rms_rad": max(rms), "per_fringe": float(steps)},
            severity="warning",
        )
    ]


def disagreement(errors: PhaseErrors, axis: Axis) -> Finding:
    """Sets that disagree by more than the noise."""
    seen = f"phases along {axis} disagree by {errors.ratio**0.5:.1f} times their noise"
    if errors.noise_factor > 1.0:
        seen += f": noise {errors.noise_factor**0.5:.1f} times that of the camera"
    if errors.floor_rad > 0.0:
        seen += f", phase errors of {errors.floor_rad:.3f} rad that do not depend on brightness"
    if errors.offset_turns > 0.0:
        seen += ", and are shifted against each other so far that fringe orders are not certain"
    figures = {
        "ratio": errors.ratio,
        "noise_factor": errors.noise_factor,
        "floor_rad": errors.floor_rad,
    }
    causes = (
        "motion or vibration between the sets",
        "a response that is not linear (γ)",
        "light between surfaces",
    )
    advice = "standard deviations contain it"
    return Finding("disagreement", seen, causes, advice, axis, (), figures)


def correlated_noise(factor: float, axis: Axis) -> Finding:
    """Phases along smooth lines that are noisier than the noise of the camera."""
    seen = (
        f"phases along {axis} scatter {factor**0.5:.1f} times as much along smooth lines as the "
        "noise of the camera explains; standard deviations are raised by this factor"
    )
    causes = (
        "lossy compression or smoothing in the camera",
        "frames that hold a part of the next one",
        "a surface that is rough everywhere",
    )
    advice = "store frames without loss and leave the projector time to change"
    return Finding("correlated noise", seen, causes, advice, axis, (), {"factor": factor})


def pixel_grid(axis: Axis, rms_px: float) -> Finding:
    """Coordinates that are pulled to the middles of the projector's pixels."""
    seen = (
        f"coordinates along {axis} are off by {rms_px:.2g} px rms, alike on every projector pixel; "
        "standard deviations contain it"
    )
    causes = ("a camera that resolves the projector's pixels, or sees their grid as moiré",)
    advice = (
        "defocus the projector by about half of its pixels, or change the distance or the "
        "camera's magnification"
    )
    return Finding("pixel grid", seen, causes, advice, axis, figures={"pull_px": rms_px})


def scatter(axis: Axis) -> Finding:
    """Coordinates that differ from their neighbours by more than their standard deviations."""
    seen = (
        f"coordinates along {axis} differ from their neighbours by more than their standard "
        "deviations, in places at least; standard deviations there are raised to cover it"
    )
    causes = (
        "lossy compression",
        "light that the lens mixes at printed edges",
        "vibration",
        "a surface that is rough from pixel to pixel",
    )
    advice = "store frames without loss, focus the camera, and keep everything at rest"
    return Finding("scatter", seen, causes, advice, axis)
