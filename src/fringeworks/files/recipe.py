"""Recipes on disk: method, areas and tolerances, as TOML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import tomli_w

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.beside import drop_earlier, name_beside
from fringeworks.files.description import DescriptionFault, Field, Section, Tag, Tagged
from fringeworks.files.images import read_frame, write_frame
from fringeworks.files.limits import MAX_LENGTH_PX, MESSAGE_LETTERS, is_file, told
from fringeworks.files.plan import holds_plan, read_plan, write_plan
from fringeworks.files.toml import read_toml
from fringeworks.types import (
    AlignBy,
    Area,
    BestFit,
    BoolMap,
    Datum,
    DatumPlanes,
    DatumPoints,
    FileProblem,
    InputError,
    KnownPose,
    PartModel,
    PartTolerance,
    Recipe,
    Rig,
    StatedUncertainty,
    ToleranceZone,
    TriangleMesh,
    Where,
    fingerprint,
)
from fringeworks.types.recipe import USUAL_RISK, Association, FeatureBody, Quantity
from fringeworks.types.report_head import HEAD_FIELDS

MOST_CORNERS = 10_000
"""Largest number of corners of a polygon."""
MOST_AREAS = 1000
"""Largest number of areas, and of tolerances."""
HEADER = "# How parts are measured and judged (fringeworks). Areas are in camera pixels.\n"
"""Comment at the top of a recipe."""


class _Area(Section):
    """``[areas.NAME]``: a box, a polygon, a mask or a face."""

    box: tuple[int, int, int, int] | None = None
    polygon: list[tuple[float, float]] | None = Field(default=None, max_length=MOST_CORNERS)
    mask: str | None = None
    """Image file relative to the recipe; pixels above 0 belong to it."""
    face: str | int | None = None
    """Name or number of a face of the model."""


class _Tolerance(Section):
    """``[[tolerances]]``; keys from ``body`` on belong to characteristics of ISO 1101."""

    name: str = Field(min_length=1, max_length=80)
    quantity: Quantity
    areas: list[str] = Field(min_length=1, max_length=2)
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    """Value of the drawing, for reports."""
    body: FeatureBody = "plane"
    datums: list[str] = Field(default_factory=list, max_length=3)
    association: Association = "minimum-zone"
    at_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] | None = None
    angle_deg: float | None = None
    located: bool = False

    def zone(self) -> ToleranceZone:
        return ToleranceZone(
            self.body,
            tuple(self.datums),
            self.association,
            self.at_mm,
            self.direction,
            self.angle_deg,
            self.located,
        )


class _Uncertainty(Section):
    """``[uncertainty]``: what no frame shows; see ``StatedUncertainty``."""

    board_scale: float = 0.0
    board_freedom: float | None = None
    expansion_per_k: float = 0.0
    temperature_k: float = 0.0

    def stated(self) -> StatedUncertainty:
        return StatedUncertainty(
            self.board_scale, self.board_freedom, self.expansion_per_k, self.temperature_k
        )


class _Datum(Section):
    """``[datums.NAME]``: a datum of the drawing."""

    areas: list[str] = Field(min_length=1, max_length=MOST_AREAS)
    body: Literal["plane", "cylinder", "sphere", "median"] = "plane"
    association: Association = "outside"


PointPairs = list[tuple[float, float, float, float, float, float]]
"""Datum points: x, y, z on the part and x, y, z on the model, mm."""


class _Model(Section):
    """``[model]``: the drawing; ``align`` tells how parts are brought to it."""

    file: str
    """Mesh file relative to the recipe."""
    reach_mm: float | None = None


class _BestFit(_Model):
    align: Literal["best-fit"] = "best-fit"
    fit: str | None = None
    """Area that is fitted."""
    points: PointPairs = Field(default_factory=list, max_length=MOST_CORNERS)
    """Datum points that the fit starts from."""

    def by(self, areas: Mapping[str, Area]) -> AlignBy:
        pairs = _pairs(self.points) if self.points else None
        return BestFit(pairs, None if self.fit is None else _named(areas, self.fit))


class _DatumPoints(_Model):
    align: Literal["datum-points"]
    points: PointPairs = Field(min_length=1, max_length=MOST_CORNERS)

    def by(self, _areas: Mapping[str, Area]) -> AlignBy:
        return _pairs(self.points)


class _DatumPlanes(_Model):
    align: Literal["datum-planes"]
    planes: list[tuple[str, float, float, float]] = Field(min_length=3, max_length=3)
    """An area, and x, y, z of a point of the plane on the model, mm."""

    def by(self, areas: Mapping[str, Area]) -> AlignBy:
        one, two, three = (_named(areas, plane[0]) for plane in self.planes)
        return DatumPlanes((one, two, three), np.array([plane[1:] for plane in self.planes]))


class _KnownPose(_Model):
    align: Literal["none"]

    def by(self, _areas: Mapping[str, Area]) -> AlignBy:
        return KnownPose(np.eye(4))


def _align(model: object) -> object:
    """The tag of a model's table; by default the best fit."""
    tag = model.get("align", "best-fit") if isinstance(model, dict) else None
    return tag if isinstance(tag, str) else None


AnyModel = Annotated[
    Annotated[_BestFit, Tag("best-fit")]
    | Annotated[_DatumPoints, Tag("datum-points")]
    | Annotated[_DatumPlanes, Tag("datum-planes")]
    | Annotated[_KnownPose, Tag("none")],
    Tagged(_align, "expected align = best-fit, datum-points, datum-planes or none"),
]


class RecipeFile(Section):
    """The whole of a recipe; unknown keys are refused."""

    kind: Literal["recipe"]
    method: str = "windowed"
    rig: str | None = None
    """Rig file relative to the recipe."""
    plan: str | None = None
    """Plan of frames that have none of their own; its file relative to the recipe."""
    within: str | None = None
    risk: float = USUAL_RISK
    model: AnyModel | None = None
    options: dict[str, Any] = Field(default_factory=dict)
    areas: dict[str, _Area] = Field(default_factory=dict, max_length=MOST_AREAS)
    datums: dict[str, _Datum] = Field(default_factory=dict, max_length=MOST_AREAS)
    tolerances: list[_Tolerance] = Field(default_factory=list, max_length=MOST_AREAS)
    uncertainty: _Uncertainty = Field(default_factory=_Uncertainty)
    head: dict[str, str] = Field(default_factory=dict)
    """Fields of the head of reports."""

    @classmethod
    def checked(cls, content: object) -> Self:
        """The recipe, with a hint where fields of the head do not stand below it."""
        names = content if isinstance(content, Mapping) else {}
        for name in HEAD_FIELDS:
            if name in names:
                raise DescriptionFault(f"unknown key {name}: fields of the head stand below [head]")
        return super().checked(content)


def read_recipe(path: StrPath) -> Recipe:
    """Read a recipe.

    Parameters
    ----------
    path : path
        TOML file. Its rig and its masks lie beside it.

    Returns
    -------
    Recipe; its rig is the path of the file.

    Raises
    ------
    FileProblem that names the file and its first fault, also for files outside of its folder.
    """
    path = Path(path)
    content = read_toml(path, RecipeFile)
    try:
        areas = {name: _area(path, name, area) for name, area in content.areas.items()}
        return Recipe(
            method=content.method,
            options=content.options,
            rig=None if content.rig is None else _beside(path, content.rig),
            plan=None if content.plan is None else read_plan(_beside(path, content.plan)),
            areas=areas,
            model=None if content.model is None else _part_model(path, content.model, areas),
            within=content.within,
            tolerances=tuple(
                PartTolerance(
                    one.name,
                    one.quantity,
                    tuple(one.areas),
                    one.min,
                    one.max,
                    one.nominal,
                    one.zone(),
                )
                for one in content.tolerances
            ),
            datums={
                name: Datum(tuple(one.areas), one.body, one.association)
                for name, one in content.datums.items()
            },
            risk=content.risk,
            uncertainty=content.uncertainty.stated(),
            head=content.head,
        )
    except FileProblem:
        raise
    except InputError as problem:
        raise FileProblem(f"{told(path)}: {told(problem, MESSAGE_LETTERS)}") from problem


def write_recipe(path: StrPath, recipe: Recipe) -> Path:
    """Write a recipe as TOML, whole or not at all.

    Raises
    ------
    FileProblem for another suffix and a folder that is missing; InputError for a rig that is no
    file: write it first. Masks become images, and a plan a plan file, beside the recipe.
    """
    path = Path(path)
    check_target(path, (".toml",))
    if isinstance(recipe.rig, Rig):
        raise InputError("recipe: expected a rig file, got a rig: write it with write_rig first")
    content: dict[str, Any] = {"kind": "recipe", "method": recipe.method, "risk": recipe.risk}
    if recipe.rig is not None:
        content["rig"] = _relative(path, recipe.rig)
    if recipe.plan is not None:
        plan = recipe.plan
        target = name_beside(
            path, _plan_name(path), fingerprint(plan), lambda p: holds_plan(p, plan)
        )
        write_plan(target, plan)
        content["plan"] = target.name
    if recipe.model is not None:
        content["model"] = _model_table(path, recipe.model, recipe.areas)
    if recipe.within is not None:
        content["within"] = recipe.within
    if recipe.options:
        content["options"] = dict(recipe.options)
    content["areas"] = {
        name: _area_table(path, number, area)
        for number, (name, area) in enumerate(recipe.areas.items(), 1)
    }
    content |= _judging(recipe)
    write_text(path, HEADER + tomli_w.dumps(content))
    kept = [area["mask"] for area in content["areas"].values() if "mask" in area]
    names = [
        _mask_name(path, number)
        for number, area in enumerate(recipe.areas.values(), 1)
        if area.mask is not None
    ]
    if recipe.plan is not None:
        names, kept = [*names, _plan_name(path)], [*kept, content["plan"]]
    drop_earlier(path, names, kept)
    return path


def _judging(recipe: Recipe) -> dict[str, Any]:
    """The tables of datums, tolerances, stated uncertainties and the head of reports."""
    content: dict[str, Any] = {}
    if recipe.datums:
        content["datums"] = {name: _datum_table(one) for name, one in recipe.datums.items()}
    content["tolerances"] = [_tolerance_table(one) for one in recipe.tolerances]
    stated = {name: value for name, value in vars(recipe.uncertainty).items() if value}
    if stated:
        content["uncertainty"] = stated
    if recipe.head:
        content["head"] = dict(recipe.head)
    return content


def _plan_name(recipe: Path) -> str:
    return f"{recipe.stem}.plan.toml"


def _mask_name(recipe: Path, number: int) -> str:
    return f"{recipe.stem}-mask-{number}.png"


def _pairs(points: PointPairs) -> DatumPoints:
    table = np.asarray(points, np.float64)
    return DatumPoints(table[:, :3], table[:, 3:])


def _named(areas: Mapping[str, Area], name: str) -> Area:
    """An area that the model names."""
    if name not in areas:
        known = ", ".join(areas) or "none"
        raise InputError(f"model: expected one of the recipe's areas ({known}), got {name!r}")
    return areas[name]


def _part_model(recipe: Path, model: AnyModel, areas: Mapping[str, Area]) -> PartModel:
    """The model of a recipe; it names areas and files that exist."""
    align = model.by(areas)
    mesh = _beside(recipe, model.file)
    if not is_file(mesh):
        raise InputError(f"model: expected the file {model.file}, got no such file")
    return PartModel(mesh, align, model.reach_mm)


def _model_table(recipe: Path, model: PartModel, areas: Mapping[str, Area]) -> dict[str, Any]:
    """The table of a model."""
    if isinstance(model.mesh, TriangleMesh):
        raise InputError(
            "recipe: expected a model file, got a mesh: write it with write_mesh first"
        )
    table: dict[str, Any] = {"file": _relative(recipe, model.mesh, "model")}
    if model.reach_mm is not None:
        table["reach_mm"] = model.reach_mm
    align = model.align
    pairs = align if isinstance(align, DatumPoints) else None
    if isinstance(align, BestFit):
        table["align"] = "best-fit"
        if align.within is not None:
            table["fit"] = _name_of(align.within, areas)
        if align.start is not None and not isinstance(align.start, DatumPoints):
            raise InputError("recipe: expected datum points as the start of a fit, got a pose")
        pairs = align.start
    elif isinstance(align, DatumPlanes):
        table["align"] = "datum-planes"
        table["planes"] = [
            [_name_of(where, areas), *map(float, point)]
            for where, point in zip(align.where, align.model_mm, strict=True)
        ]
    elif isinstance(align, DatumPoints):
        table["align"] = "datum-points"
    else:
        if not np.array_equal(align.T_model_part, np.eye(4)):
            raise InputError("recipe: expected datums or a best fit, got a pose of the part")
        table["align"] = "none"
    if pairs is not None:
        table["points"] = np.hstack((pairs.part_mm, pairs.model_mm)).tolist()
    return table


def _name_of(where: Where, areas: Mapping[str, Area]) -> str:
    """The name of an area of the recipe."""
    for name, area in areas.items():
        if isinstance(where, Area) and area == where:
            return name
    raise InputError("recipe: expected an area of the recipe for its model, got another place")


def _area(recipe: Path, name: str, area: _Area) -> Area:
    mask = None
    if area.mask is not None:
        if not is_file(_beside(recipe, area.mask)):
            raise InputError(f"area {name!r}: expected the mask {area.mask}, got no such file")
        mask = np.asarray(read_frame(_beside(recipe, area.mask))[0] > 0)
    if area.box is not None and max(map(abs, area.box)) > MAX_LENGTH_PX:
        raise InputError(f"area: expected a box within {MAX_LENGTH_PX} px, got {area.box}")
    polygon = None if area.polygon is None else tuple(area.polygon)
    return Area(area.box, polygon, mask, None if area.face is None else str(area.face))


def _area_table(recipe: Path, number: int, area: Area) -> dict[str, Any]:
    """The table of an area; a mask becomes an image beside the recipe."""
    if area.box is not None:
        return {"box": list(area.box)}
    if area.polygon is not None:
        return {"polygon": [list(corner) for corner in area.polygon]}
    if area.face is not None:
        return {"face": area.face}
    mask = area.mask
    assert mask is not None
    image = name_beside(
        recipe, _mask_name(recipe, number), fingerprint(mask), lambda p: _holds_mask(p, mask)
    )
    write_frame(image, np.where(mask, np.uint8(255), np.uint8(0)))
    return {"mask": image.name}


def _holds_mask(path: Path, mask: BoolMap) -> bool:
    """Whether an image is this mask."""
    try:
        return np.array_equal(read_frame(path)[0] > 0, mask)
    except FileProblem:
        return False


def _tolerance_table(one: PartTolerance) -> dict[str, Any]:
    table: dict[str, Any] = {
        "name": one.name,
        "quantity": one.quantity,
        "areas": list(one.areas),
    }
    limits = {"min": one.low, "max": one.high, "nominal": one.nominal}
    table |= {key: value for key, value in limits.items() if value is not None}
    zone, usual = one.zone, ToleranceZone()
    for field in fields(ToleranceZone):
        value = getattr(zone, field.name)
        if value != getattr(usual, field.name):
            table[field.name] = list(value) if isinstance(value, tuple) else value
    return table


def _datum_table(one: Datum) -> dict[str, Any]:
    return {"areas": list(one.areas), "body": one.body, "association": one.association}


def _beside(recipe: Path, name: str) -> Path:
    """A file in the recipe's folder or below."""
    folder = recipe.parent.resolve()
    try:
        found = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # too long, with a NUL, or a loop
        raise FileProblem(
            f"{told(recipe)}: expected the name of a file, got {told(repr(name))}"
        ) from error
    if not found.is_relative_to(folder):
        raise FileProblem(
            f"{told(recipe)}: expected files in its folder or below, got {told(name)} outside"
        )
    return found


def _relative(recipe: Path, file: PathLike[str], what: str = "rig") -> str:
    folder, found = recipe.parent.resolve(), Path(file).resolve()
    if not found.is_relative_to(folder):
        raise InputError(f"recipe: expected the {what} in the folder of the recipe, got {file}")
    return found.relative_to(folder).as_posix()
