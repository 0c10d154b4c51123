"""Tolerances of a recipe: which features, lines, datums and zone each characteristic has."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from fringeworks.evaluate.area_points import AreaPoints
from fringeworks.evaluate.quantities import AreaDeviation
from fringeworks.evaluate.tolerances.bodies import Body
from fringeworks.evaluate.tolerances.datums import DatumFeature, System, system
from fringeworks.evaluate.tolerances.skins import (
    Lines,
    Skin,
    median_skin,
    skin,
    skin_of_model,
)
from fringeworks.evaluate.tolerances.uncertain import Value
from fringeworks.evaluate.tolerances.zones import (
    Feature,
    form,
    location,
    orientation,
    profile,
    run_out,
)
from fringeworks.types import Datum, FloatMap, PartTolerance, Recipe, ToleranceZone

Points = Callable[[str], AreaPoints]
"""The measured points of an area of the recipe."""


@dataclass(frozen=True)
class Judged:
    """A tolerance with what was measured for it, its datums as they are or might be."""

    zone: ToleranceZone
    part: Feature
    datums: System


def _oriented(usual_deg: float | None) -> Callable[[Judged], float]:
    def measured(one: Judged) -> float:
        angle = one.zone.angle_deg if usual_deg is None else usual_deg
        assert angle is not None
        way = None if one.zone.direction is None else np.array(one.zone.direction, float)
        return orientation(one.part, one.datums, angle, way)

    return measured


def _position(one: Judged) -> float:
    direction = np.array((0.0, 0.0, 1.0) if one.zone.direction is None else one.zone.direction)
    exact = one.datums.placed(np.array(one.zone.at_mm, float), direction, one.part.body)
    return location(one.part, one.datums, exact)


def _on_datum(one: Judged) -> float:
    """Coaxiality, concentricity and symmetry: the exact place is the datum itself."""
    first = one.datums.bodies[0]
    return location(
        one.part, one.datums, replace(one.part.body, point=first.point, direction=first.direction)
    )


def _form(one: Judged) -> float:
    return form(one.part, one.zone.association)


def _profile(one: Judged) -> float:
    return profile(one.part)


def _run_out(one: Judged) -> float:
    return run_out(one.part, one.datums)


VALUES: Mapping[str, Callable[[Judged], float]] = MappingProxyType(
    {
        "iso_straightness": _form,
        "iso_flatness": _form,
        "iso_roundness": _form,
        "iso_cylindricity": _form,
        "iso_line_profile": _profile,
        "iso_surface_profile": _profile,
        "iso_parallelism": _oriented(0.0),
        "iso_perpendicularity": _oriented(90.0),
        "iso_angularity": _oriented(None),
        "iso_position": _position,
        "iso_concentricity": _on_datum,
        "iso_coaxiality": _on_datum,
        "iso_symmetry": _on_datum,
        "iso_circular_run_out": _run_out,
        "iso_total_run_out": _run_out,
    }
)
"""What measures each characteristic of ISO 1101."""
LINED = frozenset({"iso_straightness", "iso_roundness", "iso_line_profile", "iso_circular_run_out"})
"""Characteristics of lines."""
DERIVED = frozenset(
    {
        "iso_parallelism",
        "iso_perpendicularity",
        "iso_angularity",
        "iso_position",
        "iso_concentricity",
        "iso_coaxiality",
    }
)
"""Characteristics of the axis, where the feature is a cylinder."""


def prepared(
    tolerance: PartTolerance, recipe: Recipe, of_area: Points, of_model: Points
) -> tuple[Value, list[Skin]]:
    """Return a characteristic as a function of changes of its surfaces, and the surfaces.

    Raises
    ------
    InputError for features that the areas do not show, and datums that do not fit together.
    """
    zone = tolerance.zone
    datums = [recipe.datums[name] for name in zone.datums]
    groups = [_datum_skins(datum, of_area) for datum in datums]
    others = [one for group in groups for one in group]
    axis = groups[0][0].body if groups else None
    part = _feature(tolerance, axis, of_area, of_model)

    def value(changes: Sequence[FloatMap]) -> float:
        moved = [s.points(c) for s, c in zip(others, changes[1:], strict=True)]
        frame = _system(datums, groups, moved)
        return VALUES[tolerance.quantity](Judged(zone, Feature(part, changes[0]), frame))

    return value, [part, *others]


def _feature(
    tolerance: PartTolerance, axis: Body | None, of_area: Points, of_model: Points
) -> Skin:
    """The surface that is judged, in lines where the characteristic is one of lines."""
    name, zone = tolerance.quantity, tolerance.zone
    lines = _lines(name, zone, axis)
    if name in ("iso_line_profile", "iso_surface_profile"):
        part = of_model(tolerance.areas[0])
        assert isinstance(part, AreaDeviation)
        return skin_of_model(part, lines, free=not zone.located)
    areas = [of_area(area) for area in tolerance.areas]
    if name == "iso_symmetry":
        return median_skin(*areas)
    return skin(areas[0], zone.body, lines)


def _lines(name: str, zone: ToleranceZone, axis: Body | None) -> Lines | None:
    direction = None if zone.direction is None else np.array(zone.direction, float)
    if name == "iso_circular_run_out" and zone.body == "plane":
        assert axis is not None
        return Lines("around", centre=axis.point)
    if name in ("iso_straightness", "iso_line_profile"):
        return Lines("along", direction)
    if name in LINED or (name in DERIVED and zone.body == "cylinder"):
        return Lines("across")
    return None


def _datum_skins(datum: Datum, of_area: Points) -> list[Skin]:
    if datum.body == "median":
        one, other = datum.areas
        return [median_skin(of_area(one), of_area(other))]
    return [skin(of_area(area), datum.body) for area in datum.areas]


def _system(
    datums: Sequence[Datum], groups: Sequence[Sequence[Skin]], points: Sequence[FloatMap]
) -> System:
    """The datum system through points of the skins, in their order."""
    left = list(points)
    features, together = [], []
    for datum, group in zip(datums, groups, strict=True):
        own = [_at_radius(one, left.pop(0), group[0].body.radius) for one in group]
        weights = np.concatenate([one.weight for one in group])
        features.append(DatumFeature(group[0].body, datum.association, weights))
        together.append(np.concatenate(own))
    return system(features, together)


def _at_radius(one: Skin, points: FloatMap, radius: float) -> FloatMap:
    """The points as if their body had another radius: those of a common datum may have several."""
    return np.asarray(points + (radius - one.body.radius) * one.normal)
