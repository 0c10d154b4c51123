"""Tolerances in the text of a STEP AP242 file, as its entities state them: nothing is judged."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from fringeworks.files.part21 import Entity, Reference, face_names, references
from fringeworks.types import InputError
from fringeworks.types.numbers import number

MM_PER_METRE = 1000.0
"""Millimetres of a metre, the unit that prefixes of the SI belong to."""
PREFIXES = {
    ".KILO.": 1e3,
    ".HECTO.": 1e2,
    ".DECA.": 1e1,
    ".DECI.": 1e-1,
    ".CENTI.": 1e-2,
    ".MILLI.": 1e-3,
    ".MICRO.": 1e-6,
    ".NANO.": 1e-9,
}
"""Prefixes of the SI that lengths have."""
DECIMALS = 9
"""Decimals of values in mm: a thousandth of a nanometre. Some programs write 0.01000000000004."""
MOST_STEPS = 20
"""Longest chain of units or shape aspects; files have up to three, and a damaged one may go round
in circles."""
SURFACES = {
    "PLANE": "plane",
    "CYLINDRICAL_SURFACE": "cylinder",
    "CONICAL_SURFACE": "cone",
    "SPHERICAL_SURFACE": "sphere",
    "TOROIDAL_SURFACE": "torus",
}
"""Nominal forms of faces by their surfaces; all others are free-form."""
USAGES = ("GEOMETRIC_ITEM_SPECIFIC_USAGE", "ITEM_IDENTIFIED_REPRESENTATION_USAGE")
"""Entities that connect a shape aspect with faces."""
PLAIN = frozenset({"GEOMETRIC_TOLERANCE", "GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE"})
"""Records of a tolerance that say no more than its value, its faces and its datums."""
DATUM_PARAMETER = 4
"""Place of the datums of a datum system, of a compartment, and of a tolerance in one record; that
of the faces of a usage is the same. The four before are of their supertypes."""


class Unclear(InputError):
    """Something of the file that cannot be read without a guess; its text says what."""


@dataclass(frozen=True)
class DrawnFace:
    """A face as the text has it."""

    number: int
    """Its place in the shells, from 1, which is the number that the model has for it."""
    name: str
    kind: str


@dataclass
class DrawnDatum:
    """A datum: its letter and the faces of its features."""

    letters: str
    faces: list[DrawnFace] = field(default_factory=list)


class DrawnEntities:
    """The entities of a file, and how they hang together."""

    def __init__(self, entities: dict[int, Entity]) -> None:
        self.entities = entities
        named = face_names(entities)
        self.faces = {
            one: DrawnFace(k, name, self._surface(one)) for k, (one, name) in enumerate(named, 1)
        }
        """Faces by the numbers of their entities."""
        self.assembled = any("NEXT_ASSEMBLY" in one.kind for one in entities.values())
        """Whether the file is an assembly, whose faces the model counts another way."""
        self._used: dict[int, list[int]] = {}
        self._related: list[tuple[int, int]] = []
        self.zones: dict[int, list[Entity]] = {}
        """Tolerance zones by the numbers of their tolerances."""
        self.defined: dict[int, list[str]] = {}
        """Types of what defines zones further, such as projected ones, by the zones' numbers."""
        for one in entities.values():
            self._sort(one)

    def _sort(self, one: Entity) -> None:
        """Note what connects other entities."""
        if one.kind in USAGES:
            parameters = self.parameters(one)
            for aspect in references(parameters[2:3]):
                self._used.setdefault(aspect, []).extend(references(parameters[DATUM_PARAMETER:]))
        for name, parameters in one.records.items():
            if name.startswith("SHAPE_ASPECT_") and len(parameters) >= 4:
                ends = references(parameters[2:4])
                if len(ends) == 2:
                    self._related.append((ends[0], ends[1]))
        for name, parameters in one.records.items():
            if name.endswith("ZONE_DEFINITION"):
                for zone in references(parameters[:1]):
                    self.defined.setdefault(zone, []).append(name)
        if "TOLERANCE_ZONE" in one.records:
            for parameters in one.records.values():
                for tolerance in references(parameters[4:5]):
                    self.zones.setdefault(tolerance, []).append(one)

    def parameters(self, one: Entity) -> list[object]:
        """The parameters of an entity of one record, or of the first of several."""
        return next(iter(one.records.values()), [])

    def get(self, number_of: int) -> Entity:
        """Return an entity.

        Raises
        ------
        Unclear where the file does not have it.
        """
        if number_of not in self.entities:
            raise Unclear(f"it names #{number_of}, which the file does not have")
        return self.entities[number_of]

    def _surface(self, face: int) -> str:
        parameters = self.entities[face].records["ADVANCED_FACE"]
        found = references(parameters[2:3])
        surface = self.entities.get(found[0]) if found else None
        return "free-form" if surface is None else SURFACES.get(surface.kind, "free-form")

    def tolerances(self) -> list[tuple[Entity, str]]:
        """All geometric tolerances, and their types, such as FLATNESS_TOLERANCE."""
        found = []
        for one in self.entities.values():
            names = [name for name in one.records if name.endswith("_TOLERANCE")]
            own = [name for name in names if name not in NOT_TYPES]
            if own and "PLUS_MINUS_TOLERANCE" not in one.records:
                found.append((one, own[0]))
            elif "GEOMETRIC_TOLERANCE" in one.records:
                found.append((one, "GEOMETRIC_TOLERANCE"))
        return found

    def stated(self, one: Entity, kind: str) -> list[object]:
        """Name, description, value, target and perhaps datums of a tolerance."""
        parameters = one.records.get("GEOMETRIC_TOLERANCE") or one.records[kind]
        if len(parameters) < 4:
            raise Unclear(f"expected four parameters, got {len(parameters)}")
        return parameters

    def length_mm(self, value: object) -> float:
        """Return a length with a unit, mm."""
        if not isinstance(value, Reference):
            raise Unclear("it has no value")
        one = self.get(value.number)
        measure, units = self._measure(one)
        found = round(measure * self.unit_mm(units), DECIMALS)
        if not 0 < found < math.inf:
            raise Unclear(f"its value is {number(found, unit='mm')}, where one above 0 is expected")
        return found

    def _measure(self, one: Entity) -> tuple[float, int]:
        """The value of a measure, and the entity of its unit."""
        for name, parameters in one.records.items():
            if name.endswith("MEASURE_WITH_UNIT") and len(parameters) >= 3:
                kind, inner, unit = parameters[:3]
                length = kind in ("LENGTH_MEASURE", "POSITIVE_LENGTH_MEASURE")
                if length and isinstance(inner, list) and isinstance(unit, Reference):
                    value = inner[0] if len(inner) == 1 else None
                    if isinstance(value, float):
                        return value, unit.number
        raise Unclear(f"its value #{one.number} is not a length with a unit")

    def unit_mm(self, number_of: int, steps: int = 0) -> float:
        """Return a unit of length, mm."""
        one = self.get(number_of)
        if "LENGTH_UNIT" not in one.records or steps > MOST_STEPS:
            raise Unclear(f"its unit #{number_of} is not one of length")
        if "SI_UNIT" in one.records:
            prefix, name = (*one.records["SI_UNIT"], None, None)[:2]
            if name == ".METRE." and (prefix is None or prefix in PREFIXES):
                return MM_PER_METRE * PREFIXES.get(str(prefix), 1.0)
        if "CONVERSION_BASED_UNIT" in one.records:
            factor = references(one.records["CONVERSION_BASED_UNIT"])
            if factor:
                value, unit = self._measure(self.get(factor[0]))
                return value * self.unit_mm(unit, steps + 1)
        raise Unclear(f"its unit #{number_of} is not known")

    def faces_of(self, aspect: int, seen: frozenset[int] = frozenset()) -> list[DrawnFace]:
        """Return the faces of a shape aspect, in the order of the file.

        Raises
        ------
        Unclear where something else than faces belongs to it.
        """
        if aspect in seen:
            return []
        found: list[DrawnFace] = []
        items = self._used.get(aspect, [])
        for item in items:
            found += self._item(item)
        if not items:
            parts = [part for whole, part in self._related if whole == aspect]
            for part in parts:
                if "DATUM" not in self.get(part).records:
                    found += self.faces_of(part, seen | {aspect})
        return list({face.number: face for face in found}.values())

    def _item(self, item: int) -> list[DrawnFace]:
        if item in self.faces:
            return [self.faces[item]]
        one = self.get(item)
        if "COMPOUND_REPRESENTATION_ITEM" in one.records:
            return [face for k in references(self.parameters(one)) for face in self._item(k)]
        raise Unclear(f"it names #{item}, a {one.kind}, which is no face of a shell")

    def datums_of(self, one: Entity, kind: str) -> list[DrawnDatum]:
        """Return the datums of a tolerance, by rank.

        Raises
        ------
        Unclear where a datum has modifiers, targets or no faces.
        """
        record = one.records.get("GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE")
        given = references(one.records[kind][DATUM_PARAMETER:] if record is None else record)
        systems = [self.get(k) for k in given]
        if len(systems) > 1 and any("DATUM_SYSTEM" in s.records for s in systems):
            raise Unclear("it has several datum systems")
        if len(systems) == 1 and "DATUM_SYSTEM" in systems[0].records:
            parameters = systems[0].records["DATUM_SYSTEM"][DATUM_PARAMETER:]
            return [self._compartment(self.get(k)) for k in references(parameters)]
        return [self._old_reference(s) for s in sorted(systems, key=self._precedence)]

    def _precedence(self, one: Entity) -> float:
        rank = self.parameters(one)[:1]
        return rank[0] if rank and isinstance(rank[0], float) else math.inf

    def _old_reference(self, one: Entity) -> DrawnDatum:
        """A datum reference of files before AP242."""
        if one.kind != "DATUM_REFERENCE" or len(one.records) > 1:
            raise Unclear(f"its datum #{one.number} is a {one.kind}, which is not read")
        return self._datums(references(self.parameters(one)))

    def _compartment(self, one: Entity) -> DrawnDatum:
        parameters = self.parameters(one)
        if parameters[-1] not in (None, []):
            raise Unclear(f"its datum #{one.number} has modifiers")
        datums = []
        for base in references(parameters[DATUM_PARAMETER:-1]):
            element = self.get(base)
            if "DATUM_REFERENCE_ELEMENT" in element.records:
                datums += [self._element(element)]
            else:
                datums.append(base)
        return self._datums(datums)

    def _element(self, one: Entity) -> int:
        parameters = self.parameters(one)
        if parameters[-1] not in (None, []):
            raise Unclear(f"its datum #{one.number} has modifiers")
        found = references(parameters[DATUM_PARAMETER:-1])
        if len(found) != 1:
            raise Unclear(f"its datum #{one.number} has {len(found)} bases, where one is expected")
        return found[0]

    def _datums(self, numbers: list[int]) -> DrawnDatum:
        """One datum, or a common datum of several."""
        letters, faces = [], list[DrawnFace]()
        for one in map(self.get, numbers):
            if "DATUM" not in one.records:
                raise Unclear(f"its datum #{one.number} is a {one.kind}, which is not read")
            found = self._datum_faces(one)
            letters.append(str(self.parameters(one)[-1] or f"#{one.number}"))
            faces += found
        if not faces:
            raise Unclear("a datum of it has no faces")
        return DrawnDatum("-".join(letters), faces)

    def _datum_faces(self, datum: Entity) -> list[DrawnFace]:
        letter = self.parameters(datum)[-1]
        found = self.faces_of(datum.number)
        for feature, of in self._related:
            if of != datum.number:
                continue
            one = self.get(feature)
            if any("DATUM_TARGET" in name for name in one.records):
                raise Unclear(f"its datum {letter} is made of targets")
            found += self.faces_of(feature)
        once = list({face.number: face for face in found}.values())
        if len(once) != 1:
            raise Unclear(f"its datum {letter} has {len(once)} faces, where one is expected")
        return once


NOT_TYPES = frozenset(
    {
        "GEOMETRIC_TOLERANCE",
        "MODIFIED_GEOMETRIC_TOLERANCE",
        "UNEQUALLY_DISPOSED_GEOMETRIC_TOLERANCE",
        "PLUS_MINUS_TOLERANCE",
        "GEOMETRIC_TOLERANCE_WITH_MAXIMUM_TOLERANCE",
    }
)
"""Records that end as the types of tolerances do, and are none."""
