"""Experiments inside a unit, simulated and compared with their reference results."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.fmus.references.results import MANIFEST
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.simulation.failure import UnitEnded, UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.validation.reference_files import (
    DeclaredExperiment,
    ReferenceRun,
    declared_experiments,
    read_reference_run,
)


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """The largest difference, relative to the largest magnitude expected of the variable's array."""

    size: float
    name: str
    time: float  # s
    expected: float
    result: float


def has_references(file: Path) -> bool:
    """Whether an FMU has reference results."""
    return any(entry.filename == MANIFEST for entry in ExtractionBudget().check(file))


@dataclass(frozen=True, kw_only=True)
class ReferenceCheck:
    """What came of an experiment in an FMU."""

    passed: bool  # results agree with the references
    ran: bool  # whether the experiment could be read and the unit loaded on this machine
    message: str


def reference_checks(file: Path) -> list[ReferenceCheck]:
    """A check of each experiment in an FMU; empty where it has none.

    An experiment that cannot be read or run on this machine does not pass.
    """
    if not has_references(file):
        return []
    with temporary_folder() as temporary:
        folder = temporary / "unit"
        try:
            ExtractionBudget().extract(file, folder)
            description = unit_description(file, "", "")
            declared = declared_experiments(folder, description)
        except InputError as error:
            return [_unchecked(f"references are not checked: {error}")]
        return [_check(folder, description, experiment) for experiment in declared]


def _unchecked(message: str) -> ReferenceCheck:
    return ReferenceCheck(passed=False, ran=False, message=message)


def _check(folder: Path, description: Any, experiment: DeclaredExperiment) -> ReferenceCheck:
    title = f"reference {experiment.name}"
    try:
        reference = read_reference_run(folder, description, experiment)
    except InputError as error:
        return _unchecked(f"{title} is not checked: {str(error).replace(f'{folder}/', '')}")
    try:
        instance = UnitInstance("unit", folder, description, lambda text: None)
    except Exception as error:  # of a library that cannot be loaded
        return _unchecked(f"{title} is not checked: {' '.join(str(error).split()) or type(error).__name__}")
    try:
        worst = deviation(reference, simulate_reference(reference, instance))
    except UnitFailure as failure:
        return ReferenceCheck(passed=False, ran=True, message=f"{title}: {failure}")
    finally:
        instance.close()
    if passed := worst.size <= reference.tolerance:
        message = f"agrees to {worst.size:.0e}" if worst.size else "agrees exactly"
    else:
        message = (
            f"{worst.name} at {worst.time:.6g} s must be {worst.expected!r} to {reference.tolerance:g}, "
            f"got {worst.result!r}"
        )
    return ReferenceCheck(passed=passed, ran=True, message=f"{title}: {message}")


def simulate_reference(reference: ReferenceRun, instance: UnitInstance) -> Array:
    """The unit's outputs at the rows of the references, (rows, names); UnitFailure where it refuses a call."""
    row = np.zeros(len(reference.names))
    for name, value in reference.parameters.items():
        instance.set_start(name, value)
    instance.connect(reference.names, row, reference.inputs)
    instance.call("setupExperiment", None, reference.start)
    instance.call("enterInitializationMode")
    instance.inputs[:] = reference.driven[0]
    instance.write()
    instance.call("exitInitializationMode")
    results, done = np.zeros_like(reference.expected), 0
    for k, count in enumerate(reference.steps_done):
        for step in range(done, count):
            instance.inputs[:] = reference.driven[step]
            instance.write()
            _step(instance, reference, step, last=step == reference.steps_done[-1] - 1)
        done = count
        instance.read()
        results[k] = row
    return results


def _step(instance: UnitInstance, reference: ReferenceRun, number: int, last: bool) -> None:
    """One step; UnitFailure where the unit ends the run earlier than with the last step."""
    time = reference.start + number * reference.step
    try:
        instance.step(time, reference.step)
    except UnitEnded as end:
        if not (last and end.completed):
            raise UnitFailure(instance.name, time, "fmi2DoStep", "ends the run before the last reference") from None


def deviation(reference: ReferenceRun, results: Array) -> Deviation:
    """The largest difference of results (rows, names) from the references."""
    arrays = [name.partition("[")[0] + name.partition("]")[2] for name in reference.names]
    largest = {a: np.max(np.abs(reference.expected[:, [a == b for b in arrays]])) or 1.0 for a in arrays}
    errors = np.abs(results - reference.expected) / np.array([largest[a] for a in arrays])
    errors = np.where(np.isfinite(results), errors, np.inf)
    k, column = np.unravel_index(np.argmax(errors), errors.shape)
    return Deviation(
        size=float(errors[k, column]),
        name=reference.names[column],
        result=float(results[k, column]),
        time=reference.start + reference.steps_done[k] * reference.step,
        expected=float(reference.expected[k, column]),
    )
