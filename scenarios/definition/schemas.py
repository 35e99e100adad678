"""JSON Schemas of the files that a user writes, and pages with every key."""

from collections.abc import Iterator
from typing import Any

from pydantic import TypeAdapter

from flexbeams.plant.structure import Structure
from flexbeams.scenarios.definition.key_texts import KEYS
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.study import Study

FILES: dict[str, type] = {"structure": Structure, "scenario": Scenario, "study": Study}
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a file of a kind, a key of FILES, with meaning and unit of each key.

    A unit of measurement is the entry `unit`.
    """
    schema = TypeAdapter(FILES[kind]).json_schema(by_alias=True)
    for name, table in tables(schema, FILES[kind].__name__).items():
        for key, entry in table["properties"].items():
            unit, meaning = KEYS[name][key]
            entry.pop("title", None)
            entry |= {"description": meaning, **({"unit": unit} if unit else {})}
    return {"$schema": _DIALECT, **schema, "title": f"flexbeams {kind} file (TOML)"}


def tables(schema: dict[str, Any], root: str) -> dict[str, dict[str, Any]]:
    """The tables of a schema by the name of their type, the whole file first."""
    return {root: schema, **schema.get("$defs", {})}


def key_page(kind: str) -> str:
    """Markdown: a table for each table of the file, with type, unit, default and meaning of each key."""
    schema = json_schema(kind)
    lines = [f"# Keys of a {kind} file", "", "TOML, SI units. Keys without a default must be given.", ""]
    places = _places(schema, FILES[kind].__name__)
    for name, table in tables(schema, FILES[kind].__name__).items():
        lines += [f"## {places.get(name, name)}", ""]
        if text := " ".join(str(table.get("description", "")).partition("\n\n")[0].split()):
            lines += [text, ""]
        lines += ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
        required = table.get("required", [])
        for key, entry in table["properties"].items():
            default = "" if key in required else _default(entry)
            cells = (f"`{key}`", type_text(entry), entry.get("unit", ""), default, entry["description"])
            lines.append("| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |")
        lines.append("")
    return "\n".join(lines[:-1])


def _places(schema: dict[str, Any], root: str) -> dict[str, str]:
    """How each table is written: `[[beam]]`, `[instance.<name>]`, `[[input]] step = {...}`."""
    places = {root: "The file"}
    definitions, pending = tables(schema, root), [(root, "")]
    while pending:
        name, path = pending.pop(0)
        for key, entry in definitions[name]["properties"].items():
            for target, form in _references(entry):
                if target not in places:
                    where = f"{path}.{key}" if path else key
                    where += ".<name>" if form == "table" else ""
                    places[target] = f"`[[{where}]]`" if form == "list" else f"`[{where}]`"
                    pending.append((target, where))
    return places


def _references(entry: dict[str, Any], form: str = "") -> Iterator[tuple[str, str]]:
    if "$ref" in entry:
        yield entry["$ref"].rpartition("/")[2], form
    for option in [*entry.get("anyOf", []), *entry.get("allOf", [])]:
        yield from _references(option, form)
    if isinstance(entry.get("items"), dict):
        yield from _references(entry["items"], "list")
    if isinstance(entry.get("additionalProperties"), dict):
        yield from _references(entry["additionalProperties"], "table")


def type_text(entry: dict[str, Any]) -> str:
    """The type of a key in words, with its bounds."""
    if "$ref" in entry:
        return "table"
    if options := entry.get("anyOf") or entry.get("allOf"):
        return " or ".join(dict.fromkeys(type_text(o) for o in options if o.get("type") != "null"))
    if "const" in entry or "enum" in entry:
        return ", ".join(f"`{value}`" for value in entry.get("enum", [entry.get("const")]))
    if entry.get("type") == "array":
        inner = entry.get("items", {})
        if "prefixItems" in entry:
            return f"list of {len(entry['prefixItems'])} integers"
        word, _, limits = type_text(inner).partition(" ")
        return f"list of {word}s {limits}".strip() if inner else "list"
    if entry.get("type") == "object":
        inner = entry.get("additionalProperties")
        return f"table of {type_text(inner)}" if isinstance(inner, dict) and "$ref" not in inner else "tables"
    bounds = [
        f"{sign} {entry[key]:g}"
        for key, sign in (("exclusiveMinimum", ">"), ("minimum", ">="), ("exclusiveMaximum", "<"), ("maximum", "<="))
        if key in entry and abs(entry[key]) < 1e15
    ]
    return " ".join([str(entry.get("type", "")), *bounds]).strip()


def _default(entry: dict[str, Any]) -> str:
    value = entry.get("default")
    if value is None or value in ({}, [], ""):
        return "none"
    return (
        f"`{str(value).lower() if isinstance(value, bool) else value}`" if not isinstance(value, dict) else "see below"
    )
