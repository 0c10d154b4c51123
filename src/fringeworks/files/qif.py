"""Tolerances in a QIF document, as its elements state them: nothing is judged."""

from __future__ import annotations

import math
import xml.parsers.expat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from fringeworks.files.ap242 import DECIMALS, MM_PER_METRE, Unclear
from fringeworks.types import FileProblem
from fringeworks.types.numbers import number

SUFFIX = ".qif"
"""Suffix of the documents."""
NAMESPACE = "http://qifstandards.org/xsd/qif3"
"""Name space of QIF 3 (ISO 23952:2020)."""
DEEPEST = 100
"""Deepest element that is read; the schema's own are at most a dozen deep."""
UNITS: Mapping[str, float] = MappingProxyType(
    {
        "mm": 1e-3, "millimeter": 1e-3, "millimetre": 1e-3, "m": 1.0, "meter": 1.0, "metre": 1.0,
        "in": 0.0254, "inch": 0.0254,
    }
)  # fmt: skip
"""Metres of units that need no conversion in the file."""
SAME = 1e-6
"""Relative difference of two factors of a unit up to which they are the same."""
FEATURES: Mapping[str, str] = MappingProxyType(
    {"Plane": "plane", "Cylinder": "cylinder", "Cone": "cone", "Sphere": "sphere", "Torus": "torus"}
)
"""Nominal forms of features by their elements."""
PLAIN_DEFINITION = frozenset(
    {
        "Attributes", "Description", "Name", "CharacteristicDesignator", "ToleranceValue",
        "ToleranceDualValue", "DatumReferenceFrameId", "ZoneShape", "MaterialCondition",
    }
)  # fmt: skip
"""Elements of a definition that change no zone, or that are read."""
PLAIN_NOMINAL = frozenset(
    {
        "Attributes", "Description", "CharacteristicDefinitionId", "FeatureNominalIds", "Name",
        "EntityInternalIds", "EntityExternalIds", "CharacteristicDesignator", "KeyCharacteristic",
        "MeasurementDirective",
    }
)  # fmt: skip
"""The same of a nominal."""
PLAIN_DATUM = frozenset({"DatumDefinitionId", "MaterialModifier", "Attributes"})
"""The same of a datum of a frame."""
UNMODIFIED = ("", "false", "0", "NONE", "REGARDLESS")
"""Values of modifiers that say that there is none."""
RANKS = ("PRIMARY", "SECONDARY", "TERTIARY")
"""Precedences of datums."""
ROUND_ZONES = ("DiametricalZone", "SphericalZone")
"""Zones with a diameter."""


@dataclass
class Part:
    """An element of the document."""

    tag: str
    """Its name without the name space."""
    given: dict[str, str]
    """Its attributes."""
    text: str = ""
    parts: list[Part] = field(default_factory=list)

    def all(self, *path: str) -> Iterator[Part]:
        """Elements under this one by their names, one after the other."""
        if not path:
            yield self
            return
        for one in self.parts:
            if one.tag == path[0]:
                yield from one.all(*path[1:])

    def one(self, *path: str) -> Part | None:
        """The first of them."""
        return next(self.all(*path), None)

    def word(self, *path: str) -> str:
        """Its text without spaces around it; empty where there is none."""
        found = self.one(*path)
        return "" if found is None else found.text.strip()


@dataclass(frozen=True)
class QifTolerance:
    """A characteristic of the document."""

    kind: str
    """Such as Flatness."""
    number: str
    """Its id."""
    nominal: Part
    definition: Part | None

    @property
    def name(self) -> str:
        """The name that the document gives it."""
        return self.nominal.word("Name")


@dataclass(frozen=True)
class NamedFace:
    """A face of the drawing by its name."""

    name: str
    kind: str | None
    """Nominal form of the feature; None where it is none of the usual ones."""


def parse_qif(content: bytes) -> Part:
    """Return the root of a QIF 3 document.

    Raises
    ------
    FileProblem for a document of another kind or version, one with a document type or entities,
    which could grow without limit or name other files, and one that is too deep.
    """
    root, stack = Part("", {}), list[Part]()
    stack.append(root)
    parser = xml.parsers.expat.ParserCreate(namespace_separator=" ")

    def start(tag: str, given: dict[str, str]) -> None:
        space, _, name = tag.rpartition(" ")
        if len(stack) == 1 and (space, name) != (NAMESPACE, "QIFDocument"):
            raise FileProblem(f"expected a QIFDocument of {NAMESPACE}, got {tag!r}")
        if len(stack) > DEEPEST:
            raise FileProblem(f"expected elements at most {DEEPEST} deep, got deeper ones")
        stack[-1].parts.append(Part(name, given))
        stack.append(stack[-1].parts[-1])

    def end(_: str) -> None:
        stack.pop()

    def text(more: str) -> None:
        stack[-1].text += more

    def refuse(*_: object) -> None:
        raise FileProblem("expected a document without a document type and entities, got one")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.Parse(content, True)
    found = root.parts[0]
    version = found.given.get("versionQIF", "")
    if version.split(".")[0] != "3":
        raise FileProblem(f"expected QIF 3, got version {version or 'none'}")
    return found


class QifEntities:
    """The elements of a document by their ids."""

    def __init__(self, root: Part) -> None:
        self._root = root
        self._features = self._by_id("Features", "FeatureNominals")
        self._definitions = self._by_id("Characteristics", "CharacteristicDefinitions")
        self._datums = self._by_id("DatumDefinitions")
        self._frames = self._by_id("DatumReferenceFrames")
        self._faces = {
            one.given.get("id", ""): one
            for one in root.all("Product", "TopologySet", "FaceSet", "Face")
        }

    def _by_id(self, *path: str) -> dict[str, Part]:
        groups = self._root.all(*path)
        return {
            one.given["id"]: one for group in groups for one in group.parts if "id" in one.given
        }

    def tolerances(self) -> list[QifTolerance]:
        """All characteristics that name features, then those that no nominal uses."""
        end = "CharacteristicNominal"
        found = []
        used = set()
        for group in self._root.all("Characteristics", "CharacteristicNominals"):
            for one in group.parts:
                if one.tag.endswith(end):
                    of = one.word("CharacteristicDefinitionId")
                    used.add(of)
                    kind = one.tag.removesuffix(end)
                    given = self._definitions.get(of)
                    found.append(QifTolerance(kind, one.given.get("id", "?"), one, given))
        for of, given in self._definitions.items():
            if of not in used:
                kind = given.tag.removesuffix("CharacteristicDefinition")
                found.append(QifTolerance(kind, of, Part("", {}), given))
        return found

    def definition(self, one: QifTolerance) -> Part:
        """Return the definition of a characteristic.

        Raises
        ------
        Unclear where the document lacks it, or it says more than a recipe can.
        """
        if not one.nominal.tag:
            raise Unclear("no nominal connects it with features")
        if one.definition is None:
            raise Unclear("the file does not have its definition")
        if one.definition.tag != f"{one.kind}CharacteristicDefinition":
            raise Unclear(f"its definition is a {one.definition.tag}")
        more = _more(one.definition, PLAIN_DEFINITION) + _more(one.nominal, PLAIN_NOMINAL)
        if more:
            raise Unclear(f"it has {', '.join(more)}, which recipes do not have")
        return one.definition

    def value_mm(self, definition: Part) -> float:
        """Return the width of a zone, mm."""
        values = list(definition.all("ToleranceValue"))
        if len(values) != 1:
            raise Unclear("it has no value")
        try:
            value = float(values[0].text)
        except ValueError:
            raise Unclear(f"its value {values[0].text.strip()[:20]!r} is no number") from None
        unit = self._unit_mm(values[0].given.get("linearUnit", ""))
        found = round(value * unit, DECIMALS) if math.isfinite(value) else value
        if not 0 < found < math.inf:
            raise Unclear(f"its value is {number(found, unit='mm')}, where one above 0 is expected")
        return found

    def _unit_mm(self, name: str) -> float:
        """The primary unit of length, or another one by its name, mm."""
        primary = list(self._root.all("FileUnits", "PrimaryUnits", "LinearUnit"))
        others = list(self._root.all("FileUnits", "OtherUnits", "LinearUnit"))
        units = [u for u in (*primary, *others) if u.word("UnitName") == name] if name else primary
        if len(units) != 1:
            raise Unclear(f"the file does not state its unit of length {name}".rstrip())
        unit = units[0]
        if unit.word("SIUnitName").lower() not in ("meter", "metre"):
            raise Unclear("its unit is not one of length")
        known = UNITS.get(unit.word("UnitName").lower())
        factor = unit.word("UnitConversion", "Factor")
        if not factor and known is None:
            raise Unclear(f"its unit {unit.word('UnitName')!r} is not known")
        try:
            metres = float(factor) if factor else float(known or 0.0)
            offset = float(unit.word("UnitConversion", "Offset") or 0.0)
        except ValueError:
            raise Unclear("the conversion of its unit is no number") from None
        clash = known is not None and abs(metres - known) > SAME * known
        if offset or clash or not 0 < metres < math.inf:
            raise Unclear(
                f"its unit {unit.word('UnitName')!r} has a conversion that is not its own"
            )
        return metres * MM_PER_METRE

    def form(self, definition: Part) -> str:
        """The form of the zone as AP242 calls it; empty where it is no round one."""
        shapes = [shape.tag for zone in definition.all("ZoneShape") for shape in zone.parts]
        if not any(one in ROUND_ZONES for one in shapes):
            return ""
        return "within a sphere" if "SphericalZone" in shapes else "within a cylinder"

    def faces(self, one: Part) -> list[NamedFace]:
        """The faces of the features that an element names, such as a nominal."""
        found = []
        for of in one.all("FeatureNominalIds", "Id"):
            feature = self._get(self._features, of)
            kind = FEATURES.get(feature.tag.removesuffix("FeatureNominal"))
            found += [NamedFace(name, kind) for name in self._names(feature)]
        return list(dict.fromkeys(found))

    def _names(self, feature: Part) -> list[str]:
        """The labels of the faces of a feature, or its own name where it names none."""
        ids = list(feature.all("EntityInternalIds", "Id"))
        labels = [self._get(self._faces, one).given.get("label", "").strip() for one in ids]
        if not ids:
            labels = [feature.word("Name")]
        if not all(labels):
            raise Unclear(f"feature #{feature.given['id']} has no label that names its face")
        return labels

    def _get(self, among: dict[str, Part], of: Part) -> Part:
        """What a reference names in this file."""
        name = of.text.strip()
        if "xId" in of.given or name not in among:
            raise Unclear(f"it names #{name}, which the file does not have there")
        return among[name]

    def datums(self, definition: Part) -> list[tuple[str, list[NamedFace]]]:
        """Letters and faces of the datums of a characteristic, by rank."""
        of = definition.one("DatumReferenceFrameId")
        if of is None:
            return []
        frame = self._get(self._frames, of)
        ranked = {}
        given = [one for group in frame.all("Datums") for one in group.parts]
        for one in given:
            rank = one.word("Precedence", "PrecedenceEnum")
            if rank not in RANKS:
                raise Unclear(f"a datum of it has the precedence {rank or 'none'!r}")
            ranked[RANKS.index(rank)] = self._datum(one)
        if len(ranked) != len(given) or sorted(ranked) != list(range(len(ranked))):
            raise Unclear("its datums have no order of precedence")
        return [ranked[k] for k in range(len(ranked))]

    def _datum(self, one: Part) -> tuple[str, list[NamedFace]]:
        """One datum of a frame, or a common datum of several."""
        simple = list(one.all("SimpleDatum"))
        for group in one.all("CompoundDatum"):
            simple += [inner for other in group.all("Datum") for inner in other.all("SimpleDatum")]
            if _more(group, frozenset({"Datum"})) or len(simple) < len(list(group.all("Datum"))):
                raise Unclear("a common datum of it is not read")
        letters, faces = [], list[NamedFace]()
        for other in simple:
            of = other.one("DatumDefinitionId")
            if of is None or _more(other, PLAIN_DATUM):
                raise Unclear("a datum of it has modifiers")
            datum = self._get(self._datums, of)
            letter = datum.word("DatumLabel")
            if datum.one("DatumTargetIds") is not None:
                raise Unclear(f"its datum {letter} is made of targets")
            found = self.faces(datum)
            if not letter or len(found) != 1:
                raise Unclear(f"its datum {letter} has {len(found)} faces, where one is expected")
            letters.append(letter)
            faces += found
        if not faces:
            raise Unclear("a datum of it is not read")
        return "-".join(letters), faces


def _more(one: Part, plain: frozenset[str]) -> list[str]:
    """Elements that change what another one means."""
    modified = ("MaterialCondition", "MaterialModifier")
    return [
        part.tag
        for part in one.parts
        if (part.tag not in plain or part.tag in modified)
        and (part.parts or part.text.strip() not in UNMODIFIED)
    ]
