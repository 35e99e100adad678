"""Scenarios without some of their instances or wires, whose inputs somebody else drives."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.schema import Scenario


def without_parts(scenario: Scenario, names: Sequence[str], source: str) -> Scenario:
    """The scenario without instances of these names, and without what drives inputs of these names.

    Wires, signals, sensors, checks, figure rows and recorded signals of a left-out instance go with it, and checks
    against targets with the targets. Raises InputError for a name that is neither an instance nor an input that the
    scenario drives.
    """
    ends = [*(wire.to for wire in scenario.connection), *(drive.to for drive in scenario.input)]
    for name in names:
        if name not in scenario.instance and name not in ends:
            rule = "is neither an instance nor a driven input" + suggestion(name, [*scenario.instance, *ends])
            raise InputError("without", rule, name, source=source)
    if scenario.instance.keys() <= set(names):
        raise InputError("without", "must leave an instance", ", ".join(names), source=source)

    def kept(signal: str) -> bool:
        return not _is_of(signal.removeprefix("open_loop."), names)

    figures = [replace(f, rows=[r for row in f.rows if (r := [*filter(kept, row)])] or [[""]]) for f in scenario.figure]
    inputs = [drive for drive in scenario.input if kept(drive.to) and drive.to not in names]
    aimed = any(drive.targets for drive in inputs)
    return replace(
        scenario,
        instance={name: instance for name, instance in scenario.instance.items() if name not in names},
        connection=[w for w in scenario.connection if kept(w.source) and kept(w.to) and w.to not in names],
        input=inputs,
        record=None if scenario.record is None else [*filter(kept, scenario.record)],
        sensor=[sensor for sensor in scenario.sensor if kept(sensor.of)],
        check=[c for c in scenario.check if kept(c.of) and (aimed or not (c.reference == "target" or c.relative))],
        figure=[figure for figure in figures if figure.rows != [[""]]],
    )


def _is_of(signal: str, owners: Collection[str]) -> bool:
    """Whether a signal is of one of these instances."""
    return any(signal.startswith(f"{owner}.") for owner in owners)
