"""Designs apart from runs: structure, options and targets, from a scenario or from options alone."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import Structure, find_structure, read_structure
from flexbeams.plant.validation import validate
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Scenario


@dataclass(frozen=True, kw_only=True)
class DesignTask:
    """A design to compute and analyse."""

    structure: Structure
    options: DesignOptions
    targets: Array | None  # (k, n_pi), m, that the scenario moves to


def design_task(
    scenario: str | None, structure: Structure | None, basis: str | None, overrides: Mapping[str, Any]
) -> DesignTask:
    """Structure and options of a scenario, or the defaults, with others in their place.

    Keys of `overrides` are those of [design]; weights.NAME and uncertainty.NAME name entries of its tables. Raises
    InputError with the key for what does not exist or breaks a rule.
    """
    options, targets = DesignOptions(), None
    if scenario is not None:
        file = load_scenario(scenario)
        options = file.scenario.design.relative_to(file.path.parent)
        if structure is None:
            try:
                structure = read_structure(find_structure(file.scenario.structure, file.path.parent))
            except InputError as error:
                raise error.at(str(file.path)) from None
        targets = scenario_targets(file.scenario, len(structure.point_of_interest))
    if structure is None:
        raise ValueError("a scenario or a structure is needed")
    table = asdict(options)
    if basis is not None and basis != options.basis:
        table |= {"basis": basis, "order": None, "output_weight": None}
    for key, value in overrides.items():
        _assign(table, key, value)
    return DesignTask(structure=structure, options=validate(DesignOptions, table, "--set"), targets=targets)


def _assign(table: dict[str, Any], key: str, value: Any) -> None:
    """Sets a key of the table, or that of an inner table."""
    head, dot, rest = key.partition(".")
    if not dot:
        table[head] = value
        return
    inner = table.get(head)
    if head not in ("weights", "uncertainty"):
        raise InputError("--set", "must be a key of [design], weights.NAME or uncertainty.NAME", key)
    table[head] = {**(inner or {}), rest.strip('"'): value}


def scenario_targets(scenario: Scenario, points: int) -> Array | None:
    """Targets (k, points) of the feedforward, those at zero left out; None where there is none of so many points."""
    variables = {kind.name: kind.targets for kind in CATALOGUE}
    values = []
    for drive in scenario.input:
        owner, _, variable = drive.to.partition(".")
        unit = scenario.instance[owner].unit if owner in scenario.instance else None
        if unit in variables and variables[unit] == variable:
            values += [t.value for t in drive.targets or [] if len(t.value) == points and np.any(t.value)]
    return np.array(values) if values else None
