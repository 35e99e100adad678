"""Validation of TOML tables as dataclasses, with one-line errors that name file, key, rule and value."""

import tomllib
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import is_pydantic_dataclass, rebuild_dataclass

from flexbeams.plant.errors import InputError, suggestion

STRICT = ConfigDict(extra="forbid", defer_build=True)  # a validator is built when it is first used

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, strict=True, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, strict=True, allow_inf_nan=False)]
Index = Annotated[int, Field(ge=1, strict=True)]

T = TypeVar("T")

_RULES = {
    "missing": "is missing",
    "finite_number": "must be finite",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_type": "must be an integer",
    "string_type": "must be a string",
    "bool_type": "must be true or false",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "dict_type": "must be a table",
    "dataclass_type": "must be a table",
}


def read_text(path: Path) -> str:
    """The text of a UTF-8 file; InputError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("", f"is not UTF-8 text: {error.reason}", source=str(path)) from None
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=str(path)) from None


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The table of a TOML text; InputError where it is not TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also integers of thousands of digits and endless nesting
        raise InputError("", f"is not valid TOML: {error}", source=source) from None


def read_toml(path: Path) -> dict[str, Any]:
    """The table of a TOML file; InputError where it cannot be read or is not TOML."""
    return parse_toml(read_text(path), str(path))


def validate(kind: type[T], table: object, source: str) -> T:
    """`table` as an instance of the pydantic dataclass `kind`; raises InputError for the first fault."""
    try:
        if is_pydantic_dataclass(kind):
            rebuild_dataclass(kind)  # builds its validator, which replace() then finds as well
        return TypeAdapter(kind).validate_python(table)
    except ValidationError as error:
        raise _one_line(error, kind, source) from None
    except InputError as error:
        raise error.at(source) from None


def key_text(location: tuple[int | str, ...]) -> str:
    """A pydantic location as a key with indices from 1: ("beam", 1, "length") is beam[2].length."""
    text = ""
    for part in location:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _one_line(error: ValidationError, kind: type, source: str) -> InputError:
    faults = error.errors()
    # An unknown key often explains a missing one (a typo), so it comes first.
    fault = next((f for f in faults if f["type"] in ("unexpected_keyword_argument", "extra_forbidden")), faults[0])
    key, value = key_text(tuple(p for p in fault["loc"] if not _is_union_branch(p))), fault["input"]
    original = fault.get("ctx", {}).get("error")
    if isinstance(original, InputError):
        prefix = f"{key}." if key and not original.key.startswith("[") else key
        return original.at(source, prefix if original.key else key)
    if fault["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
        return InputError(
            key, "is not a known key" + suggestion(str(fault["loc"][-1]), _keys_at(kind, fault["loc"])), source=source
        )
    if fault["type"] == "missing":
        return InputError(key, "is missing", source=source)
    rule = _RULES.get(fault["type"]) or fault["msg"].replace("Input should be", "must be", 1)
    rule = rule.replace("String should match", "must match", 1)
    rule = rule.replace("greater than or equal to", ">=").replace("greater than", "finite and >")
    if fault["type"] in ("too_long", "too_short"):
        bounds = fault["ctx"]
        rule = f"must have {bounds.get('max_length', bounds.get('min_length'))} entries"
        rule = rule.replace("have", "have at most" if fault["type"] == "too_long" else "have at least")
    rule = rule.replace("less than or equal to", "<=").replace("less than", "<")
    if fault["type"] == "literal_error" and isinstance(value, str):
        near = get_close_matches(value, fault["ctx"]["expected"].split("'")[1::2], n=1, cutoff=0.5)
        rule += f"; did you mean {near[0]!r}?" if near else ""
    if fault["type"] in ("list_type", "tuple_type") and isinstance(value, dict):
        return InputError(key, f"must be a list: [[{key}]] begins each of its tables", source=source)
    displayed = value if isinstance(value, (str, int, float, bool, list)) else type(value).__name__
    return InputError(key, rule, displayed, source=source)


def _is_union_branch(part: int | str) -> bool:
    """Whether a part of a pydantic location names a member of a union instead of a key."""
    return part in ("float", "bool", "int", "str") or str(part).startswith(("list[", "literal["))


def _keys_at(kind: type, location: tuple[int | str, ...]) -> list[str]:
    """The valid keys of the table that contains the last part of `location`, from the JSON schema."""
    schema = TypeAdapter(kind).json_schema(by_alias=True)
    definitions = schema.get("$defs", {})

    def resolve(node: dict[str, Any]) -> dict[str, Any]:
        while "$ref" in node:
            node = definitions[node["$ref"].rsplit("/", 1)[1]]
        return node

    def present(node: dict[str, Any]) -> dict[str, Any]:
        options = [resolve(option) for option in node.get("anyOf", node.get("oneOf", [node]))]
        return next((o for o in options if o.get("type") != "null"), options[0])

    node = present(resolve(schema))
    for part in location[:-1]:
        if isinstance(part, int):
            node = resolve(node.get("items", {}))
        elif "properties" in node and part in node["properties"]:
            node = resolve(node["properties"][part])
        elif isinstance(node.get("additionalProperties"), dict):
            node = resolve(node["additionalProperties"])
        node = present(node)
    return list(node.get("properties", {}))
