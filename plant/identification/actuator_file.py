"""Fitted hysteresis and creep as text of a structure file."""

from pathlib import Path
from typing import Any

import tomlkit

from flexbeams.plant.actuator.parameters import PatchPairActuator
from flexbeams.plant.archive import write_whole
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.hysteresis import HysteresisFit
from flexbeams.plant.structure import read_structure


def pair_text(fit: HysteresisFit) -> str:
    """The table [[actuator.pair]], each value marked as fitted with the largest residual."""
    document = tomlkit.document()
    section, tables = tomlkit.table(is_super_table=True), tomlkit.aot()
    tables.append(_table(fit))
    section.add("pair", tables)
    document.add("actuator", section)
    return tomlkit.dumps(document)


def write_pair(start: Path, pair: int, fit: HysteresisFit, path: Path) -> None:
    """Writes the structure file `start` with the entry of a patch pair (from 1) replaced.

    Raises InputError where `start` has no section [actuator] or not so many pairs.
    """
    structure = read_structure(start)
    if structure.actuator is None:
        raise InputError(
            "actuator", "is missing: the section needs the amplifier and an entry for each pair", source=str(start)
        )
    if pair > len(structure.patch):
        raise InputError("--pair", f"must be a patch pair from 1 to {len(structure.patch)}", pair)
    document: Any = tomlkit.parse(start.read_text(encoding="utf-8-sig"))
    document["actuator"]["pair"][pair - 1] = _table(fit)
    write_whole(path, tomlkit.dumps(document).encode())
    read_structure(path)


def _table(fit: HysteresisFit) -> Any:
    table = tomlkit.table()
    for name in PatchPairActuator.__dataclass_fields__:
        if name == "history":
            continue
        entry = tomlkit.item(getattr(fit.pair, name))
        table.add(name, entry)
        entry.comment(f"fitted ({fit.loops.name}, residual {100 * fit.largest:.2g} % of the stroke)")
    return table
