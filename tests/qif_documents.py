"""QIF 3 documents whose characteristics name faces of tests/drawings/tolerances.step."""

from __future__ import annotations

import re

SHELL = """<?xml version="1.0" encoding="UTF-8"?>
<QIFDocument xmlns="http://qifstandards.org/xsd/qif3" versionQIF="3.0.0" idMax="99">
  <QPId>f1500f6c-50a1-4a17-8f9b-128512e750fc</QPId>
  <FileUnits><PrimaryUnits><LinearUnit><SIUnitName>meter</SIUnitName>
    <UnitName>mm</UnitName><UnitConversion><Factor>0.001</Factor></UnitConversion>
  </LinearUnit></PrimaryUnits>
  <OtherUnits><LinearUnit><SIUnitName>meter</SIUnitName><UnitName>inch</UnitName></LinearUnit>
  </OtherUnits></FileUnits>
  <DatumDefinitions n="3">
    <DatumDefinition id="60"><DatumLabel>A</DatumLabel>
      <FeatureNominalIds n="1"><Id>42</Id></FeatureNominalIds></DatumDefinition>
    <DatumDefinition id="61"><DatumLabel>B</DatumLabel>
      <FeatureNominalIds n="1"><Id>43</Id></FeatureNominalIds></DatumDefinition>
    <DatumDefinition id="62"><DatumLabel>T</DatumLabel><DatumTargetIds n="1"><Id>9</Id>
      </DatumTargetIds></DatumDefinition>
  </DatumDefinitions>
  <DatumReferenceFrames n="5">
    <DatumReferenceFrame id="70"><Datums n="1">DATUM60</Datums></DatumReferenceFrame>
    <DatumReferenceFrame id="71"><Datums n="2">SECOND60 DATUM61</Datums></DatumReferenceFrame>
    <DatumReferenceFrame id="72"><Datums n="1">DATUM61</Datums></DatumReferenceFrame>
    <DatumReferenceFrame id="73"><Datums n="1">DATUM62</Datums></DatumReferenceFrame>
    <DatumReferenceFrame id="74"><Datums n="1"><Datum><SimpleDatum>
      <DatumDefinitionId>60</DatumDefinitionId><MaterialModifier>MAXIMUM</MaterialModifier>
      </SimpleDatum><Precedence><PrecedenceEnum>PRIMARY</PrecedenceEnum></Precedence></Datum>
      </Datums></DatumReferenceFrame>
    <DatumReferenceFrame id="75"><Datums n="1"><Datum><CompoundDatum n="2">
      <Datum><SimpleDatum><DatumDefinitionId>60</DatumDefinitionId></SimpleDatum></Datum>
      <Datum><SimpleDatum><DatumDefinitionId>63</DatumDefinitionId></SimpleDatum></Datum>
      </CompoundDatum><Precedence><PrecedenceEnum>PRIMARY</PrecedenceEnum></Precedence></Datum>
      </Datums></DatumReferenceFrame>
  </DatumReferenceFrames>
  <Product><TopologySet><FaceSet n="2"><Face id="30" label="top"/><Face id="31"/>
    <Face id="32" label="bore"/></FaceSet></TopologySet></Product>
  <Features><FeatureNominals n="6">
    <PlaneFeatureNominal id="41"><Name>upper side</Name>
      <EntityInternalIds n="1"><Id>30</Id></EntityInternalIds></PlaneFeatureNominal>
    <PlaneFeatureNominal id="42"><Name>base</Name></PlaneFeatureNominal>
    <CylinderFeatureNominal id="43"><EntityInternalIds n="1"><Id>32</Id></EntityInternalIds>
      </CylinderFeatureNominal>
    <PlaneFeatureNominal id="44"><EntityInternalIds n="1"><Id>31</Id></EntityInternalIds>
      </PlaneFeatureNominal>
    <PlaneFeatureNominal id="45"><Name>ball</Name></PlaneFeatureNominal>
    <PointDefinedSurfaceFeatureNominal id="46"><Name>wall</Name>
      </PointDefinedSurfaceFeatureNominal>
    <PlaneFeatureNominal id="47"><Name>lid</Name></PlaneFeatureNominal>
  </FeatureNominals></Features>
  <Characteristics><CharacteristicDefinitions n="1">DEFINITIONS</CharacteristicDefinitions>
  <CharacteristicNominals n="1">NOMINALS</CharacteristicNominals></Characteristics>
</QIFDocument>
"""
DIAMETER = "<ZoneShape><DiametricalZone/></ZoneShape>"
MM = "<ToleranceValue>0.05</ToleranceValue>"


def frame(number):
    return f"<DatumReferenceFrameId>{number}</DatumReferenceFrameId>"


TAKEN = {
    ("Flatness", 41, MM): ("iso_flatness", "plane", ("top",), (), 0.05),
    ("Circularity", 43, '<ToleranceValue linearUnit="inch">0.001</ToleranceValue>'): (
        "iso_roundness", "cylinder", ("bore",), (), 0.0254,
    ),
    ("SurfaceProfile", 46, MM): ("iso_surface_profile", "plane", ("wall",), (), 0.05),
    ("Parallelism", 41, MM + frame(70) + "<MaterialCondition>REGARDLESS</MaterialCondition>"): (
        "iso_parallelism", "plane", ("top",), ("A",), 0.05,
    ),
    ("Perpendicularity", 43, MM + frame(70) + DIAMETER): (
        "iso_perpendicularity", "cylinder", ("bore",), ("A",), 0.05,
    ),
    ("TotalRunout", 42, MM + frame(72) + "<TangentPlane>false</TangentPlane>"): (
        "iso_total_run_out", "plane", ("base",), ("B",), 0.05,
    ),
    ("Parallelism", 41, MM + frame(71)): (
        "iso_parallelism", "plane", ("top",), ("B", "A"), 0.05,
    ),
}  # fmt: skip
"""Characteristics that a recipe has: kind, feature and definition."""
LEFT = {
    ("Flatness", 44, MM): "feature #44 has no label that names its face",
    ("Flatness", 45, MM): "'ball' is a plane, and in the drawing a sphere",
    ("Flatness", 47, MM): "the drawing has no face with the name 'lid'",
    ("Flatness", 99, MM): "it names #99, which the file does not have there",
    ("Flatness", 43, MM): "expected a plane, got a cylinder",
    ("Flatness", 41, ""): "it has no value",
    ("Flatness", 41, "<ToleranceValue>nan</ToleranceValue>"): "where one above 0 is expected",
    ("Flatness", 41, "<ToleranceValue>thin</ToleranceValue>"): "its value 'thin' is no number",
    ("Flatness", 41, '<ToleranceValue linearUnit="ell">1</ToleranceValue>'): (
        "the file does not state its unit of length ell"
    ),
    ("Flatness", 41, MM + "<ToleranceZonePerUnitArea><A>1</A></ToleranceZonePerUnitArea>"): (
        "it has ToleranceZonePerUnitArea, which recipes do not have"
    ),
    ("Flatness", 41, MM + frame(70)): "recipes take no datum for it, got 1",
    ("Parallelism", 41, MM): "recipes take 1 to 3 datums for it, got 0",
    ("Parallelism", 41, MM + frame(73)): "its datum T is made of targets",
    ("Parallelism", 41, MM + frame(74)): "a datum of it has modifiers",
    ("Parallelism", 41, MM + frame(75)): "it names #63, which the file does not have there",
    ("Parallelism", 43, MM + frame(70)): "its zone is of a width",
    ("Parallelism", 41, MM + frame(70) + "<MaterialCondition>MAXIMUM</MaterialCondition>"): (
        "it has MaterialCondition, which recipes do not have"
    ),
    ("CircularRunout", 43, MM + frame(70)): "its datum A is a plane, where a cylinder is expected",
    ("Position", 43, MM + frame(70) + DIAMETER): "its exact place in the frame",
    ("Diameter", 43, ""): "dimensions are not read",
}
"""Those that it does not have, and why."""


def datum(number, rank):
    return (
        f"<Datum><SimpleDatum><DatumDefinitionId>{number}</DatumDefinitionId></SimpleDatum>"
        f"<Precedence><PrecedenceEnum>{rank}</PrecedenceEnum></Precedence></Datum>"
    )


def document(cases):
    """A QIF document with the given characteristics, numbered from 100 and 200."""
    text = SHELL
    for word, rank in (("DATUM", "PRIMARY"), ("SECOND", "SECONDARY")):
        text = re.sub(rf"{word}(\d\d)", lambda m, rank=rank: datum(m[1], rank), text)
    definitions, nominals = [], []
    for k, (kind, feature, inner) in enumerate(cases):
        definitions.append(
            f'<{kind}CharacteristicDefinition id="{100 + k}">{inner}'
            f"</{kind}CharacteristicDefinition>"
        )
        nominals.append(
            f'<{kind}CharacteristicNominal id="{200 + k}"><CharacteristicDefinitionId>{100 + k}'
            f'</CharacteristicDefinitionId><FeatureNominalIds n="1"><Id>{feature}</Id>'
            f"</FeatureNominalIds></{kind}CharacteristicNominal>"
        )
    text = text.replace("DEFINITIONS", "".join(definitions))
    return text.replace("NOMINALS", "".join(nominals))
