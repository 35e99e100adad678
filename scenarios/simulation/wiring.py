"""Wiring of a run: where every signal is stored in one array, and which input takes which of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.declaration import TYPE_ORDER, InstanceDeclaration, element_names
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.signals import Signal, signal_of
from flexbeams.scenarios.simulation.frames import FrameLayout


@dataclass(kw_only=True)
class Wiring:
    """Where every value stands in the one array of signals: outputs by instance, then external signals."""

    size: int
    sources: dict[str, int]  # <instance>.<variable> to place
    inputs: dict[str, list[tuple[str, int]]]  # instance to (input, place of its source)
    reads: dict[str, list[str]]  # instance to variables read, Real ones first
    spans: dict[str, slice]  # instance to its part of the array
    external: list[tuple[slice, Signal | float]] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    recorded: list[int] = field(default_factory=list)
    frames: FrameLayout | None = None

    def links(self) -> dict[str, str]:
        """<instance>.<output> by the <instance>.<input> that takes its value, in the order of the inputs."""
        origins = {place: name for name, place in self.sources.items()}
        return {
            f"{instance}.{name}": origins[place]
            for instance, inputs in self.inputs.items()
            for name, place in inputs
            if place in origins
        }


class WiringBuilder:
    """Builds a Wiring from a scenario and what its instances declare; InputError names file, key and value.

    `starts` has the start values set by instance; inputs that nothing drives hold theirs.
    """

    def __init__(
        self,
        scenario: Scenario,
        instances: Mapping[str, InstanceDeclaration],
        source: str,
        starts: Mapping[str, Mapping[str, float | bool]] | None = None,
    ) -> None:
        self._scenario, self._instances, self._file, self._starts = scenario, instances, source, starts or {}

    def build(self) -> Wiring:
        """The wiring; every connection, input and record entry resolved."""
        extra = [self._signal(f"record[{k}]", name) for k, name in enumerate(self._scenario.record or [], 1)]
        wiring = Wiring(size=0, sources={}, inputs={name: [] for name in self._instances}, reads={}, spans={})
        for name, instance in self._instances.items():
            wanted = [n for owner, names in extra if owner == name for n in names]
            variables = [v for v in instance.variables.values() if v.type in TYPE_ORDER and v.causality != "input"]
            ordered = sorted(
                (v for v in variables if v.causality == "output" or v.name in wanted),
                key=lambda v: TYPE_ORDER.index(v.type),
            )
            wiring.reads[name] = [v.name for v in ordered]
            wiring.spans[name] = slice(wiring.size, wiring.size + len(ordered))
            wiring.sources |= {f"{name}.{v.name}": wiring.size + k for k, v in enumerate(ordered)}
            wiring.size += len(ordered)
        self._connect(wiring)
        self._drive(wiring)
        self._hold_open_inputs(wiring, [f"{owner}.{n}" for owner, names in extra for n in names])
        for name, instance in self._instances.items():  # inputs in the unit's own order, which it takes in one piece
            places = dict(wiring.inputs[name])
            wiring.inputs[name] = [
                (variable, places[variable]) for variable in instance.variables if variable in places
            ]
        self._choose_columns(wiring, extra)
        return wiring

    def _signal(self, key: str, text: str, causality: str | None = None) -> tuple[str, list[str]]:
        """The instance and the scalars that <instance>.<variable> means."""
        owner, _, variable = text.partition(".")
        if owner not in self._instances:
            raise InputError(
                key,
                f"names an unknown instance {owner!r}" + suggestion(owner, self._instances),
                text,
                source=self._file,
            )
        variables = self._instances[owner].variables
        names = element_names(variables, variable)
        allowed = [n for n in names if variables[n].type != "String" and causality in (None, variables[n].causality)]
        if not allowed:
            kind = causality or "variable"
            known = dict.fromkeys(
                v.name.split("[")[0] if "]." not in v.name else v.name
                for v in variables.values()
                if v.type != "String" and causality in (None, v.causality)
            )
            hint = suggestion(variable.split("[")[0], known)
            raise InputError(key, f"names no {kind} {variable!r} of {owner}{hint}", text, source=self._file)
        return owner, allowed

    def _claim(self, wiring: Wiring, key: str, owner: str, names: list[str]) -> None:
        taken = {n for n, _ in wiring.inputs[owner]}
        for name in names:
            if name in taken:
                raise InputError(
                    key, "must not drive an input that is driven already", f"{owner}.{name}", source=self._file
                )

    def _connect(self, wiring: Wiring) -> None:
        for k, connection in enumerate(self._scenario.connection, 1):
            source, outputs = self._signal(f"connection[{k}].from", connection.source, "output")
            target, inputs = self._signal(f"connection[{k}].to", connection.to, "input")
            if len(outputs) != len(inputs):
                raise InputError(
                    f"connection[{k}]",
                    f"must join equal sizes: {connection.source} has {len(outputs)}, {connection.to} has {len(inputs)}",
                    source=self._file,
                )
            self._claim(wiring, f"connection[{k}].to", target, inputs)
            wiring.inputs[target] += [
                (i, wiring.sources[f"{source}.{o}"]) for i, o in zip(inputs, outputs, strict=True)
            ]

    def _drive(self, wiring: Wiring) -> None:
        for k, drive in enumerate(self._scenario.input, 1):
            owner, names = self._signal(f"input[{k}].to", drive.to, "input")
            try:
                signal = signal_of(drive, Path(self._file).parent)
            except InputError as error:
                raise error if error.source else error.at(self._file, f"input[{k}].") from None
            if signal.width not in (1, len(names)):
                raise InputError(
                    f"input[{k}]", f"must give {len(names)} values for {drive.to}", signal.width, source=self._file
                )
            self._claim(wiring, f"input[{k}].to", owner, names)
            self._add_external(wiring, owner, names, signal)

    def _hold_open_inputs(self, wiring: Wiring, recorded: list[str]) -> None:
        """A plant's inputs that nothing drives keep their start values and are recorded all the same."""
        for owner, instance in self._instances.items():
            driven = {n for n, _ in wiring.inputs[owner]}
            for v in instance.variables.values():
                shown = instance.description.modelName == "BeamPlant" or f"{owner}.{v.name}" in recorded
                if v.causality == "input" and v.type == "Real" and v.name not in driven and shown:
                    start = self._starts.get(owner, {}).get(v.name, v.start)
                    self._add_external(wiring, owner, [v.name], float(start or 0.0))

    def _add_external(self, wiring: Wiring, owner: str, names: list[str], signal: Signal | float) -> None:
        span = slice(wiring.size, wiring.size + len(names))
        wiring.external.append((span, signal))
        wiring.inputs[owner] += [(n, span.start + k) for k, n in enumerate(names)]
        wiring.size = span.stop

    def _choose_columns(self, wiring: Wiring, extra: list[tuple[str, list[str]]]) -> None:
        """Every output but x_ref, a plant's inputs, and what the scenario adds; in the order of the variables."""
        wanted = {f"{owner}.{n}" for owner, names in extra for n in names}
        for owner, instance in self._instances.items():
            driven = dict(wiring.inputs[owner])
            for v in instance.variables.values():
                full = f"{owner}.{v.name}"
                standard = (v.causality == "output" and not v.name.startswith("x_ref[")) or (
                    v.causality == "input" and instance.description.modelName == "BeamPlant"
                )
                place = wiring.sources.get(full, driven.get(v.name))
                if place is not None and (standard or full in wanted):
                    wiring.columns.append(full)
                    wiring.recorded.append(place)
