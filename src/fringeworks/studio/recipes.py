"""The recipe in a studio's folder: areas and tolerances, which the command line reads as well."""

from __future__ import annotations

from dataclasses import replace

from fringeworks.files.recipe import read_recipe, write_recipe
from fringeworks.studio.tasks import Source
from fringeworks.studio.trash import Trash
from fringeworks.studio.workspace import NAME, NAME_RULE, Workspace
from fringeworks.types import Area, InputError, PartTolerance, Recipe


class RecipeKeeper:
    """Reads and changes the recipe in a folder; every change by a click can be undone."""

    def __init__(self, space: Workspace, trash: Trash) -> None:
        self._space, self._trash = space, trash

    @property
    def shown(self) -> Recipe:
        """The recipe in the folder; an empty one where there is none, or it cannot be read."""
        try:
            return self.read()
        except InputError:
            return Recipe()

    @property
    def fault(self) -> str:
        """Why the recipe in the folder cannot be read; empty where it can."""
        try:
            self.read()
        except InputError as problem:
            return str(problem)
        return ""

    def read(self) -> Recipe:
        """The recipe in the folder; an empty one where there is none.

        Raises
        ------
        FileProblem where it cannot be read.
        """
        path = self._space.recipe
        if path.is_file():
            return read_recipe(path)
        return Recipe(rig=self._space.rig if self._space.rig.is_file() else None)

    def set_area(self, name: str, area: Area) -> None:
        """Add an area."""
        if not NAME.fullmatch(name):
            raise InputError(f"area: expected {NAME_RULE}, got {name!r}")
        known = self.read()
        if name in known.areas:
            raise InputError(f"area: expected a new name, got {name!r}: delete that area first")
        self._edit(f"add {name}", replace(known, areas={**known.areas, name: area}))

    def move_area(self, name: str, area: Area) -> None:
        """Change where an area lies.

        Raises
        ------
        InputError for an area that is not there.
        """
        known = self.read()
        if name not in known.areas:
            raise InputError(f"{name}: expected an area of the recipe, got none")
        if known.areas[name] != area:
            moved = replace(known, areas={**known.areas, name: area})
            self._edit(f"change {name}", moved)

    def remove_area(self, name: str) -> None:
        """Delete an area, and the tolerances that are measured on it."""
        known = self.read()
        left = {key: area for key, area in known.areas.items() if key != name}
        kept = tuple(one for one in known.tolerances if name not in one.areas)
        within = None if known.within == name else known.within
        recipe = replace(known, areas=left, tolerances=kept, within=within)
        self._edit(f"delete {name}", recipe)

    def confine(self, name: str | None) -> None:
        """Measure only within an area, or everywhere."""
        self._edit(f"measure {name or 'everywhere'}", replace(self.read(), within=name))

    def add_tolerance(self, tolerance: PartTolerance) -> None:
        """Add a tolerance."""
        known = self.read()
        recipe = replace(known, tolerances=(*known.tolerances, tolerance))
        self._edit(f"add {tolerance.name}", recipe)

    def remove_tolerance(self, name: str) -> None:
        """Delete a tolerance."""
        known = self.read()
        kept = tuple(one for one in known.tolerances if one.name != name)
        self._edit(f"delete {name}", replace(known, tolerances=kept))

    def _edit(self, what: str, recipe: Recipe) -> None:
        """Write a recipe that a click has changed."""
        self._trash.before((self._space.recipe.name,), what)
        self.keep(recipe)

    def keep(self, recipe: Recipe) -> None:
        """Write the recipe."""
        write_recipe(self._space.recipe, recipe)


def as_shown(recipe: Recipe, source: Source) -> Recipe:
    """Return a recipe with the method, the options and the rig by which a source is shown."""
    method = source.method if source.rig is None else recipe.method
    options = source.options if source.rig is None else recipe.options
    return replace(recipe, method=method, options=options, rig=source.rig or recipe.rig)
