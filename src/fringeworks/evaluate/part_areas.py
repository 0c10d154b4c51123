"""The areas of a part, measured once, and the tolerances that are measured on them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from typing import TypeVar

import numpy as np

from fringeworks.evaluate.area_points import AreaPoints, area_points
from fringeworks.evaluate.blur_doubt import with_blur_doubt
from fringeworks.evaluate.budget import Budget, budget_of, scales_of
from fringeworks.evaluate.deviation import Deviation, deviation
from fringeworks.evaluate.measured_part import named_model
from fringeworks.evaluate.monte_carlo import MonteCarlo, draw_quantity, draw_zone, monte_carlo_of
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.quantities import MEASURED, area_deviation
from fringeworks.evaluate.tolerances.even_range import EVEN, even_range
from fringeworks.evaluate.tolerances.measure import prepared
from fringeworks.evaluate.tolerances.skins import Skin
from fringeworks.evaluate.tolerances.uncertain import Value, quantified
from fringeworks.types import (
    Area,
    BoolMap,
    FloatMap,
    HeightMap,
    InputError,
    PartTolerance,
    PointCloud,
    Recipe,
    Rig,
    face_named,
    sealed,
)
from fringeworks.types.recipe import CHARACTERISTICS, FROM_MODEL

Known = TypeVar("Known")


class PartAreas:
    """The areas of a recipe on a surface; each is measured when it is needed first."""

    def __init__(self, surface: HeightMap | PointCloud, recipe: Recipe, rig: Rig | None) -> None:
        self.surface = with_blur_doubt(surface, rig, _wanted(surface, recipe))
        self.recipe = recipe
        # The errors of a rig show in points alone.
        self.rig = rig if isinstance(surface, PointCloud) else None
        self.scales = scales_of(recipe.uncertainty)
        self.of_area = kept(self._points)
        """The points of an area, by its name."""
        self.of_model = kept(self._distances)
        """The same, with their distances from the model."""
        self._against = kept(self._deviation)
        self.area_of = kept(self._area)
        """An area by its name; of a face, its pixels."""
        self._check_faces()

    def _check_faces(self) -> None:
        """Refuse faces that the model does not have, before anything is measured."""
        wanted = {name: area.face for name, area in self.recipe.areas.items() if area.face}
        if wanted and self.recipe.model is not None:
            model = named_model(self.recipe.model.mesh)[0]
            for name, face in wanted.items():
                try:
                    face_named(model.nominal, face)
                except InputError as problem:
                    raise problem.at(name) from problem

    def _area(self, name: str) -> Area:
        area = self.recipe.areas[name]
        if area.face is None:
            return area
        found = self._against("")
        if found.face is None or found.face.ndim != 2:
            raise InputError(f"face {area.face!r}: expected a point cloud of a camera, got others")
        number = face_named(found.model.nominal, area.face).number
        return Area(mask=sealed(found.face == number))

    def faces_found(self) -> dict[str, Area]:
        """Return the pixels of the areas that are faces of the model, where they were found."""
        found = {}
        for name, area in self.recipe.areas.items():
            if area.face is not None:
                with suppress(InputError):
                    found[name] = self.area_of(name)
        return found

    def _points(self, name: str) -> AreaPoints:
        return area_points(self.surface, self.area_of(name), self.rig, scales=self.scales)

    def _distances(self, name: str) -> AreaPoints:
        area = self.area_of(name)
        return area_deviation(self._against(""), area, self.rig, scales=self.scales)

    def _deviation(self, _: str) -> Deviation:
        if not isinstance(self.surface, PointCloud):
            raise InputError(
                "deviation: expected a point cloud, got heights: give the recipe a rig"
            )
        one = self.recipe.model
        assert one is not None
        return deviation(
            self.surface, one.mesh, align=one.align, rig=self.rig, reach_mm=one.reach_mm
        )

    def _of(self, one: PartTolerance) -> dict[str, AreaPoints]:
        """The areas that a tolerance is measured on, without those of its datums."""
        named = self.of_model if one.quantity in FROM_MODEL else self.of_area
        return {name: named(name) for name in one.areas}

    def measure(self, one: PartTolerance) -> Quantified:
        """Measure the quantity of a tolerance.

        Raises
        ------
        InputError where it cannot be measured.
        """
        zone = self._zone(one)
        if zone is not None:
            return quantified(*zone)
        return MEASURED[one.quantity](*self._of(one).values())

    def _zone(self, one: PartTolerance) -> tuple[Value, list[Skin]] | None:
        """The quantity as a function of its surfaces; None where it is one of points."""
        if one.quantity in CHARACTERISTICS:
            return prepared(one, self.recipe, self.of_area, self.of_model)
        return even_range(one, self.of_area) if one.quantity in EVEN else None

    def budget(self, one: PartTolerance, found: Quantified) -> Budget:
        """Return the uncertainty budget of a quantity that was measured."""
        datums = [self.recipe.datums[name].areas for name in one.zone.datums]
        areas = [*self._of(one).values(), *(self.of_area(n) for names in datums for n in names)]
        return budget_of(found, areas, self.recipe.uncertainty)

    def monte_carlo(
        self, one: PartTolerance, found: Quantified, budget: Budget, *, draws: int
    ) -> MonteCarlo:
        """Return what Monte Carlo makes of a quantity that was measured."""
        zone = self._zone(one)

        def draw(count: int, random: np.random.Generator) -> FloatMap:
            if zone is not None:
                return draw_zone(*zone, count, random)
            areas = self._of(one)
            return draw_quantity(one.quantity, areas, count, random, freed=found.noise > 0)

        return monte_carlo_of(draw, found, budget, draws=draws, seed=0, recentred=zone is not None)


def _wanted(surface: HeightMap | PointCloud, recipe: Recipe) -> BoolMap | None:
    """The pixels of all areas; None where all of the surface is brought to a model."""
    if recipe.model is not None:
        return None
    wanted: BoolMap = np.zeros(surface.shape, bool)
    for area in recipe.areas.values():
        # An area that is not in the frame is named when it is measured.
        with suppress(InputError):
            wanted |= area.pixels(surface.shape)
    return wanted


def kept(compute: Callable[[str], Known]) -> Callable[[str], Known]:
    """Return a function that computes what is known of each name once.

    A problem is raised each time, and names the area.
    """
    known: dict[str, Known | InputError] = {}
    every, locks = Lock(), dict[str, Lock]()

    def once(name: str) -> Known:
        with every:
            own = locks.setdefault(name, Lock())
        with own:
            if name not in known:
                try:
                    known[name] = compute(name)
                except InputError as problem:
                    known[name] = problem
            found = known[name]
        if isinstance(found, InputError):
            raise found.at(name) if name else found
        return found

    return once
