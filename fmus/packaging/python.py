"""Packs a kernel and its data into a Python unit (pythonfmu).

A unit carries two modules, `<name>.py` and `<name>_kernel.py`, and `data.npz`; the name contains the hash of all
contents, since the units of a process share one `sys.modules`. pythonfmu's builder loads the unit and adds
its binaries in a process of its own; then the archive is written again, reproducibly, with our
modelDescription.xml.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version as installed_version
from pathlib import Path

import numpy as np

from flexbeams.fmus.documents.description import content_guid, model_description
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.fmus.units.native_kernel import UnitData
from flexbeams.plant.archive import npz_bytes, write_whole, zip_bytes
from flexbeams.plant.temporary import temporary_folder

_ROOT = Path(__file__).parents[2]
_PROJECT = "flexbeams"

# The wrapper runs the entry module once more for every instance: classes defined here would pile up. It
# also releases a reference to the module's dictionary that it does not own; one more compensates for it.
_ENTRY = '''"""{unit}: entry for the pythonfmu wrapper."""

import ctypes

from {name}_kernel import {class_name}

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))
'''

_BUILDER = """
import json, sys
from pythonfmu.builder import FmuBuilder

for script, project_files, out in json.loads(sys.argv[1]):
    FmuBuilder.build_FMU(script, dest=out, project_files=project_files)
"""


@dataclass(frozen=True, kw_only=True)
class PythonUnit:
    """A unit to be built with the Python kernel of its kind into the file `out`."""

    kind: UnitKind
    interface: Interface
    data: UnitData
    out: Path


def build_python_units(units: Sequence[PythonUnit], **attributes: str) -> list[Path]:
    """Build several units in one subprocess and return their files.

    `attributes` (version, license) go into modelDescription.xml. Equal arguments give equal bytes. Raises
    BuildError where a kernel cannot be bundled or does not load.
    """
    with temporary_folder() as temporary:
        folders = [temporary / str(i) for i in range(len(units))]
        jobs = []
        descriptions = []
        for unit, folder in zip(units, folders, strict=True):
            folder.mkdir()
            name, description = write_sources(unit, folder, **attributes)
            project_files = [str(folder / f"{name}_kernel.py"), str(folder / "data.npz")]
            jobs.append((str(folder / f"{name}.py"), project_files, str(folder / "unit.fmu")))
            descriptions.append(description)
        _run_builder(jobs, str(temporary), ", ".join(unit.interface.unit_name for unit in units))
        for unit, folder, description in zip(units, folders, descriptions, strict=True):
            write_whole(unit.out, _repacked(folder / "unit.fmu", description))
    return [unit.out for unit in units]


def write_sources(unit: PythonUnit, folder: Path, **attributes: str) -> tuple[str, bytes]:
    """Write a unit's modules and data file to a folder; returns the entry module's name and the description."""
    interface = replace(unit.interface, needs_execution_tool=True, cannot_use_memory_management=True)
    script, class_name = bundled_script(unit.kind.require_python())
    data = data_file(interface, unit.data)
    wrapper = f"pythonfmu {installed_version('pythonfmu')}".encode()
    guid = content_guid(model_description(interface, **attributes), script.encode(), data, wrapper)
    snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", interface.unit_name).lower()
    name = f"flexbeams_{snake}_{guid.replace('-', '')[1:13]}"
    entry = _ENTRY.format(unit=interface.unit_name, name=name, class_name=class_name)
    (folder / f"{name}.py").write_text(entry, encoding="utf-8", newline="\n")
    (folder / f"{name}_kernel.py").write_text(script, encoding="utf-8", newline="\n")
    (folder / "data.npz").write_bytes(data)
    return name, model_description(interface, guid=guid, **attributes)


def data_file(interface: Interface, data: UnitData) -> bytes:
    """The .npz file of a unit, reproducible: its arrays, and interface and plain values as JSON in UTF-8 bytes."""
    texts = {"interface": interface.to_json(), "meta": json.dumps(data.meta, sort_keys=True, allow_nan=False)}
    arrays = {name: np.frombuffer(text.encode(), np.uint8) for name, text in texts.items()}
    for name, values in data.arrays.items():
        array = np.asarray(values)
        if name in texts or array.dtype.kind not in "biuf":
            raise BuildError(f"{interface.unit_name}: data[{name!r}] must be numeric and not called {name}")
        arrays[name] = np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(array.shape)
    return npz_bytes(arrays)


def bundled_script(kernel_file: Path) -> tuple[str, str]:
    """The kernel joined with the modules of this project it builds on; also the name of its class.

    These may be imported as `from <package>.<module> import <names>` at the top level only; each precedes
    those that import it, and all share one namespace.
    """
    modules: dict[Path, str] = {}
    owners: dict[str, Path] = {}
    _bundle(kernel_file, modules, owners)
    tree = ast.parse(modules[kernel_file])
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    names = [node.name for node in classes if "Unit" in map(ast.unparse, node.bases)]
    if len(names) != 1:
        raise BuildError(f"{kernel_file}: one class must derive from Unit, got {', '.join(names) or 'none'}")
    header = (
        '"""Unit of the project flexbeams, joined from several modules."""\n\nfrom __future__ import annotations\n\n'
    )
    return header + "\n\n".join(modules.values()), names[0]


def _bundle(path: Path, modules: dict[Path, str], owners: dict[str, Path]) -> None:
    """Add a module's text, without its docstring and project imports, after those of the modules it imports."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    tree = ast.parse(text, str(path))
    for node in tree.body:
        for name in _defined(node):
            if owners.setdefault(name, path) != path:
                raise BuildError(f"{path}: {name} must be defined once in a unit, {owners[name]} has it too")
        if isinstance(node, ast.ImportFrom) and _top(node.module) == _PROJECT and node.level == 0:
            part = (_ROOT / (node.module or "").removeprefix(f"{_PROJECT}.").replace(".", "/")).with_suffix(".py")
            if not part.is_file() or any(alias.asname or alias.name == "*" for alias in node.names):
                raise BuildError(
                    f"{path}: must import plain names of a module of this project, got {ast.unparse(node)}"
                )
            if part not in modules:
                _bundle(part, modules, owners)
        else:
            _refuse_project_imports(node, path)
            is_docstring = node is tree.body[0] and ast.get_docstring(tree) is not None
            if not is_docstring and not ast.unparse(node).startswith("from __future__"):
                continue
        last = node.end_lineno or node.lineno
        lines[node.lineno - 1 : last] = [""] * (last - node.lineno + 1)
    modules[path] = "".join(lines).strip() + "\n"


def _defined(node: ast.stmt) -> list[str]:
    if isinstance(node, (ast.ClassDef, ast.FunctionDef)):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _refuse_project_imports(node: ast.stmt, path: Path) -> None:
    for inner in ast.walk(node):
        names = []
        if isinstance(inner, ast.Import):
            names = [alias.name for alias in inner.names]
        elif isinstance(inner, ast.ImportFrom):
            names = ["." * inner.level + (inner.module or "")]
        for name in names:
            if _top(name) == _PROJECT or name.startswith("."):
                raise BuildError(f"{path}: must import from this project by `from ... import` at the top, got {name}")


def _top(module: str | None) -> str:
    return (module or "").partition(".")[0]


def _run_builder(jobs: Sequence[tuple[str, list[str], str]], folder: str, names: str) -> None:
    command = [sys.executable, "-c", _BUILDER, json.dumps(jobs)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    if done.returncode != 0:
        reason = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        raise BuildError(f"{names}: pythonfmu could not build the unit: {reason[0]}")


def _repacked(built: Path, description: bytes) -> bytes:
    with zipfile.ZipFile(built) as archive:
        entries = {name.replace("\\", "/"): archive.read(name) for name in archive.namelist()}
    entries["modelDescription.xml"] = description
    return zip_bytes(entries)
