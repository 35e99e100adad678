"""Rules of FMI 2.0 that schema and FMPy's validation leave open: bounds, nominal values, identifiers, binaries."""

import re
import struct
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fmpy

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.importing.xml_reading import read_document

_MACHINES = {0x3E: "x86_64", 0xB7: "aarch64", 0x03: "x86", 0x28: "arm", 0xF3: "riscv"}  # of ELF


def version_problem(file: Path) -> str:
    """Why FMI 2.0's rules do not apply to an FMU: of another version, or no readable description; else empty."""
    with zipfile.ZipFile(file) as archive:
        try:
            content = archive.read("modelDescription.xml")
        except KeyError:
            return "has no modelDescription.xml"
    try:
        version = read_document(content, "modelDescription.xml").get("fmiVersion")
    except InputError as error:
        return str(error)
    return "" if version == "2.0" else f"is of FMI {version}; only FMI 2.0 is supported"


def rule_problems(file: Path) -> list[str]:
    """Violations in the description of an FMI 2.0 co-simulation unit; none for units that are no such."""
    try:
        description = unit_description(file, "", "")
    except InputError:
        return []
    problems = [f"{v.name} {text}" for v in description.modelVariables for text in _variable(v)]
    identifier = description.coSimulation.modelIdentifier
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", identifier):
        problems.append(f"modelIdentifier must be a C identifier, which names the library, got {identifier!r}")
    with zipfile.ZipFile(file) as archive:
        problems += _architecture(archive, identifier)
    return problems


def platform_note(file: Path) -> str:
    """A note for an FMU without a binary for this machine; else empty."""
    try:
        identifier = unit_description(file, "", "").coSimulation.modelIdentifier
    except InputError:
        return ""
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
    name = f"{identifier}{fmpy.sharedLibraryExtension}"
    if any(f"binaries/{folder}/{name}" in names for folder in (fmpy.platform_tuple, fmpy.platform)):
        return ""
    present = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
    others = f"only for {', '.join(present)}" if present else "nor for any other"
    return f"has no binary for this machine ({fmpy.platform_tuple}), {others}"


def _variable(variable: Any) -> Iterator[str]:
    if variable.type not in ("Real", "Integer", "Enumeration"):
        return
    try:
        low, high = float(variable.min or "-inf"), float(variable.max or "inf")
        nominal = None if variable.nominal is None else float(variable.nominal)
        start = None if variable.start is None else float(variable.start)
    except ValueError:  # the schema's matter
        return
    if low > high:
        yield f"has min {variable.min} above max {variable.max}"
    elif start is not None and not low <= start <= high:
        yield f"has the start value {variable.start}, which is not from {low:g} to {high:g}"
    if nominal == 0.0:
        yield "has the nominal value 0"


def _architecture(archive: zipfile.ZipFile, identifier: str) -> Iterator[str]:
    """Binaries for this machine that are of another one, on Linux.

    linux64 names no CPU, and a unit that names it with a second folder, such as aarch64-linux, is right.
    """
    if not sys.platform.startswith("linux"):
        return
    for folder in (fmpy.platform_tuple, fmpy.platform):
        name = f"binaries/{folder}/{identifier}{fmpy.sharedLibraryExtension}"
        if name not in archive.namelist():
            continue
        with archive.open(name) as content:
            head = content.read(20)
        machine = fmpy.platform_tuple.partition("-")[0]
        if head[:4] != b"\x7fELF" or len(head) < 20:
            yield f"{name} is not a shared library of Linux"
            return
        found = _MACHINES.get(struct.unpack_from("<H", head, 18)[0], "another machine")
        if found != machine and f"binaries/{found}-linux/{identifier}.so" not in archive.namelist():
            yield f"{name} is for {found}, not for {machine}"
        return
