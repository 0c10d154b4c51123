"""Recipes of the tolerances that a STEP AP242 drawing or a QIF document states for faces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from fringeworks.files.ap242 import (
    PLAIN,
    DrawnDatum,
    DrawnEntities,
    DrawnFace,
    Unclear,
)
from fringeworks.files.atomic import StrPath
from fringeworks.files.cad import STEP_SUFFIXES
from fringeworks.files.limits import existing_file, parsing, read_content
from fringeworks.files.part21 import Entity, parse_part21, references
from fringeworks.files.qif import SUFFIX as QIF
from fringeworks.files.qif import NamedFace, QifEntities, QifTolerance, parse_qif
from fringeworks.types import (
    Area,
    Datum,
    FileProblem,
    Finding,
    Frozen,
    InputError,
    PartModel,
    PartTolerance,
    Recipe,
    ToleranceZone,
)
from fringeworks.types.recipe import BODIES, CHARACTERISTICS, MOST_DATUMS

QUANTITIES: Mapping[str, str] = MappingProxyType(
    {
        "STRAIGHTNESS_TOLERANCE": "iso_straightness",
        "FLATNESS_TOLERANCE": "iso_flatness",
        "ROUNDNESS_TOLERANCE": "iso_roundness",
        "CYLINDRICITY_TOLERANCE": "iso_cylindricity",
        "SURFACE_PROFILE_TOLERANCE": "iso_surface_profile",
        "PARALLELISM_TOLERANCE": "iso_parallelism",
        "PERPENDICULARITY_TOLERANCE": "iso_perpendicularity",
        "CONCENTRICITY_TOLERANCE": "iso_concentricity",
        "COAXIALITY_TOLERANCE": "iso_coaxiality",
        "SYMMETRY_TOLERANCE": "iso_symmetry",
        "CIRCULAR_RUNOUT_TOLERANCE": "iso_circular_run_out",
        "TOTAL_RUNOUT_TOLERANCE": "iso_total_run_out",
    }
)
"""Quantities of a recipe by the tolerances of AP242."""
NOT_IN_FILE: Mapping[str, str] = MappingProxyType(
    {
        "LINE_PROFILE_TOLERANCE": "the direction of its lines is not read",
        "ANGULARITY_TOLERANCE": "its exact angle is not read",
        "POSITION_TOLERANCE": "its exact place in the frame of the datums is not read",
    }
)
"""Tolerances that recipes have, but whose exact dimensions are elsewhere in the file."""
ON_AXIS = frozenset(
    {"iso_parallelism", "iso_perpendicularity", "iso_concentricity", "iso_coaxiality"}
)
"""Characteristics whose zone holds the axis of a cylinder, and has a diameter."""
ALWAYS_ROUND = frozenset({"iso_concentricity", "iso_coaxiality"})
"""Those whose zone has a diameter by their definition, whether the file says so or not."""
ROUND_FORMS = (
    "cylindrical or circular",
    "within a cylinder",
    "within a circle",
    "spherical",
    "within a sphere",
)
"""Forms of zones with a diameter, as AP242 calls them."""
UNEVEN_FORM = "non uniform"
"""The form of a zone whose width changes."""
ONE_DATUM = frozenset(
    {
        "iso_concentricity",
        "iso_coaxiality",
        "iso_symmetry",
        "iso_circular_run_out",
        "iso_total_run_out",
    }
)
"""Characteristics of a single datum."""
PLAIN_ASPECTS = frozenset(
    {"SHAPE_ASPECT", "DATUM_FEATURE", "COMPOSITE_SHAPE_ASPECT", "CONTINUOUS_SHAPE_ASPECT"}
)
"""Shape aspects that are their faces, not an axis or a middle that is derived from them."""
DIMENSIONS = (
    "DIMENSIONAL_SIZE",
    "DIMENSIONAL_LOCATION",
    "ANGULAR_SIZE",
    "ANGULAR_LOCATION",
    "DIRECTED_DIMENSIONAL_LOCATION",
)
"""Beginnings of the types of dimensions."""
NOT_READ = (
    "dimensions are not read: a size between two points (ISO 14405-1) is not the size of a fitted "
    "body"
)
"""Why recipes have none of them."""
CHARACTERISTICS_OF_QIF: Mapping[str, str] = MappingProxyType(
    {
        "Straightness": "iso_straightness",
        "Flatness": "iso_flatness",
        "Circularity": "iso_roundness",
        "Cylindricity": "iso_cylindricity",
        "SurfaceProfile": "iso_surface_profile",
        "Parallelism": "iso_parallelism",
        "Perpendicularity": "iso_perpendicularity",
        "Concentricity": "iso_concentricity",
        "Coaxiality": "iso_coaxiality",
        "Symmetry": "iso_symmetry",
        "CircularRunout": "iso_circular_run_out",
        "TotalRunout": "iso_total_run_out",
    }
)
"""Quantities of a recipe by the characteristics of QIF."""
NOT_IN_DOCUMENT: Mapping[str, str] = MappingProxyType(
    {
        "LineProfile": NOT_IN_FILE["LINE_PROFILE_TOLERANCE"],
        "Angularity": NOT_IN_FILE["ANGULARITY_TOLERANCE"],
        "Position": NOT_IN_FILE["POSITION_TOLERANCE"],
        "Sphericity": "recipes have no sphericity",
        "Conicity": "recipes have no conicity",
        "SurfaceProfileNonUniform": "its zone is uneven, which recipes do not have",
    }
)
"""Characteristics of QIF that recipes do not have, and why."""
MOST_LETTERS = 80
"""Longest name of a tolerance of a recipe."""


@dataclass(frozen=True, eq=False, repr=False)
class DrawnTolerances(Frozen):
    """The tolerances of a drawing."""

    recipe: Recipe
    """Areas, datums and tolerances that name faces, and the drawing as the model."""
    left_out: tuple[Finding, ...] = ()
    """Every tolerance and dimension of the file that the recipe does not have, and why."""


@dataclass
class _Made:
    """What a recipe gets."""

    areas: dict[str, Area] = field(default_factory=dict)
    datums: dict[str, Datum] = field(default_factory=dict)
    tolerances: list[PartTolerance] = field(default_factory=list)
    left_out: list[Finding] = field(default_factory=list)


@dataclass(frozen=True)
class _Stated:
    """A tolerance as a file states it."""

    name: object
    """Its own name, where the file has one."""
    word: str
    number: str
    quantity: str
    value_mm: float
    faces: list[DrawnFace]
    form: str
    """Form of the zone in words."""
    given: list[DrawnDatum]


def read_tolerances(path: StrPath, *, model: StrPath | None = None) -> DrawnTolerances:
    """Read the tolerances that a STEP AP242 file or a QIF document states for faces.

    Parameters
    ----------
    path : path
        Drawing, ``.step`` or ``.stp``, or document, ``.qif`` of QIF 3. Its text is read, without
        the extra ``cad``.
    model : path, optional
        Drawing, ``.step`` or ``.stp``, whose faces have the names of a document's; a document needs
        it, and a drawing is its own.

    Returns
    -------
    DrawnTolerances; lengths in mm, whatever the unit of the file. Its recipe has no rig and no
    method of its own, and a best fit to the drawing.

    Raises
    ------
    FileProblem for files that are missing, damaged, cut off or of another kind; InputError for
    another suffix, and a document without a drawing.

    Notes
    -----
    Entities of ISO 10303-242: a tolerance names a shape aspect, which a usage connects with faces.
    Elements of QIF 3 (ISO 23952:2020): the nominal of a characteristic names features, whose faces
    are known by their labels.
    """
    path = Path(path)
    made = _Made()
    if path.suffix.lower() == QIF:
        if model is None:
            raise InputError(f"model: expected the drawing whose faces {path.name} names, got none")
        drawing = Path(model)
        _of_document(path, _drawn(drawing), made)
    else:
        if model is not None:
            raise InputError("model: expected none beside a drawing, which is its own")
        drawing = path
        drawn = _drawn(drawing)
        with parsing(drawing, "a STEP file"):
            for one, kind in drawn.tolerances():
                _take(drawn, one, kind, made)
            _dimensions(drawn, made)
    with parsing(path, "tolerances"):
        recipe = Recipe(
            areas=made.areas,
            datums=made.datums,
            tolerances=tuple(made.tolerances),
            model=PartModel(drawing),
        )
    return DrawnTolerances(recipe, tuple(made.left_out))


def _drawn(path: Path) -> DrawnEntities:
    """The entities of a drawing."""
    if path.suffix.lower() not in STEP_SUFFIXES:
        expected = " or ".join(STEP_SUFFIXES)
        raise InputError(
            f"tolerances: expected {expected}, got {path.name or path}; a document of QIF 3 "
            f"({QIF}) names the faces of such a drawing"
        )
    path = existing_file(path, "a STEP file")
    with parsing(path, "a STEP file"):
        text = read_content(path, "a STEP file").decode("utf-8", "replace")
        entities = parse_part21(text)
        if "END-ISO-10303-21" not in text[-1000:]:
            raise FileProblem("expected END-ISO-10303-21 at the end, got a file that is cut off")
        return DrawnEntities(entities)


def _of_document(path: Path, drawn: DrawnEntities, made: _Made) -> None:
    """Take the tolerances of a QIF document for the faces of a drawing."""
    path = existing_file(path, "a QIF document")
    with parsing(path, "a QIF document"):
        document = QifEntities(parse_qif(read_content(path, "a QIF document")))
        for one in document.tolerances():
            word = _spaced(one.kind)
            title = f"{word} #{one.number}" + (f" {one.name!r}" if one.name else "")
            if one.kind not in CHARACTERISTICS_OF_QIF and one.kind not in NOT_IN_DOCUMENT:
                made.left_out.append(Finding("dimension", f"{title}: {NOT_READ}", severity="note"))
                continue
            try:
                _add(drawn, _of_characteristic(document, one, word, drawn), made)
            except InputError as problem:
                made.left_out.append(Finding("tolerance", f"{title}: {problem}"))


def _of_characteristic(
    document: QifEntities, one: QifTolerance, word: str, drawn: DrawnEntities
) -> _Stated:
    if one.kind in NOT_IN_DOCUMENT:
        raise Unclear(NOT_IN_DOCUMENT[one.kind])
    quantity = CHARACTERISTICS_OF_QIF[one.kind]
    definition = document.definition(one)
    faces = [_named(drawn, face) for face in document.faces(one.nominal)]
    _count(faces, quantity)
    given = [
        DrawnDatum(letters, [_named(drawn, face) for face in of])
        for letters, of in document.datums(definition)
    ]
    value, form = document.value_mm(definition), document.form(definition)
    return _Stated(one.name, word, one.number, quantity, value, faces, form, given)


def _named(drawn: DrawnEntities, named: NamedFace) -> DrawnFace:
    """The face of a drawing with a name and a nominal form."""
    found = [face for face in drawn.faces.values() if face.name == named.name]
    if len(found) != 1:
        many = "no face" if not found else "several faces"
        raise Unclear(f"the drawing has {many} with the name {named.name!r}")
    if named.kind not in (None, found[0].kind):
        raise Unclear(f"{named.name!r} is a {named.kind}, and in the drawing a {found[0].kind}")
    return found[0]


def _spaced(kind: str) -> str:
    """CircularRunout as circular runout."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in kind).strip()


def _take(drawn: DrawnEntities, one: Entity, kind: str, made: _Made) -> None:
    """Add a tolerance to what the recipe gets, or say why not."""
    title = f"{_word(kind)} #{one.number}"
    try:
        stated = drawn.stated(one, kind)
        if isinstance(stated[0], str) and stated[0].strip():
            title += f" {stated[0].strip()!r}"
        quantity = _quantity(drawn, one, kind)
        faces = _faces(drawn, stated[3], quantity)
        form = _form(drawn, one)
        given = drawn.datums_of(one, kind)
        value = drawn.length_mm(stated[2])
        word, number_of = _word(kind), str(one.number)
        found = _Stated(stated[0], word, number_of, quantity, value, faces, form, given)
        _add(drawn, found, made)
    except InputError as problem:
        made.left_out.append(Finding("tolerance", f"{title}: {problem}"))
    except IndexError:
        few = "an entity that it names has too few parameters"
        made.left_out.append(Finding("tolerance", f"{title}: {few}"))


def _add(drawn: DrawnEntities, one: _Stated, made: _Made) -> None:
    """Add a tolerance to what the recipe gets."""
    body = _body(one.quantity, one.faces, one.form)
    datums = _datums(drawn, one.quantity, one.given)
    areas = tuple(_title(drawn, face) for face in one.faces)
    zone = ToleranceZone(body, tuple(datums))  # type: ignore[arg-type]  # of BODIES
    name = _name(one, areas, made)
    found = PartTolerance(name, one.quantity, areas, None, one.value_mm, zone=zone)  # type: ignore[arg-type]
    for face, area in [*zip(one.faces, areas, strict=True), *_of(drawn, one.given)]:
        made.areas[area] = Area(face=_address(face))
    made.datums |= datums
    made.tolerances.append(found)


def _word(kind: str) -> str:
    """A type of entity in words."""
    return kind.removesuffix("_TOLERANCE").lower().replace("_", " ")


def _quantity(drawn: DrawnEntities, one: Entity, kind: str) -> str:
    """The quantity of a recipe that a tolerance is."""
    if kind in NOT_IN_FILE:
        raise Unclear(NOT_IN_FILE[kind])
    if kind not in QUANTITIES:
        raise Unclear(f"recipes have no {kind}")
    more = sorted(one.records.keys() - PLAIN - {kind})
    for zone in drawn.zones.get(one.number, []):
        more += sorted(zone.records.keys() - {"TOLERANCE_ZONE", "SHAPE_ASPECT"})
        more += drawn.defined.get(zone.number, [])
    if more:
        raise Unclear(f"it has {', '.join(more)}, which recipes do not have")
    return QUANTITIES[kind]


def _faces(drawn: DrawnEntities, target: object, quantity: str) -> list[DrawnFace]:
    """The faces that a tolerance belongs to."""
    found = references(target)
    aspect = drawn.get(found[0]) if found else None
    if aspect is None:
        raise Unclear("it belongs to no shape")
    others = sorted(aspect.records.keys() - PLAIN_ASPECTS)
    if others or not aspect.records:
        raise Unclear(f"it belongs to {others[0] if others else 'nothing'}, not to faces")
    faces = drawn.faces_of(aspect.number)
    _count(faces, quantity)
    return faces


def _count(faces: list[DrawnFace], quantity: str) -> None:
    """Refuse a tolerance of more or fewer faces than its quantity has."""
    needed = 2 if quantity == "iso_symmetry" else 1
    if len(faces) != needed:
        raise Unclear(f"expected {needed} face{'s' * (needed > 1)}, got {len(faces)}")


def _body(quantity: str, faces: list[DrawnFace], form: str) -> str:
    """The nominal body of the faces, which the zone must suit."""
    if quantity == "iso_surface_profile":
        return "plane"  # unused: the body of a profile is the model's
    kinds = {face.kind for face in faces}
    body = kinds.pop()
    if kinds or body not in BODIES[quantity]:
        expected = " or ".join(BODIES[quantity])
        raise Unclear(f"expected a {expected}, got a {' and a '.join(sorted({body, *kinds}))}")
    if quantity == "iso_straightness" and body == "plane":
        raise Unclear("the direction of its lines is not read")
    if quantity in ON_AXIS and body == "cylinder":
        fits = form in ROUND_FORMS or (form == "" and quantity in ALWAYS_ROUND)
    elif quantity in ON_AXIS and body == "sphere":
        fits = form in ("", *ROUND_FORMS)
    else:
        fits = form not in (*ROUND_FORMS, UNEVEN_FORM)
    if not fits:
        raise Unclear(
            f"its zone is {form or 'of a width'}, which recipes do not have for a {body} here"
        )
    return body


def _form(drawn: DrawnEntities, one: Entity) -> str:
    """The form of the zone in words; empty where the file has none."""
    for zone in drawn.zones.get(one.number, []):
        for k in references(list(zone.records.values())):
            entity = drawn.get(k)
            if entity.kind == "TOLERANCE_ZONE_FORM":
                return str((*drawn.parameters(entity), "")[0] or "").strip().lower()
    return ""


def _datums(drawn: DrawnEntities, quantity: str, given: list[DrawnDatum]) -> dict[str, Datum]:
    """The datums of a tolerance for the recipe, by rank."""
    most = 1 if quantity in ONE_DATUM else MOST_DATUMS
    needed = CHARACTERISTICS[quantity]
    if (needed and not given) or len(given) > most or (given and not needed):
        expected = "no datum" if not needed else "1 datum" if most == 1 else f"1 to {most} datums"
        raise Unclear(f"recipes take {expected} for it, got {len(given)}")
    found: dict[str, Datum] = {}
    for one in given:
        kinds = sorted({face.kind for face in one.faces})
        if len(kinds) > 1 or kinds[0] not in ("plane", "cylinder", "sphere"):
            raise Unclear(f"its datum {one.letters} is a {' and a '.join(kinds)}")
        if quantity.endswith("run_out") and kinds[0] != "cylinder":
            raise Unclear(f"its datum {one.letters} is a {kinds[0]}, where a cylinder is expected")
        areas = tuple(_title(drawn, face) for face in one.faces)
        found[one.letters] = Datum(areas, kinds[0])  # type: ignore[arg-type]  # one of those above
    return found


def _of(drawn: DrawnEntities, given: list[DrawnDatum]) -> list[tuple[DrawnFace, str]]:
    return [(face, _title(drawn, face)) for one in given for face in one.faces]


def _title(drawn: DrawnEntities, face: DrawnFace) -> str:
    """The name of a face's area, which finds it in the model: a name that no other face has."""
    names = [other.name for other in drawn.faces.values()]
    if face.name:
        if names.count(face.name) > 1:
            raise Unclear(f"several faces have the name {face.name!r}")
        return face.name
    if drawn.assembled:
        raise Unclear(f"face {face.number} of an assembly has no name")
    title = f"face {face.number}"
    if title in names or str(face.number) in names:
        raise Unclear(f"{title} has no name, and another face is called so")
    return title


def _address(face: DrawnFace) -> str:
    return face.name or str(face.number)


def _name(one: _Stated, areas: tuple[str, ...], made: _Made) -> str:
    """The name of a tolerance: its own, or what it is of which face."""
    own = one.name.strip() if isinstance(one.name, str) else ""
    name = own if own and len(own) <= MOST_LETTERS else f"{one.word} of {' and '.join(areas)}"
    if any(other.name == name for other in made.tolerances) or len(name) > MOST_LETTERS:
        name = f"{name[: MOST_LETTERS - 20]} (#{one.number})"
    return name


def _dimensions(drawn: DrawnEntities, made: _Made) -> None:
    """Name the dimensions, which recipes do not have: sizes between two points, and places."""
    for one in drawn.entities.values():
        kind = next((n for n in one.records if n.startswith(DIMENSIONS)), None)
        if kind is None or "REPRESENTATION" in kind:
            continue
        words = [w for w in drawn.parameters(one) if isinstance(w, str) and w.strip()]
        title = f"{kind.lower().replace('_', ' ')} #{one.number}"
        title += f" {words[0]!r}" if words else ""
        made.left_out.append(Finding("dimension", f"{title}: {NOT_READ}", severity="note"))
