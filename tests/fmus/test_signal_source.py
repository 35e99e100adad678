"""SignalSource gives at every communication point what the runner's own signals give, whatever the steps."""

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu
from numpy.typing import NDArray

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units
from flexbeams.fmus.units.signal_source import SIGNAL_SOURCE, SourceSignal, source_data, source_interface
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.schema import (
    Chirp,
    Input,
    Instance,
    PseudoRandom,
    Pulse,
    Scenario,
    Step,
    Table,
    Target,
)
from flexbeams.scenarios.definition.signals import signal_of
from flexbeams.scenarios.exporting.source_signals import source_signals
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance

pytestmark = pytest.mark.native

STEP = 2e-4  # s, of the unit
INPUTS = {
    "constant": Input(to="rig.constant", constant=[0.25, -3.0]),
    "step": Input(to="rig.step", step=Step(time=0.0137, value=[2.0, 4.0])),
    "spread": Input(to="rig.spread", step=Step(time=0.3, value=7.0)),
    "pulse": Input(to="rig.pulse[2]", pulse=Pulse(time=0.1, duration=5e-3, impulse=0.0358)),
    "targets": Input(
        to="rig.targets",
        targets=[Target(time=0.1, value=[1e-3, -2e-3, 3e-3]), Target(time=0.2342, value=[-4e-3, 5e-3, 6e-3])],
    ),
    "chirp": Input(
        to="rig.chirp",
        chirp=Chirp(time=0.05, duration=0.6, amplitude=[3.0, 5.0], start_frequency=0.0, stop_frequency=900.0),
    ),
    "sweep": Input(
        to="rig.sweep",
        chirp=Chirp(
            time=0.0, duration=0.7, amplitude=2.0, start_frequency=1.0, stop_frequency=400.0, sweep="logarithmic"
        ),
    ),
    "tone": Input(
        to="rig.tone",
        chirp=Chirp(
            time=0.1, duration=0.5, amplitude=2.0, start_frequency=50.0, stop_frequency=50.0, sweep="logarithmic"
        ),
    ),
    "binary": Input(
        to="rig.binary",
        pseudo_random=PseudoRandom(time=0.01, amplitude=[1.0, 20.0, 300.0], hold=1.3e-3, register=7, seed=2**40),
    ),
    "levels": Input(
        to="rig.levels",
        pseudo_random=PseudoRandom(duration=0.5, amplitude=[4.0, 0.5], hold=7e-4, kind="levels", seed=2**62 + 11),
    ),
    "held": Input(to="rig.held", table=Table(file="measured.csv", columns=["a"])),
    "joined": Input(to="rig.joined", table=Table(file="measured.csv", columns=["b", "a"], hold="linear")),
}
SIZES = {
    "constant": 2,
    "step": 2,
    "spread": 3,
    "pulse": 3,
    "targets": 3,
    "chirp": 2,
    "sweep": 1,
    "tone": 2,
    "binary": 3,
    "levels": 2,
    "held": 1,
    "joined": 2,
    "open": 2,
}
SCENARIO = Scenario(
    title="all signals",
    structure="kiel",
    stop_time=0.8,
    instance={"rig": Instance(fmu="rig.fmu")},
    input=list(INPUTS.values()),
)


class Source:
    """The unit under test, its outputs by name of the input that they drive, and where its files are."""

    def __init__(self, folder: Path) -> None:
        self.inputs = folder
        table = np.column_stack([[-0.1, 0.05, 0.2, 0.65], [1.0, -2.0, 0.5, 4.0], [0.1, 0.7, 0.3, -9.0]])
        (folder / "measured.csv").write_text("time,a,b\n" + "\n".join(",".join(map(repr, r)) for r in table.tolist()))
        rig = {
            f"{name}[{k}]": SimpleNamespace(
                name=f"{name}[{k}]", type="Real", causality="input", start="1.5", unit="N", nominal=None
            )
            for name, size in SIZES.items()
            for k in range(1, size + 1)
        }
        self.signals, self.outputs = source_signals(SCENARIO, folder, {"rig": rig}, {"rig": {"open[2]": -8.0}}, ())
        interface = source_interface(self.signals, STEP, 0.8)
        data = source_data(interface, self.signals)
        self.file = folder / "SignalSource.fmu"
        build_native_units([NativeUnit(kind=SIGNAL_SOURCE, interface=interface, data=data, out=self.file)])
        self.description = fmpy.read_model_description(str(self.file), validate_model_structure=True)
        self.folder = fmpy.extract(str(self.file), unzipdir=str(folder / "unzipped"))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}

    def instance(self, start: float = 0.0, **values: float) -> FMU2Slave:
        fmu = FMU2Slave(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            instanceName="source",
            modelIdentifier="SignalSource",
        )
        fmu.instantiate()
        fmu.setupExperiment(startTime=start)
        fmu.enterInitializationMode()
        for name, value in values.items():
            fmu.setReal([self.references[name.replace("__", ".")]], [value])
        fmu.exitInitializationMode()
        return fmu

    def read(self, fmu: FMU2Slave, array: str) -> list[float]:
        names = [o for i, o in self.outputs.items() if i.startswith(f"rig.{array}[")]
        return list(fmu.getReal([self.references[n] for n in sorted(names)]))

    def expected(self, array: str, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """The runner's samples, (len(time), elements); inputs that nothing drives hold their start values."""
        if array == "open":
            return np.tile([1.5, -8.0], (len(time), 1))
        samples = signal_of(INPUTS[array], self.inputs).sample(time)
        whole = np.repeat(samples, SIZES[array], axis=1) if samples.shape[1] == 1 else samples
        return (
            np.column_stack([np.full(len(time), 1.5), whole[:, 1], np.full(len(time), 1.5)])
            if array == "pulse"
            else whole
        )


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    return Source(tmp_path_factory.mktemp("source"))


def walk(source: Source, array: str, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outputs at each of the times, the first of which is that of the initialisation."""
    fmu = source.instance(times[0])
    rows = [source.read(fmu, array)]
    for begin, end in pairwise(times):
        fmu.doStep(begin, end - begin)
        rows.append(source.read(fmu, array))
    fmu.terminate()
    fmu.freeInstance()
    return np.array(rows)


@pytest.mark.parametrize("array", SIZES)
def test_samples_are_the_runners_at_every_communication_point(source: Source, array: str) -> None:
    time = np.arange(4000) * STEP
    expected = source.expected(array, time)
    error = np.max(np.abs(walk(source, array, time) - expected)) / max(np.max(np.abs(expected)), 1e-300)
    assert error <= 1e-12
    if array not in ("constant", "open"):
        assert len(np.unique(expected[:, -2:], axis=0)) > 1


@pytest.mark.parametrize("array", SIZES)
def test_samples_do_not_depend_on_the_steps(source: Source, array: str) -> None:
    chosen = np.random.default_rng(3).choice(3999, 300, replace=False) + 1
    time = np.array([0, *np.sort(chosen)]) * STEP
    expected = source.expected(array, time)
    assert walk(source, array, time) == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.max(np.abs(expected)))


@pytest.mark.parametrize("array", SIZES)
def test_a_clock_that_adds_up_its_steps_sees_the_same(source: Source, array: str) -> None:
    time = np.add.accumulate(np.full(4000, STEP)) - STEP
    assert np.max(np.abs(time - np.arange(4000) * STEP)) > 1e-14
    expected = source.expected(array, np.arange(4000) * STEP)
    assert walk(source, array, time) == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.max(np.abs(expected)))


def test_samples_between_the_unit_s_own_steps_are_those_of_their_time(source: Source) -> None:
    time = np.arange(1, 900) * 7.77e-5
    for array in ("chirp", "joined", "pulse"):
        expected = source.expected(array, time)
        assert walk(source, array, time) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.max(np.abs(expected)))


@pytest.mark.parametrize("array", SIZES)
def test_an_edge_is_reached_a_nanosecond_early(source: Source, array: str) -> None:
    """As in the runner: half a nanosecond before it counts as reached, two before do not."""
    edges = np.array([0.01, 0.0137, 0.05, 0.1, 0.2, 0.2342, 0.3])
    time = np.sort(np.concatenate([[0.0], edges - 2e-9, edges - 5e-10]))
    expected = source.expected(array, time)
    assert walk(source, array, time) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.max(np.abs(expected)))


def test_parameters_are_the_scenario_s_and_can_be_changed(source: Source) -> None:
    names = [v.name for v in source.description.modelVariables if v.causality == "parameter"]
    assert {
        "pulse_2_pulse.impulse",
        "targets_targets.value[2,3]",
        "spread_step.value",
        "open_constant.value[2]",
        "chirp_chirp.stop_frequency",
        "binary_pseudo_random.hold",
    } <= set(names)
    fmu = source.instance(**{"pulse_2_pulse__impulse": 2 * 0.0358})
    for k in range(512):
        fmu.doStep(k * STEP, STEP)
    doubled = 2 * source.expected("pulse", np.array([512 * STEP]))[0, 1]
    assert doubled > 10
    assert source.read(fmu, "pulse")[1] == pytest.approx(doubled, rel=1e-12)
    fmu.terminate()
    fmu.freeInstance()


def _begin(unit: UnitInstance, name: str, value: float) -> None:
    unit.set_start(name, value)
    unit.call("exitInitializationMode")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("chirp_chirp.duration", 0.0, r"chirp_chirp\.duration must be finite and > 0, got 0\.0"),
        ("pulse_2_pulse.duration", 0.0, r"pulse_2_pulse\.duration must be finite and > 0"),
        ("binary_pseudo_random.hold", 0.0, r"binary_pseudo_random\.hold must be >= 0\.0002, got 0\.0"),
        ("levels_pseudo_random.hold", 1.9e-4, r"levels_pseudo_random\.hold must be >= 0\.0002, got 0\.00019"),
        (
            "pulse_2_pulse.impulse",
            1.7e308,
            r"pulse_2_pulse\.impulse must give a finite height over the duration 0",
        ),
        (
            "pulse_2_pulse.duration",
            1e-320,
            r"pulse_2_pulse\.impulse must give a finite height over the duration 1",
        ),
        (
            "chirp_chirp.start_frequency",
            1e308,
            r"start_frequency must give a finite number of cycles over",
        ),
        ("sweep_1_chirp.duration", 1e308, r"sweep_1_chirp\.stop_frequency must give a finite number of cycles over"),
        ("sweep_1_chirp.stop_frequency", 0.0, r"sweep_1_chirp\.stop_frequency must be finite and > 0"),
        ("targets_targets.time[2]", 0.05, r"targets_targets\.time\[2\] must be > 0\.1, the time before, got 0\.05"),
        ("step_step.time", -1.0, r"step_step\.time must be >= 0\.0, got -1\.0"),
    ],
)
def test_parameters_that_make_no_signal_are_refused(source: Source, name: str, value: float, message: str) -> None:
    with UnitInstance("source", Path(source.folder), source.description, print) as unit:
        unit.call("setupExperiment")
        unit.call("enterInitializationMode")
        with pytest.raises(UnitFailure, match=message):
            _begin(unit, name, value)


def test_states_are_restored(source: Source) -> None:
    fmu = source.instance()
    fmu.doStep(0.0, 0.1004)
    state, before = fmu.getFMUState(), source.read(fmu, "binary") + source.read(fmu, "pulse")
    fmu.doStep(0.1004, 0.3)
    assert source.read(fmu, "binary") + source.read(fmu, "pulse") != before
    fmu.setFMUState(state)
    assert source.read(fmu, "binary") + source.read(fmu, "pulse") == before
    fmu.freeFMUState(state)
    fmu.terminate()
    fmu.freeInstance()


def test_the_unit_is_valid_and_its_bytes_are_those_of_its_contents(source: Source, tmp_path: Path) -> None:
    assert validate_fmu(str(source.file)) == []
    interface = source_interface(source.signals, STEP, 0.8)
    data = source_data(interface, source.signals)
    unit = NativeUnit(kind=SIGNAL_SOURCE, interface=interface, data=data, out=tmp_path / "again.fmu")
    again = build_native_units([unit])
    assert again[0].read_bytes() == source.file.read_bytes()


def test_inputs_of_one_name_on_two_instances_get_outputs_of_their_own(tmp_path: Path) -> None:
    u = {
        f"u[{k}]": SimpleNamespace(name=f"u[{k}]", type="Real", causality="input", start="0", unit="V", nominal=None)
        for k in (1, 2)
    }
    both = {"a": Instance(fmu="x"), "b": Instance(fmu="x")}
    scenario = Scenario(
        title="",
        structure="",
        stop_time=1.0,
        instance=both,
        input=[Input(to="a.u", constant=1.0), Input(to="b.u[2]", constant=2.0)],
    )
    signals, outputs = source_signals(scenario, tmp_path, {"a": u, "b": u}, {}, ("b.u[1]",))
    assert outputs == {"a.u[1]": "a_u[1]", "a.u[2]": "a_u[2]", "b.u[2]": "b_u[2]"}
    assert [s.name for s in signals] == ["a_u_constant", "b_u_2_constant"]


def test_a_signal_is_one_for_all_outputs_or_one_for_each() -> None:
    with pytest.raises(InterfaceError, match="width must be 1 or 3, got 2"):
        SourceSignal(name="u", kind="constant", outputs=("u[1]", "u[2]", "u[3]"), width=2)


def test_a_level_may_hold_for_a_step(source: Source) -> None:
    with UnitInstance("source", Path(source.folder), source.description, print) as unit:
        unit.call("setupExperiment")
        unit.call("enterInitializationMode")
        _begin(unit, "levels_pseudo_random.hold", STEP)
        values = []
        for k in range(8):
            unit.step(k * STEP, STEP)
            values.append(unit.get("levels[1]"))
    assert len(set(values)) == len(values)


def test_a_level_that_holds_less_than_a_step_is_no_signal() -> None:
    signal = SourceSignal(
        name="levels",
        kind="levels",
        outputs=("levels[1]", "levels[2]"),
        width=2,
        parameters={"time": 0.0, "amplitude": [1.0, 1.0], "hold": 0.9 * STEP},
    )
    with pytest.raises(InterfaceError, match=r"levels\.hold: must be >= 0\.0002 s, the step size, got 0\.00018"):
        source_interface([signal], STEP, 1.0)


def test_a_table_without_finite_slopes_is_refused(tmp_path: Path) -> None:
    """By the unit and by the runner; held rows need no slopes."""
    (tmp_path / "steep.csv").write_text("time,a\n0.0,0.0\n0.1,-1e307\n0.2,1e308\n")
    table = np.array([[0.0, 0.0], [0.1, -1e307], [0.2, 1e308]])
    with pytest.raises(InterfaceError, match="steep: table must have finite slopes, got another behind row 2"):
        SourceSignal(name="steep", kind="joined_table", outputs=("a",), table=table)
    SourceSignal(name="steep", kind="held_table", outputs=("a",), table=table)
    with pytest.raises(InputError, match=r"table\.file must have finite slopes between .*none behind 0\.1"):
        signal_of(Input(to="rig.a", table=Table(file="steep.csv", hold="linear")), tmp_path)
    signal_of(Input(to="rig.a", table=Table(file="steep.csv")), tmp_path)


def test_a_pulse_without_a_finite_height_is_refused() -> None:
    with pytest.raises(InputError, match=r"pulse\.impulse must give a finite height over 1e-05 s, got 1e\+305"):
        signal_of(Input(to="rig.pulse", pulse=Pulse(time=0.1, duration=1e-5, impulse=1e305)), Path())


def test_levels_at_times_beyond_any_count(source: Source) -> None:
    """At 1e300 s the number of a level is beyond what can be counted; the values stay within the amplitude."""
    with UnitInstance("source", Path(source.folder), source.description, print) as unit:
        unit.call("setupExperiment", None, 1e300)
        unit.call("enterInitializationMode")
        unit.call("exitInitializationMode")
        assert all(abs(unit.get(f"binary[{k}]")) == value for k, value in ((1, 1.0), (2, 20.0), (3, 300.0)))
