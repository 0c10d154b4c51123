"""Does a JSON value agree with a schema? As much of JSON Schema as OpenAPI documents here use."""

from __future__ import annotations

import re

TYPES = {
    "string": str,
    "integer": int,
    "number": (int, float),
    "boolean": bool,
    "array": list,
    "object": dict,
    "null": type(None),
}
KNOWN = {
    *("$ref", "type", "anyOf", "enum", "const", "properties", "required", "items", "prefixItems"),
    *("additionalProperties", "minItems", "maxItems", "minimum", "maximum", "maxLength", "pattern"),
    *("title", "description", "default", "format", "minLength"),
}


def wrong(value, schema, document, where="$"):
    """What does not agree, in words, one for each."""
    assert set(schema) <= KNOWN, set(schema) - KNOWN
    if "$ref" in schema:
        name = schema["$ref"].removeprefix("#/components/schemas/")
        return wrong(value, document["components"]["schemas"][name], document, where)
    if "anyOf" in schema:
        found = [wrong(value, one, document, where) for one in schema["anyOf"]]
        return [] if [] in found else [f"{where}: none of {len(found)}: {found}"]
    kind = schema.get("type")
    if kind and (
        not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != "boolean")
    ):
        return [f"{where}: expected {kind}, got {value!r}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{where}: {value!r} is none of {schema['enum']}"]
    if "const" in schema and value != schema["const"]:
        return [f"{where}: {value!r} is not {schema['const']!r}"]
    return [*_limits(value, schema, where), *_parts(value, schema, document, where)]


def _limits(value, schema, where):
    checks = {
        "minimum": lambda v, top: v >= top,
        "maximum": lambda v, top: v <= top,
        "minLength": lambda v, least: len(v) >= least,
        "maxLength": lambda v, top: len(v) <= top,
        "minItems": lambda v, top: len(v) >= top,
        "maxItems": lambda v, top: len(v) <= top,
        "pattern": lambda v, pattern: re.search(pattern, v) is not None,
    }
    return [
        f"{where}: {value!r} breaks {name} {schema[name]}"
        for name, keeps in checks.items()
        if name in schema and not keeps(value, schema[name])
    ]


def _parts(value, schema, document, where):
    if isinstance(value, list):
        first = schema.get("prefixItems", [])
        kinds = first + [schema.get("items", {})] * (len(value) - len(first))
        for k, (part, kind) in enumerate(zip(value, kinds, strict=True)):
            yield from wrong(part, kind, document, f"{where}[{k}]")
    if isinstance(value, dict):
        known = schema.get("properties", {})
        yield from (f"{where}.{n}: missing" for n in schema.get("required", []) if n not in value)
        more = schema.get("additionalProperties", not known)
        for name, part in value.items():
            kind = known.get(name, more)
            if kind is False or (kind is True and known):
                yield f"{where}.{name}: unknown"
            elif isinstance(kind, dict):
                yield from wrong(part, kind, document, f"{where}.{name}")
