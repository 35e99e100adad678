"""The data of a native unit as C: constant tables, doubles in hexadecimal, which compilers read alike."""

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface, Variable, bounds
from flexbeams.fmus.units.native_kernel import (
    NATIVE,
    Fields,
    NativeKernel,
    Records,
    Table,
    Text,
    UnitData,
    header_constant,
)

NAME_SIZE = header_constant(NATIVE / "units" / "unit.h", "NAME_SIZE")  # characters and their end
TEXT_SIZE = header_constant(NATIVE / "units" / "unit.h", "TEXT_SIZE")
PANEL = header_constant(NATIVE / "numerics" / "linear_algebra.h", "PANEL")  # rows
_TYPES = ("Real", "Integer", "Boolean", "String")
_CAUSALITIES = ("independent", "parameter", "input", "output", "local")


def heading(interface: Interface) -> str:
    """The comment on top of generated tables."""
    designs = [v.start for v in interface if v.name == "design_id"]
    lines = [f"Generated: the tables of {interface.unit_name}, included by {interface.unit_name}.c."]
    lines += [f"Design id: {design}" for design in designs]
    lines += ["Numbers are in SI units, hexadecimal so that no digit is lost; comments repeat some as decimals."]
    return "/* " + "\n   ".join(lines) + " */\n"


def kernel_data(name: str, kernel: NativeKernel, interface: Interface, data: UnitData) -> list[str]:
    """The struct `name` of a kernel's data, behind the arrays that it points to."""
    arrays: list[str] = []
    fields = kernel.data(interface, data)
    value = _struct(fields, f"{name.removeprefix('unit_')}_", arrays)
    lines = [f"    {entry}," for entry in value]
    return [*arrays, "\n".join([f"static const {kernel.data_type} {name} = {{", *lines, "};", ""])]


def _struct(fields: Fields, prefix: str, arrays: list[str]) -> list[str]:
    """Designated initialisers of the fields; arrays among them are added to `arrays` and named by the prefix."""
    entries = []
    for key, value in fields.items():
        if isinstance(value, Mapping):
            text = "{" + ", ".join(_struct(value, f"{prefix}{key}_", arrays)) + "}"
        elif isinstance(value, Table | Records):
            text = prefix + key
            arrays.append(_table(text, value) if isinstance(value, Table) else _records(text, value))
        elif isinstance(value, Text):
            text = c_text(value.text, NAME_SIZE)
        else:
            text = value if isinstance(value, str) else _number(value)
        entries.append(f".{key} = {text}")
    return entries


def _number(value: float) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return c_real(value)
    return f"{value}u" if value >= 2**31 else str(value)


def _table(name: str, table: Table) -> str:
    values = np.asarray(table.values)
    if values.dtype == np.uint8:
        return c_array(f"unsigned char {name}[]", table.comment, [str(v) for v in values.tolist()], 24)
    if values.dtype == np.uint32:
        return c_array(f"unsigned {name}[]", table.comment, [str(v) for v in values.tolist()], 16)
    if not np.isfinite(values).all():
        raise BuildError(f"{name} must be finite")
    comment = table.comment + (f"; in panels of {PANEL} rows" if table.in_panels else "")
    for title, matrix in table.decimals.items():
        comment += f".\n   {title}, row by row:\n" + "\n".join(map(_decimals, matrix))
    numbers = panels(values) if table.in_panels else values.ravel()
    declaration = f"double {name}[]" + (" ALIGNED" if table.in_panels else "")
    return c_array(declaration, comment, list(map(float.hex, numbers.astype(np.float64).tolist())), 4)


def _decimals(row: NDArray[Any]) -> str:
    """A row of a matrix, six digits of each number, as lines of a comment."""
    lines = _lines([f"{value:.6g}" for value in row.tolist()], 8)
    return "\n".join(f"{'     ' if k == 0 else '       '}{', '.join(line)}" for k, line in enumerate(lines))


def _records(name: str, records: Records) -> str:
    rows = ["{" + ", ".join(_struct(row, "", [])) + "}" for row in records.rows]
    return c_array(f"{records.type} {name}[]", records.comment, rows, 1)


def panels(matrix: ArrayLike) -> NDArray[np.float64]:
    """A matrix (rows, columns) as linear_algebra.h stores it: panels of 8 rows, each column by column."""
    rows = np.asarray(matrix, dtype=np.float64)
    padded = np.zeros((-(-len(rows) // PANEL) * PANEL, rows.shape[1]))
    padded[: len(rows)] = rows
    return padded.reshape(-1, PANEL, rows.shape[1]).transpose(0, 2, 1).ravel()


def description_tables(interface: Interface, guid: str, hooks: str, data: str, deferred: Collection[str]) -> list[str]:
    """The unit's description of instance.h and its tables; arrays that are `deferred` are computed when read."""
    texts: list[str] = []
    kinds, variables = [], []
    for reference, variable in enumerate(interface):
        start: float | str | None = variable.start
        if variable.type == "String":
            if variable.causality in ("parameter", "input"):
                raise BuildError(f"{interface.unit_name}: {variable.name} must be constant, as all native texts")
            texts.append(str(start or ""))
            start = len(texts) - 1
        kinds.append(_kind(variable, variable.array in deferred))
        low, high = bounds(variable)
        variables.append(
            f"    {{.start = {c_real(float(start or 0.0))}, .minimum = {c_real(low)}, .maximum = {c_real(high)}, "
            f".name = {c_text(variable.name, NAME_SIZE)}}}, /* {reference}{_shown(variable)} */"
        )
    digest = hashlib.sha256(guid.encode()).digest()
    results = [f"{{{span.start}, {len(span)}}}" for span in _results(interface, deferred)]
    return [
        c_array("unsigned char unit_kinds[]", "type, causality and more of each variable", [str(k) for k in kinds], 24),
        "/* the variables by value reference: start value and bounds, and as decimals with their unit */\n"
        + "\n".join(["static const Variable unit_variables[] = {", *variables, "};", ""]),
        c_array("char unit_texts[][TEXT_SIZE]", "the strings", [c_text(t, TEXT_SIZE) for t in texts or [""]], 1),
        c_array("Results unit_results[]", "variables that a step computes: first and number", results or ["{0, 0}"], 8),
        "\n".join(
            [
                "SHARED_DATA const UnitDescription this_unit = {",
                f"    .hooks = &{hooks},",
                f"    .data = &{data},",
                f"    .guid = {c_text(guid, TEXT_SIZE)},",
                "    .digest = {",
                *[f"        {', '.join(map(str, line))}," for line in _lines(list(digest), 16)],
                "    },",
                f"    .step_size = {c_real(interface.step_size)}, /* {interface.step_size:g} s */",
                f"    .interpolates_inputs = {'true' if interface.can_interpolate_inputs else 'false'},",
                f"    .provides_derivatives = {'true' if interface.provides_directional_derivative else 'false'},",
                f"    .variable_count = {len(variables)},",
                "    .kinds = unit_kinds,",
                "    .variables = unit_variables,",
                "    .texts = unit_texts,",
                f"    .result_count = {len(results)},",
                "    .results = unit_results,",
                "};",
                "",
            ]
        ),
    ]


def _results(interface: Interface, deferred: Collection[str]) -> list[range]:
    """Value references of the variables that a step computes at once, those in a row in one range."""
    spans: list[range] = []
    for k, v in enumerate(interface):
        if v.causality not in ("output", "local") or v.type == "String" or v.array in deferred:
            continue
        joined = spans and spans[-1].stop == k
        spans[-1:] = [range(spans[-1].start, k + 1)] if joined else [*spans[-1:], range(k, k + 1)]
    return spans


def _kind(variable: Variable, deferred: bool) -> int:
    kind = _TYPES.index(variable.type) | _CAUSALITIES.index(variable.causality) << 2
    return kind | 32 * (variable.variability == "fixed") | 64 * deferred


def _shown(variable: Variable) -> str:
    """Start value and bounds for a comment."""
    if variable.start is None or variable.type == "String":
        return ""
    unit = "" if variable.unit in (None, "1") else f" {variable.unit}"
    bounds = [
        f"{word} {bound:g}"
        for word, bound in (("from", variable.minimum), ("to", variable.maximum))
        if bound is not None
    ]
    return f": {float(variable.start):g}{unit}" + (f", {' '.join(bounds)}" if bounds else "")


def _lines(items: Sequence[Any], length: int) -> list[Sequence[Any]]:
    """The items in order, so many in a line."""
    return [items[k : k + length] for k in range(0, len(items), length)]


def c_array(declaration: str, comment: str, items: Sequence[str], in_a_line: int) -> str:
    """A constant array with a comment above it."""
    lines = [f"    {', '.join(line)}," for line in _lines(items, in_a_line)]
    return "\n".join([f"/* {comment} */", f"static const {declaration} = {{", *lines, "};", ""])


def c_real(value: float) -> str:
    """A double with all its digits; for an infinite one the largest finite one, which compilers take as a constant."""
    number = float(value)
    return number.hex() if math.isfinite(number) else "DBL_MAX" if number > 0 else "-DBL_MAX"


def c_text(text: str, size: int) -> str:
    """A string of fewer than `size` characters; BuildError for one that is longer or not plain."""
    if not text.isascii() or not text.isprintable() or len(text) >= size or set(text) & set('"\\?'):
        raise BuildError(f"{text!r} must be plain ASCII of fewer than {size} characters")
    return f'"{text}"'
