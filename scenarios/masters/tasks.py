"""Stop time, step and signals of a package, and a private folder for temporary files of tools."""

import math
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from fmpy import read_model_description

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.osp import read_osp
from flexbeams.scenarios.importing.package import Package, is_package
from flexbeams.scenarios.importing.ssp import open_package
from flexbeams.scenarios.masters.trace import Fault, Task

# Of tools that read single units
NO_SSP = Fault(
    name="no SSP",
    description="It reads FMUs only.",
    remedy="Units and connections are read from the package and passed.",
)
FOLDERS_LEFT = Fault(
    name="folders left behind",
    description="Extracted units stay in the folder for temporary files.",
    remedy="That folder is replaced by one that is removed.",
)


def read_task(
    file: Path, *, stop_time: float | None = None, step: float | None = None, signals: Sequence[str] | None = None
) -> Task:
    """The task to run an SSP or an OspSystemStructure.xml; without `signals` it records all Real outputs.

    Raises InputError for any other file, for a package without stop time or step where none is given, for a stop time
    that is not a positive multiple of the step, and for signals that are not Real outputs.
    """
    own_stop, own_step, outputs = _from_ssp(file) if is_package(file.name) else _from_osp(file)
    stop_time, step = own_stop if stop_time is None else stop_time, own_step if step is None else step
    if stop_time is None or step is None:
        raise InputError("", "must have a stop time and a step", source=str(file))
    if not (math.isfinite(step) and step > 0):
        raise InputError("step", "must be finite and > 0", step, source=str(file))
    if not (
        math.isfinite(stop_time)
        and abs(stop_time / step - round(stop_time / step)) < 1e-6
        and round(stop_time / step) > 0
    ):
        raise InputError(
            "stop_time", f"must be a whole number of steps of {step:g} s, at least one", stop_time, source=str(file)
        )
    known = tuple(f"{name}.{output}" for name, variables in outputs.items() for output in variables)
    for signal in signals or ():
        if signal not in known:
            raise InputError(
                "signals", f"must be Real outputs of the package{suggestion(signal, known)}", signal, source=str(file)
            )
    return Task(
        file=file,
        step=step,
        steps=round(stop_time / step),
        components=tuple(outputs),
        signals=known if signals is None else tuple(signals),
    )


def _from_ssp(file: Path) -> tuple[float | None, float | None, dict[str, list[str]]]:
    with unpacked(file) as package:
        pass
    return (
        package.stop_time,
        package.step,
        {
            name: [c.name for c in component.connectors.values() if c.kind == "output"]
            for name, component in package.components.items()
        },
    )


def _from_osp(file: Path) -> tuple[float | None, float | None, dict[str, list[str]]]:
    system = read_osp(file)
    outputs = {
        name: [
            v.name
            for v in read_model_description(str(fmu)).modelVariables
            if v.causality == "output" and v.type == "Real"
        ]
        for name, fmu in system.simulators.items()
    }
    return system.stop_time, system.step, outputs


@contextmanager
def private_folder() -> Iterator[Path]:
    """A folder that also receives the temporary files of this process; it is removed at the end."""
    names = ("TMPDIR", "TEMP", "TMP")
    before, tempdir = {name: os.environ.get(name) for name in names}, tempfile.tempdir
    with temporary_folder() as folder:
        tempfile.tempdir = str(folder)
        os.environ.update(dict.fromkeys(names, str(folder)))
        try:
            yield folder
        finally:
            tempfile.tempdir = tempdir
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value


@contextmanager
def unpacked(file: Path) -> Iterator[Package]:
    """An SSP, read and extracted to a `private_folder`."""
    with private_folder() as folder:
        yield open_package(file, folder / "package", ExtractionBudget())


def connections_by_pair(package: Package) -> dict[tuple[str, str], list[tuple[str, str]]]:
    """Connected outputs and inputs by source and target component."""
    pairs: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for connection in package.connections:
        pairs.setdefault((connection.start[0], connection.end[0]), []).append((connection.start[1], connection.end[1]))
    return pairs
