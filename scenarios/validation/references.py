"""Does a unit do here what the reference results inside it say? Its experiments, simulated and compared."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.fmus.references.results import MANIFEST
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.importing.archives import Allowance
from flexbeams.scenarios.importing.extraction import unit_description
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.validation.reference_files import Declared, Trial, declared_experiments, read_trial


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """The largest difference, relative to the largest magnitude expected of the variable's array."""

    size: float
    name: str
    time: float  # s
    expected: float
    found: float


def reference_checks(file: Path) -> list[tuple[bool, str]]:
    """For each experiment in an FMU whether nothing speaks against the unit, and a line; empty where it has none.

    What cannot be read or run here does not speak against it.
    """
    if all(entry.filename != MANIFEST for entry in Allowance().check(file)):
        return []
    with tempfile.TemporaryDirectory(prefix="flexbeams_", ignore_cleanup_errors=True) as temporary:
        folder = Path(temporary) / "unit"
        try:
            Allowance().extract(file, folder)
            description = unit_description(file, "", "")
            declared = declared_experiments(folder, description)
        except InputError as error:
            return [(True, f"references are not checked: {error}")]
        return [_checked(folder, description, experiment) for experiment in declared]


def _checked(folder: Path, description: Any, experiment: Declared) -> tuple[bool, str]:
    what = f"reference {experiment.name}"
    try:
        trial = read_trial(folder, description, experiment)
    except InputError as error:
        return True, f"{what} is not checked: {str(error).replace(f'{folder}/', '')}"
    try:
        instance = UnitInstance("unit", folder, description, lambda text: None)
    except Exception as error:  # whatever becomes of a library that cannot be loaded
        return True, f"{what} is not checked: {' '.join(str(error).split()) or type(error).__name__}"
    try:
        worst = deviation(trial, run_trial(trial, instance))
    except UnitFailure as failure:
        return False, f"{what}: {failure}"
    finally:
        instance.close()
    if worst.size <= trial.tolerance:
        return True, f"{what}: agrees to {worst.size:.0e}" if worst.size else f"{what}: agrees exactly"
    return False, (
        f"{what}: {worst.name} at {worst.time:.6g} s must be {worst.expected!r} to {trial.tolerance:g}, "
        f"got {worst.found!r}"
    )


def run_trial(trial: Trial, instance: UnitInstance) -> Array:
    """What the unit puts out at the rows of the references, (rows, names); UnitFailure where it refuses."""
    row = np.zeros(len(trial.names))
    for name, value in trial.parameters.items():
        instance.set_start(name, value)
    instance.connect(trial.names, row, trial.inputs)
    instance.call("setupExperiment", None, trial.start)
    instance.call("enterInitializationMode")
    instance.inputs[:] = trial.driven[0]
    instance.write()
    instance.call("exitInitializationMode")
    found, done = np.zeros_like(trial.expected), 0
    for k, tick in enumerate(trial.ticks):
        for step in range(done, tick):
            instance.inputs[:] = trial.driven[step]
            instance.write()
            instance.step(trial.start + step * trial.step, trial.step)
        done = tick
        instance.read()
        found[k] = row
    return found


def deviation(trial: Trial, found: Array) -> Deviation:
    """Where the results differ most."""
    arrays = [name.partition("[")[0] + name.partition("]")[2] for name in trial.names]
    largest = {a: np.max(np.abs(trial.expected[:, [a == b for b in arrays]])) or 1.0 for a in arrays}
    apart = np.abs(found - trial.expected) / np.array([largest[a] for a in arrays])
    apart = np.where(np.isfinite(found), apart, np.inf)
    k, column = np.unravel_index(np.argmax(apart), apart.shape)
    return Deviation(
        size=float(apart[k, column]),
        name=trial.names[column],
        found=float(found[k, column]),
        time=trial.start + trial.ticks[k] * trial.step,
        expected=float(trial.expected[k, column]),
    )
