"""Experiments inside an FMU, run in a process of their own: foreign code cannot end the command."""

from pathlib import Path

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.processes.guarded import GuardedFailure, guarded
from flexbeams.scenarios.validation.references import ReferenceCheck, has_references, reference_checks

PATIENCE = 600.0  # s


def guarded_checks(file: Path, patience: float = PATIENCE) -> list[ReferenceCheck]:
    """The checks of `reference_checks`; InputError where the unit's code ends the process or takes `patience` s."""
    if not has_references(file):
        return []
    try:
        return guarded(reference_checks, file, patience=patience)
    except GuardedFailure as failure:
        raise InputError("", str(failure), source=str(file)) from None
