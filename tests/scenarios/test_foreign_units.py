"""Third-party units: every value reaches its variable, by type, index and unit of measurement, or is refused."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.files import write_run
from flexbeams.scenarios.runs.observer import Observer
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.failure import UnitEnded
from tests.units.foreign.unit import ForeignUnit, ForeignVariable

pytestmark = pytest.mark.native

V = ForeignVariable
HEAD = 'title = "foreign"\nstructure = "single_beam"\nstop_time = 0.05\nstep = 0.01\n'
GAIN = [  # references from 0 for each type, elements declared backwards
    V(name="gain", type="Real", causality="parameter", reference=0, start="2"),
    V(name="u[2]", type="Real", causality="input", reference=1, start="0", unit="mm"),
    V(name="u[1]", type="Real", causality="input", reference=2, start="0", unit="mm"),
    V(name="y[2]", type="Real", causality="output", reference=4, unit="mm"),
    V(name="y[1]", type="Real", causality="output", reference=3, unit="mm"),
    V(name="k", type="Integer", causality="input", reference=0, start="1"),
    V(name="n", type="Integer", causality="output", reference=1),
    V(name="b", type="Boolean", causality="input", reference=0, start="false"),
    V(name="c", type="Boolean", causality="output", reference=1),
    V(name="mode", type="Enumeration", causality="parameter", reference=2, start="1"),
    V(name="shown", type="Enumeration", causality="output", reference=3),
    V(name="label", type="String", causality="parameter", reference=0, start="abc"),
    V(name="letters", type="Integer", causality="output", reference=4),
    V(name="seen", type="Real", causality="output", reference=5),
    V(name="target", type="Enumeration", causality="input", reference=5, start="1"),
]
RULES = ["map R 3 2 1", "map R 4 1 10", "map I 1 0 2", "map B 1 0", "map I 3 2 1", "letters 4 0", "map R 5 0 1"]
SENSOR = [
    V(name="x[1]", type="Real", causality="output", reference=0, start="1", unit="m"),
    V(name="x[2]", type="Real", causality="output", reference=1, start="2", unit="m"),
    V(name="warm", type="Real", causality="output", reference=2, start="20", unit="degC"),
    V(name="count", type="Integer", causality="output", reference=0, start="7"),
    V(name="flag", type="Boolean", causality="output", reference=0, start="true"),
    V(name="state", type="Enumeration", causality="output", reference=1, start="3"),
]
KELVIN = [
    V(name="t", type="Real", causality="input", reference=0, start="0", unit="K"),
    V(name="v", type="Real", causality="input", reference=1, start="0", unit="V"),
]


class Bench:
    """Writes scenarios of three third-party units and runs them, with the loop in C or in Python."""

    def __init__(self, folder: Path, build_folder: Path) -> None:
        self.folder, self.build_folder, self.notes = folder, build_folder, list[str]()
        ForeignUnit(variables=GAIN, rules=RULES).write(folder / "gain.fmu")
        ForeignUnit(variables=SENSOR, dependencies={}).write(folder / "sensor.fmu")
        ForeignUnit(variables=KELVIN).write(folder / "kelvin.fmu")

    def run(self, text: str, **settings: object) -> Run:
        path = self.folder / "case.toml"
        path.write_text(f"{HEAD}{text}")
        self.notes.clear()
        options = Settings(build_folder=self.build_folder, **settings)  # type: ignore[arg-type]
        return run_scenario(path, options, Observer(notify=self.notes.append))

    def last(self, text: str, **settings: object) -> dict[str, float]:
        """The recorded values of the last row by column."""
        recording = self.run(text, **settings).recording
        return dict(zip(recording.columns, recording.values[-1].tolist(), strict=True))


@pytest.fixture(params=["c", "python"])
def bench(request: pytest.FixtureRequest, tmp_path: Path, run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    if request.param == "python":
        monkeypatch.setattr("flexbeams.scenarios.runs.execution.chosen_stepper", lambda *_: None)
    return Bench(tmp_path, run_folder / "build/fmus")


G = '[instance.g]\nfmu = "gain.fmu"\n'
S = '[instance.s]\nfmu = "sensor.fmu"\n'


def drive(to: str, signal: str) -> str:
    return f'[[input]]\nto = "{to}"\n{signal}\n'


def wire(source: str, to: str, more: str = "") -> str:
    return f'[[connection]]\nfrom = "{source}"\nto = "{to}"\n{more}\n'


def test_inputs_of_each_type_are_set_by_their_own_function(bench: Bench) -> None:
    values = bench.last(
        G
        + drive("g.u", "constant = [3.0, 5.0]")
        + drive("g.k", "step = { time = 0.02, value = 4 }")
        + drive("g.b", "constant = 1"),
        overrides={},
    )
    assert values["g.y[1]"] == 3.0
    assert values["g.y[2]"] == 50.0
    assert (values["g.n"], values["g.c"], values["g.seen"]) == (8.0, 0.0, 2.0)  # the parameter gain is untouched


def test_outputs_of_each_type_drive_inputs_of_theirs(bench: Bench) -> None:
    values = bench.last(
        'record = ["g.u", "g.k", "g.b", "g.target", "g.mode", "g.gain"]\n'
        + G
        + S
        + wire("s.x", "g.u")
        + wire("s.count", "g.k")
        + wire("s.flag", "g.b")
        + wire("s.state", "g.target")
    )
    assert (values["g.u[1]"], values["g.u[2]"]) == (1000.0, 2000.0)
    assert (values["g.y[1]"], values["g.y[2]"]) == (1000.0, 20000.0)
    assert (values["g.n"], values["g.c"], values["s.state"]) == (14.0, 0.0, 3.0)
    assert (values["g.k"], values["g.b"], values["g.target"]) == (7.0, 1.0, 3.0)
    assert (values["g.mode"], values["g.gain"]) == (1.0, 2.0)
    assert bench.notes == ["s.x to g.u is converted from m to mm by the factor 1000"]


def test_a_factor_takes_the_place_of_the_conversion(bench: Bench) -> None:
    values = bench.last(G + S + wire("s.x", "g.u", "factor = 2.0\noffset = 0.5"))
    assert (values["g.y[1]"], values["g.y[2]"]) == (2.5, 45.0)
    assert not bench.notes


def test_units_with_an_offset_and_integers_for_reals(bench: Bench) -> None:
    text = 'record = ["k.t", "k.v"]\n' + S + '[instance.k]\nfmu = "kelvin.fmu"\n'
    values = bench.last(text + wire("s.warm", "k.t") + wire("s.count", "k.v"))
    assert values["k.t"] == pytest.approx(293.15, rel=1e-15)
    assert values["k.v"] == 7.0
    assert bench.notes == ["s.warm to k.t is converted from degC to K by the factor 1 and the offset 273.15"]


@pytest.mark.parametrize("item", ["on", 2.0])
def test_start_values_of_each_type(bench: Bench, item: object) -> None:
    values = bench.last(
        'record = ["g.k", "g.b"]\n' + G + 'start.label = "12345"\nstart.k = 3\nstart.b = true\n',
        overrides={"g.mode": item},
    )
    assert (values["g.shown"], values["g.letters"], values["g.n"], values["g.c"]) == (2.0, 5.0, 6.0, 0.0)
    assert (values["g.k"], values["g.b"]) == (3.0, 1.0)


def test_elements_of_start_values_go_by_index(bench: Bench) -> None:
    values = bench.last(G + "start.u = [3.0, 5.0]\n")
    assert (values["g.y[1]"], values["g.y[2]"]) == (3.0, 50.0)


REFUSED = {
    "real_for_integer": (G + S + wire("s.warm", "g.k"), "joins types that differ: Real and Integer"),
    "boolean_for_real": (G + S + wire("s.flag", "g.u[1]"), "joins types that differ: Boolean and Real"),
    "integer_for_enumeration": (G + S + wire("s.count", "g.target"), "joins types that differ"),
    "factor_for_boolean": (G + S + wire("s.flag", "g.b", "factor = 2.0"), "no factor and offset between Boolean"),
    "half": (G + drive("g.k", "constant = 0.5"), "g.k is of type Integer and must be driven by integers, got 0.5"),
    "two": (G + drive("g.b", "constant = 2"), "g.b is Boolean and must be driven by 0 and 1, got 2.0"),
    "late": (G + drive("g.k", "step = { time = 0.03, value = 1.5 }"), "must be driven by integers, got 1.5"),
    "item": (G + drive("g.target", "constant = 4"), "g.target must be an item of the Enumeration, by name or number"),
    "other_quantity": (
        '[instance.k]\nfmu = "kelvin.fmu"\n' + S + wire("s.warm", "k.v"),
        "cannot be converted: the units 'degC' and 'V' are of different quantities",
    ),
    "string": ('record = ["g.label"]\n' + G, "record[1] is a String, which runs do not record"),
    "start_item": (G + 'start.mode = "onn"\n', "by name or number: off (1), on (2), auto (3), got 'onn'"),
    "start_number": (G + "start.mode = 4\n", "by name or number: off (1), on (2), auto (3), got 4.0"),
    "start_fraction": (G + "start.k = 1.5\n", "must be of type Integer, got 1.5"),
    "start_string": (G + "start.label = true\n", "must be of type String, got True"),
    "start_boolean": (G + "start.b = 1\n", "must be of type Boolean, got 1.0"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused(case: str, tmp_path: Path, run_folder: Path) -> None:
    text, complaint = REFUSED[case]
    with pytest.raises(InputError) as error:
        Bench(tmp_path, run_folder / "build/fmus").run(text)
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_columns_by_order_and_skipped_rows_are_noted(bench: Bench) -> None:
    (bench.folder / "t.csv").write_text("time,left,right\n0,1,2\n0.011,9,9\n0.012,8,8\n0.02,3,4\n1,0,0\n")
    values = bench.last(G + drive("g.u", 'table = { file = "t.csv" }'))
    assert (values["g.y[1]"], values["g.y[2]"]) == (3.0, 40.0)
    assert bench.notes == [
        "input[1]: columns go by their order: left to u[1], right to u[2]",
        "input[1]: 2 rows of t.csv have no effect, the next one comes within the same step of 0.01 s",
    ]


def test_a_thousand_steps_are_equal_in_both_loops(
    tmp_path: Path, run_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = G + S + wire("s.x", "g.u") + drive("g.k", "pseudo_random = { amplitude = 3, hold = 0.02 }")
    bench = Bench(tmp_path, run_folder / "build/fmus")
    one = bench.run(text, stop_time=10.0).recording
    monkeypatch.setattr("flexbeams.scenarios.runs.execution.chosen_stepper", lambda *_: None)
    other = bench.run(text, stop_time=10.0).recording
    assert one.columns == other.columns
    assert np.array_equal(one.values, other.values)
    assert len(set(one.values[:, one.columns.index("g.n")])) == 2


def stage(name: str, gain: float, dependencies: dict[str, list[str]] | None = None, rule: str = "") -> ForeignUnit:
    """y = gain u, whose own input starts at 1."""
    variables = [
        V(name="u", type="Real", causality="input", reference=0, start="1"),
        V(name="y", type="Real", causality="output", reference=1),
    ]
    return ForeignUnit(variables=variables, rules=[rule or f"map R 1 0 {gain}"], dependencies=dependencies, name=name)


def test_a_unit_listed_before_its_source_gets_the_sources_value(bench: Bench) -> None:
    stage("Inverse", 1.0, rule="inverse 1 0").write(bench.folder / "inverse.fmu")  # refuses 0
    stage("Double", 2.0).write(bench.folder / "double.fmu")
    text = "".join(
        f'[instance.{n}]\nfmu = "{f}.fmu"\n' for n, f in (("c", "inverse"), ("b", "double"), ("a", "double"))
    )
    recording = bench.run(text + wire("b.y", "c.u") + wire("a.y", "b.u") + drive("a.u", "constant = 5.0")).recording
    first = dict(zip(recording.columns, recording.values[0].tolist(), strict=True))
    assert (first["a.y"], first["b.y"], first["c.y"]) == (10.0, 20.0, 0.05)
    assert not bench.notes


def test_a_loop_in_initialisation_is_named_and_settles(bench: Bench) -> None:
    stage("Half", 0.5).write(bench.folder / "half.fmu")
    stage("Double", 2.0).write(bench.folder / "double.fmu")
    text = "".join(f'[instance.{n}]\nfmu = "{f}.fmu"\n' for n, f in (("b", "double"), ("a", "half")))
    recording = bench.run(text + wire("a.y", "b.u") + wire("b.y", "a.u")).recording
    assert dict(zip(recording.columns, recording.values[0].tolist(), strict=True)) == {"b.y": 1.0, "a.y": 0.5}
    [note] = bench.notes
    assert note.startswith("initialisation: b.u -> b.y -> a.u -> a.y -> b.u is a loop")


def test_a_loop_is_repeated_until_it_settles(bench: Bench) -> None:
    """b = a / 2 + 1 and a = b / 2: the fixed point is 4/3 and 2/3, and the inputs begin with 1."""
    constant = V(name="c", type="Real", causality="input", reference=7, start="1")
    unit = stage("Affine", 0.5)
    unit.variables.append(constant)
    unit.rules.append("sum 1 7 1")
    unit.write(bench.folder / "affine.fmu")
    stage("Half", 0.5).write(bench.folder / "half.fmu")
    text = '[instance.b]\nfmu = "affine.fmu"\n[instance.a]\nfmu = "half.fmu"\n'
    recording = bench.run(text + wire("a.y", "b.u") + wire("b.y", "a.u")).recording
    first = dict(zip(recording.columns, recording.values[0].tolist(), strict=True))
    assert first == {"b.y": pytest.approx(4 / 3, rel=1e-11), "a.y": pytest.approx(2 / 3, rel=1e-11)}


def test_units_are_converted_in_initialisation_too(bench: Bench) -> None:
    """With their offsets: the unit shows what it was given."""
    unit = ForeignUnit(variables=[replace(KELVIN[0]), V(name="y", type="Real", causality="output", reference=4)])
    unit.rules = ["map R 4 0 1"]
    unit.write(bench.folder / "shown.fmu")
    text = '[instance.k]\nfmu = "shown.fmu"\n' + S
    recording = bench.run(text + wire("s.warm", "k.t")).recording
    shown = recording.values[:, recording.columns.index("k.y")]
    assert shown.tolist() == pytest.approx([293.15] * 6, rel=1e-15)


def test_a_loop_that_does_not_settle_is_refused(tmp_path: Path, run_folder: Path) -> None:
    bench = Bench(tmp_path, run_folder / "build/fmus")
    stage("Double", 2.0).write(bench.folder / "double.fmu")
    text = '[instance.b]\nfmu = "double.fmu"\n[instance.a]\nfmu = "double.fmu"\n'
    with pytest.raises(InputError, match=r"the loop b.u -> b.y -> a.u -> a.y -> b.u does not settle in 100 rounds"):
        bench.run(text + wire("a.y", "b.u") + wire("b.y", "a.u"))


def test_outputs_of_states_alone_close_no_loop(bench: Bench) -> None:
    stage("Half", 0.5, {"y": []}).write(bench.folder / "half.fmu")
    stage("Double", 2.0).write(bench.folder / "double.fmu")
    text = "".join(f'[instance.{n}]\nfmu = "{f}.fmu"\n' for n, f in (("b", "double"), ("a", "half")))
    bench.run(text + wire("a.y", "b.u") + wire("b.y", "a.u"))
    assert not bench.notes


def test_log_lines_are_heard_with_their_count(bench: Bench) -> None:
    """Also those of level error with status OK; of lines that differ in numbers only, three are passed on."""
    unit = stage("Loud", 2.0)
    unit.rules += ["warn nearly singular", "error solver retried"]
    unit.write(bench.folder / "loud.fmu")
    run = bench.run('[instance.a]\nfmu = "loud.fmu"\n' + drive("a.u", "constant = 1.0"))
    assert run.recording.complete
    assert [line.split(" at ")[0] for line in bench.notes] == ["a: nearly singular"] * 4 + ["a: solver retried"]
    assert [line.endswith("(5 times)") for line in bench.notes] == [False] * 3 + [True, True]


def test_a_step_discarded_as_terminated_is_a_regular_end(bench: Bench) -> None:
    unit = stage("Ending", 2.0)
    unit.rules.append("end 0.025")
    unit.write(bench.folder / "ending.fmu")
    run = bench.run('[instance.a]\nfmu = "ending.fmu"\n' + drive("a.u", "constant = 1.0"))
    assert run.passed
    assert run.recording.time.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert np.all(run.recording.values == 2.0)
    assert bench.notes == ["a ended the run at 0.03 s"]
    assert run.summary["ended"] == "a ended the run at 0.03 s"


@pytest.mark.parametrize(
    ("rules", "failure"),
    [
        (["error cannot go on", "discard 0.025"], "in fmi2DoStep: cannot go on at 0.03"),
        (["discard 0.025", "error cannot go on"], "in fmi2DoStep: status 2"),
        (["error cannot go on", "inverse 1 0"], "in fmi2Set(...|Real): status 3"),
    ],
)
def test_a_failure_quotes_what_its_own_call_has_logged(bench: Bench, rules: list[str], failure: str) -> None:
    """Errors that calls before have logged, with status OK, are noted with their count."""
    (bench.folder / "u.csv").write_text("time,u\n0,1\n0.03,-1\n")
    unit = stage("Failing", 2.0)
    unit.rules += rules
    unit.write(bench.folder / "failing.fmu")
    run = bench.run('[instance.a]\nfmu = "failing.fmu"\n' + drive("a.u", 'table = { file = "u.csv" }'))
    assert not run.recording.complete
    assert re.fullmatch(f"a failed at 0.03 s {failure}", str(run.recording.failure))
    assert bench.notes == ["a: cannot go on at 0 (3 times)"]  # without the one that the failure quotes


def test_a_unit_for_one_instance_is_instantiated_once(tmp_path: Path, run_folder: Path) -> None:
    bench = Bench(tmp_path, run_folder / "build/fmus")
    unit = stage("Single", 2.0)
    unit.attributes = 'canBeInstantiatedOnlyOncePerProcess="true"'
    unit.write(bench.folder / "single.fmu")
    bench.run('[instance.a]\nfmu = "single.fmu"\n')
    with pytest.raises(InputError, match=r"instance.b is of the same unit as a, which can be instantiated only once"):
        bench.run('[instance.a]\nfmu = "single.fmu"\n[instance.b]\nfmu = "single.fmu"\n')


def test_names_in_csv_headers_are_quoted_as_rfc_4180_has_them(
    tmp_path: Path, run_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path, run_folder / "build/fmus")
    name = 'der(x,1) "a"'
    variables = [
        V(name=name, type="Real", causality="output", reference=0, start="1", unit="mm"),
        V(name="plain", type="Boolean", causality="output", reference=0, start="true"),
    ]
    ForeignUnit(variables=variables).write(tmp_path / "quoted.fmu")
    run = bench.run('[instance.g]\nfmu = "quoted.fmu"\n', units_row=True)
    write_run(run, tmp_path / "out", figures=False, report=False)
    lines = (tmp_path / "out/results.csv").read_text().splitlines()
    assert lines[:2] == ['time,"g.der(x,1) ""a""",g.plain', "s,mm,"]
    assert next(csv.reader(lines)) == ["time", f"g.{name}", "g.plain"]
    read = read_results(tmp_path / "out/results.csv")
    assert (read.columns, read.units) == ([f"g.{name}", "g.plain"], {f"g.{name}": "mm", "g.plain": ""})
    assert np.array_equal(read.values, run.recording.values)


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
def test_a_step_done_before_the_end_is_recorded(bench: Bench, coupling: str) -> None:
    """Also of the units that step behind the one that ends the run."""
    clock = V(name="clock", type="Real", causality="output", reference=9)
    for name, rule in (("ending", ["finish 0.025"]), ("plain", [])):
        unit = stage(name, 2.0)
        unit.variables.append(clock)
        unit.rules += ["clock 9", *rule]
        unit.write(bench.folder / f"{name}.fmu")
    text = "".join(f'[instance.{n}]\nfmu = "{f}.fmu"\n' for n, f in (("a", "plain"), ("b", "ending"), ("c", "plain")))
    recording = bench.run(text, coupling=coupling).recording
    assert recording.complete
    assert recording.time.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04])
    for name in "abc":
        assert recording.values[:, recording.columns.index(f"{name}.clock")] == pytest.approx(recording.time)
    assert bench.notes == ["b ended the run at 0.04 s"]
    path, build_folder = bench.folder / "case.toml", bench.build_folder
    with fb.simulation(path, coupling=coupling, build_folder=build_folder) as sim:  # type: ignore[arg-type]
        with pytest.raises(InputError, match=r"instance\.a cannot save its state"):
            sim.snapshot()
        with pytest.raises(UnitEnded, match=r"b ended the run at 0\.04 s"):
            sim.step(until=0.05)
        stepped = sim.result().recording
        with pytest.raises(InputError, match=r"b ended the run at 0\.04 s; the simulation goes on after reset"):
            sim.step()
    np.testing.assert_array_equal(stepped.values, recording.values)
    np.testing.assert_array_equal(stepped.time, recording.time)


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
def test_a_failure_in_the_last_step_of_a_regular_end_keeps_the_recording(bench: Bench, coupling: str) -> None:
    """Of a unit behind the one that ends the run: the rows before that step."""
    for name, rule in (("ending", "finish 0.025"), ("failing", "discard 0.025")):
        unit = stage(name, 2.0)
        unit.rules += [rule, *(["error cannot go on"] if name == "failing" else [])]
        unit.write(bench.folder / f"{name}.fmu")
    text = '[instance.a]\nfmu = "ending.fmu"\n[instance.b]\nfmu = "failing.fmu"\n'
    run = bench.run(text + drive("a.u", "constant = 1.0") + wire("a.y", "b.u"), coupling=coupling)
    assert not run.passed
    assert str(run.recording.failure).startswith("b failed at 0.03 s in fmi2DoStep: ")
    assert (run.recording.ended, run.summary["complete"], run.outcomes) == ("", False, [])
    assert "ended" not in run.summary
    assert run.recording.time.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert run.recording.values[:, run.recording.columns.index("a.y")].tolist() == [2.0] * 4
    assert run.recording.values[-1, run.recording.columns.index("b.y")] == 4.0


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
def test_the_last_step_of_a_regular_end_passes_on_values(bench: Bench, coupling: str) -> None:
    """Under Gauss-Seidel coupling the unit behind takes the new value of the one that ends the run."""
    ending = stage("Ending", 2.0)
    ending.variables.append(V(name="clock", type="Real", causality="output", reference=9))
    ending.rules += ["clock 9", "finish 0.025"]
    ending.write(bench.folder / "ending.fmu")
    stage("Double", 2.0).write(bench.folder / "double.fmu")
    text = '[instance.a]\nfmu = "ending.fmu"\n[instance.b]\nfmu = "double.fmu"\n' + wire("a.clock", "b.u")
    recording = bench.run(text, coupling=coupling).recording
    clock, doubled = (recording.values[:, recording.columns.index(n)] for n in ("a.clock", "b.y"))
    late = 0 if coupling == "gauss-seidel" else 1
    assert clock.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04])
    assert doubled[1:].tolist() == pytest.approx([2 * clock[k - late] for k in range(1, 5)])
