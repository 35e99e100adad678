"""Wiring of a run: the index of every signal in one array, and which input takes which signal."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.compatibility import joined
from flexbeams.scenarios.definition.declaration import InstanceDeclaration, access_order, element_names, split_owner
from flexbeams.scenarios.definition.dimensions import Conversion
from flexbeams.scenarios.definition.schema import Connection, Scenario
from flexbeams.scenarios.definition.signals import Signal, column_note, signal_of
from flexbeams.scenarios.definition.values import TypedValue, own_start
from flexbeams.scenarios.simulation.frames import FrameLayout


@dataclass(kw_only=True)
class Wiring:
    """Indices in the array of signals: outputs by instance, then external signals, held ones last."""

    size: int
    sources: dict[str, int]  # index of each <instance>.<output>
    inputs: dict[str, list[tuple[str, int]]]  # for each instance, its inputs with the index of their source
    reads: dict[str, list[str]]  # for each instance, the variables that are read, in TYPE_ORDER
    spans: dict[str, slice]  # for each instance, its part of the array
    external: list[tuple[slice, Signal | float]] = field(default_factory=list)  # a float is a held start value
    columns: list[str] = field(default_factory=list)  # names of the recorded signals
    recorded: list[int] = field(default_factory=list)  # their indices, then those of the deflections
    deflections: list[str] = field(default_factory=list)  # names of recorded signals that are no columns
    frames: FrameLayout | None = None
    conversions: dict[str, dict[str, Conversion]] = field(default_factory=dict)  # of inputs, by instance
    converted_columns: dict[int, Conversion] = field(default_factory=dict)  # by number of the column

    @property
    def changing(self) -> slice:
        """External signals that are functions of time; constants follow them, and outputs precede."""
        spans = [span for span, signal in self.external if not isinstance(signal, float)]
        first = self.external[0][0].start if self.external else self.size
        return slice(first, spans[-1].stop if spans else first)

    def links(self) -> dict[str, str]:
        """<instance>.<output> by the <instance>.<input> that takes its value, in the order of the inputs."""
        names = {index: name for name, index in self.sources.items()}
        return {
            f"{instance}.{name}": names[index]
            for instance, inputs in self.inputs.items()
            for name, index in inputs
            if index in names
        }

    def with_hidden(self, hidden: Collection[str]) -> "Wiring":
        """The wiring with these recorded signals, in this order, behind the columns instead of among them."""
        indices = dict(zip(self.columns, self.recorded, strict=True))
        columns = [name for name in self.columns if name not in hidden]
        return replace(
            self,
            columns=columns,
            recorded=[indices[name] for name in (*columns, *hidden)],
            deflections=list(hidden),
            converted_columns={columns.index(self.columns[k]): c for k, c in self.converted_columns.items()},
        )

    def without_hidden(self) -> "Wiring":
        """The wiring that records its columns only."""
        return replace(self, recorded=self.recorded[: len(self.columns)], deflections=[])

    def driven(self) -> dict[str, list[str]]:
        """For each instance, the inputs that a connection or an external signal drives."""
        constants = [span for span, signal in self.external if isinstance(signal, float)]
        held = {index for span in constants for index in range(span.start, span.stop)}
        return {owner: [n for n, index in inputs if index not in held] for owner, inputs in self.inputs.items()}


def plan_wiring(
    scenario: Scenario,
    declarations: Mapping[str, InstanceDeclaration],
    source: str,
    starts: Mapping[str, Mapping[str, TypedValue]],
    notify: Callable[[str], None] = lambda text: None,
    step: float | None = None,
    open_inputs: bool = False,
) -> Wiring:
    """The wiring of a scenario, with every connection, input and record entry resolved.

    Recorded inputs that nothing drives, with `open_inputs` all that nothing drives, hold their start value: that of
    `starts`, or the unit's own. Conversions of units of measurement are noted. Signals are sampled each `step` s.

    Raises InputError with file (`source`), key and value.
    """
    return _Builder(scenario, declarations, source, starts, notify, step or scenario.step).build(open_inputs)


class _Builder:
    """Adds to a Wiring, in the order of the array of signals."""

    def __init__(
        self,
        scenario: Scenario,
        declarations: Mapping[str, InstanceDeclaration],
        source: str,
        starts: Mapping[str, Mapping[str, TypedValue]],
        notify: Callable[[str], None],
        step: float | None,
    ) -> None:
        self._notify, self._step = notify, step
        self._scenario, self._declarations, self._source, self._starts = scenario, declarations, source, starts
        self._require_distinct_names()
        self._wiring = Wiring(size=0, sources={}, inputs={name: [] for name in declarations}, reads={}, spans={})
        self._extra = {  # signals that the scenario records in addition
            f"{owner}.{name}"
            for k, text in enumerate(scenario.record or [], 1)
            for owner, names in [self._signal(f"record[{k}]", text)]
            for name in names
        }

    def build(self, open_inputs: bool) -> Wiring:
        for name in self._declarations:
            self._add_outputs(name)
        self._connect()
        self._drive()
        self._add_undriven_inputs(open_inputs)
        for name, declaration in self._declarations.items():  # in the order of the unit, which takes a type in one call
            indices = dict(self._wiring.inputs[name])
            written = sorted((v for v in declaration.variables.values() if v.name in indices), key=access_order)
            self._wiring.inputs[name] = [(v.name, indices[v.name]) for v in written]
        self._choose_columns()
        return self._wiring

    def _require_distinct_names(self) -> None:
        """InputError where <instance>.<variable> could be of either of two instances, one of which is named a.b."""
        for owner, declaration in self._declarations.items():
            if not any(other.startswith(f"{owner}.") for other in self._declarations):
                continue
            for name in declaration.variables:
                other, rest = split_owner(f"{owner}.{name}", self._declarations)
                if other != owner:
                    rule = f"has a variable {name!r}, which cannot be told from {rest!r} of {other}; rename one of them"
                    raise self._error(f"instance.{owner}", rule)

    def _error(self, key: str, rule: str, value: object = None) -> InputError:
        return InputError(key, rule, value, source=self._source)

    def _signal(self, key: str, text: str, causality: str | None = None) -> tuple[str, list[str]]:
        """The instance and the scalars that <instance>.<variable> names."""
        owner, variable = split_owner(text, self._declarations)
        if owner not in self._declarations:
            raise self._error(key, f"names an unknown instance {owner!r}" + suggestion(owner, self._declarations), text)
        usable = {
            n: v
            for n, v in self._declarations[owner].variables.items()
            if v.type != "String" and causality in (None, v.causality)
        }
        if not (names := element_names(usable, variable)):
            if element_names(self._declarations[owner].variables, variable) and causality is None:
                raise self._error(key, "is a String, which runs do not record", text)
            arrays = dict.fromkeys(n if "]." in n else n.split("[")[0] for n in usable)
            hint = suggestion(variable.split("[")[0], arrays)
            kind = f"an {causality}" if causality else "a variable"
            raise self._error(key, f"must name {kind} of {owner}, which has no {variable!r}{hint}", text)
        return owner, names

    def _add_outputs(self, owner: str) -> None:
        wiring = self._wiring
        read = [
            v
            for v in self._declarations[owner].variables.values()
            if v.type != "String"
            and v.causality != "input"
            and (v.causality == "output" or f"{owner}.{v.name}" in self._extra)
        ]
        read.sort(key=access_order)
        wiring.reads[owner] = [v.name for v in read]
        wiring.spans[owner] = slice(wiring.size, wiring.size + len(read))
        wiring.sources |= {f"{owner}.{v.name}": wiring.size + k for k, v in enumerate(read)}
        wiring.size += len(read)

    def _require_undriven(self, key: str, owner: str, names: Sequence[str]) -> None:
        driven = {name for name, _ in self._wiring.inputs[owner]}
        if repeated := next((name for name in names if name in driven), None):
            raise self._error(key, "must not drive an input that is driven already", f"{owner}.{repeated}")

    def _connect(self) -> None:
        for k, connection in enumerate(self._scenario.connection, 1):
            key = f"connection[{k}]"
            source, outputs = self._signal(f"{key}.from", connection.source, "output")
            target, inputs = self._signal(f"{key}.to", connection.to, "input")
            if len(outputs) != len(inputs):
                sizes = f"{connection.source} has {len(outputs)}, {connection.to} has {len(inputs)}"
                raise self._error(key, f"must join equal sizes: {sizes}")
            self._require_undriven(f"{key}.to", target, inputs)
            indices = [self._wiring.sources[f"{source}.{name}"] for name in outputs]
            self._wiring.inputs[target] += zip(inputs, indices, strict=True)
            self._convert(key, connection, (source, outputs), (target, inputs))

    def _convert(
        self, key: str, connection: Connection, start: tuple[str, list[str]], end: tuple[str, list[str]]
    ) -> None:
        """Compares types and units of measurement of a connection, and notes a conversion."""
        given = None
        if connection.factor is not None or connection.offset is not None:
            factor = 1.0 if connection.factor is None else connection.factor
            given = Conversion(factor=factor, offset=connection.offset or 0.0)
        one, other = self._declarations[start[0]], self._declarations[end[0]]
        noted = set()
        for output, name in zip(start[1], end[1], strict=True):
            pair = one.variables[output], other.variables[name]
            conversion = joined(*pair, one.dimensions, other.dimensions, given)
            if isinstance(conversion, str):
                raise self._error(key, conversion, f"{start[0]}.{output} to {end[0]}.{name}")
            if not conversion.trivial:
                self._wiring.conversions.setdefault(end[0], {})[name] = conversion
                noted.add(
                    f"from {pair[0].unit} to {pair[1].unit} by the factor {conversion.factor:g}"
                    + (f" and the offset {conversion.offset:g}" if conversion.offset else "")
                )
        for text in sorted(noted) if given is None else ():
            self._notify(f"{connection.source} to {connection.to} is converted {text}")

    def _drive(self) -> None:
        for k, drive in enumerate(self._scenario.input, 1):
            key = f"input[{k}]"
            owner, names = self._signal(f"{key}.to", drive.to, "input")
            try:
                signal = signal_of(drive, Path(self._source).parent, self._step)
            except InputError as error:
                raise error if error.source else error.at(self._source, f"{key}.") from None
            if text := column_note(signal, names):
                self._notify(f"{key}: {text}")
            if signal.width not in (1, len(names)):
                raise self._error(key, f"must give {len(names)} values for {drive.to}", signal.width)
            self._require_undriven(f"{key}.to", owner, names)
            self._add_external(owner, names, signal)

    def _add_undriven_inputs(self, every: bool) -> None:
        """Inputs that nothing drives: all, or those of kinds that record them and those that the scenario adds."""
        for owner, declaration in self._declarations.items():
            driven = {name for name, _ in self._wiring.inputs[owner]}
            for v in declaration.variables.values():
                recorded = every or _records_inputs(declaration) or f"{owner}.{v.name}" in self._extra
                if v.causality == "input" and v.type != "String" and v.name not in driven and recorded:
                    start = self._starts.get(owner, {}).get(v.name)
                    self._add_external(owner, [v.name], own_start(v) if start is None else float(start))

    def _add_external(self, owner: str, names: Sequence[str], signal: Signal | float) -> None:
        wiring = self._wiring
        span = slice(wiring.size, wiring.size + len(names))
        wiring.external.append((span, signal))
        wiring.inputs[owner] += zip(names, range(span.start, span.stop), strict=True)
        wiring.size = span.stop

    def _choose_columns(self) -> None:
        """Outputs that are not internal, inputs of kinds that record them, and what the scenario adds, in order."""
        wiring = self._wiring
        for owner, declaration in self._declarations.items():
            sources = dict(wiring.inputs[owner])
            internal = declaration.kind.internal_outputs if declaration.kind else ()
            for v in declaration.variables.values():
                name = f"{owner}.{v.name}"
                output = v.causality == "output" and v.name.partition("[")[0] not in internal
                own_input = v.causality == "input" and _records_inputs(declaration)
                index = wiring.sources.get(name, sources.get(v.name))
                if index is not None and (output or own_input or name in self._extra):
                    if v.causality == "input" and v.name in wiring.conversions.get(owner, {}):
                        wiring.converted_columns[len(wiring.columns)] = wiring.conversions[owner][v.name]
                    wiring.columns.append(name)
                    wiring.recorded.append(index)


def _records_inputs(declaration: InstanceDeclaration) -> bool:
    return declaration.kind is not None and declaration.kind.records_inputs
