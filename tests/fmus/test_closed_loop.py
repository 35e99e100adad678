"""A scenario's closed loop as one unit: bit by bit what the runner records, whatever the host's steps."""

import struct
import zipfile
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.declaration import TYPE_ORDER
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.closed_loop import export_closed_loop
from flexbeams.scenarios.exporting.ssp import export_ssp
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.runs.prepare import prepare_scenario
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.validation.package import package_problems
from tests.helpers import Write, design_of
from tests.native.workshop import native_folder, workspace
from tests.units.loaded import Loaded, loaded

SAMPLE = 2e-4
TARGET = [-8e-3, 1e-3, 4e-3, -6e-3]
TWO_PLANTS = """title = "x"
structure = "kiel"
stop_time = 0.3
[instance.first]
unit = "BeamPlant"
start."beam[2].tip_mass" = 0.03
[instance.planner]
unit = "FlatnessFeedforward"
start.preview = 2e-4
[instance.controller]
unit = "TrackingController"
[instance.second]
unit = "BeamPlant"
basis = "segment"
[[input]]
to = "planner.y_target"
targets = [{ time = 0.01, value = [-8e-3, 1e-3, 4e-3, -6e-3] }]
[[connection]]
from = "planner.u_ff"
to = "controller.u_ff"
[[connection]]
from = "planner.x_ref"
to = "controller.x_ref"
[[connection]]
from = "controller.u"
to = "first.u"
[[connection]]
from = "controller.u"
to = "second.u"
[[connection]]
from = "second.y_pm"
to = "controller.y_pm"
"""
DRIVEN = """title = "x"
structure = "single_beam"
stop_time = 0.3
[instance.feedforward]
unit = "FlatnessFeedforward"
start.transition_time = 0.2
[instance.plant]
unit = "BeamPlant"
[[connection]]
from = "feedforward.u_ff"
to = "plant.u"
"""
pytestmark = pytest.mark.native


def settings(**changed: Any) -> Settings:
    return Settings(record_animation=False, build_folder=workspace() / "build", **changed)


def exported(scenario: str, **changed: Any) -> Path:
    """The FMU, each made once."""
    out = workspace() / "loops" / f"{abs(hash((scenario, repr(changed))))}.fmu"
    return out if out.exists() else export_closed_loop(scenario, out, settings(**changed))


def folder_of(file: Path) -> Path:
    if not file.with_suffix("").exists():
        fmpy.extract(str(file), unzipdir=str(file.with_suffix("")))
    return file.with_suffix("")


def stimuli(scenario: str, inputs: list[str], **changed: Any) -> Array:
    """What drives the inputs of a closed loop in a scenario, a row for each step and the end of the last."""
    prepared = prepare_scenario(load_scenario(scenario), settings(**changed))
    time = np.arange(prepared.steps + 1) * prepared.step
    signals = np.zeros((len(time), prepared.wiring.size))
    for span, signal in prepared.wiring.external:
        signals[:, span] = signal if isinstance(signal, float) else signal.sample(time)
    places = {f"{owner}.{name}": place for owner, pairs in prepared.wiring.inputs.items() for name, place in pairs}
    places |= {name.partition(".")[2]: place for name, place in places.items()}
    return np.column_stack([signals[:, places[n]] if n in places else np.zeros(len(time)) for n in inputs])


def unit_name(unit: Loaded, name: str) -> str:
    """A variable <part>.<variable> as the unit calls it."""
    return name if name in unit.variables else name.partition(".")[2]


def drive(unit: Loaded, rows: Array, columns: list[str], step: float, every: int = 1, added_up: bool = False) -> Array:
    """Values of the columns at each communication point under rows of all inputs, one for each `step`.

    The host steps by `every` of them, its clock exact or added up.
    """
    columns = [unit_name(unit, column) for column in columns]
    order = sorted(columns, key=lambda c: TYPE_ORDER.index(unit.variables[c].type))
    values = np.zeros(len(columns))
    unit.connect(order, values, [n for n, v in unit.variables.items() if v.causality == "input"])
    unit.prepare()
    unit.inputs[:] = rows[0]
    unit.write()
    unit.call("exitInitializationMode")
    found, clock = [], 0.0
    for k in range(0, len(rows), every):
        unit.inputs[:] = rows[k]
        unit.write()
        unit.read()
        found.append(values.copy())
        if k + every < len(rows):
            unit.step(clock if added_up else k * step, every * step)
            clock += every * step
    return np.array(found)[:, [order.index(c) for c in columns]]


def alone(scenario: str, every: int = 1, added_up: bool = False, **changed: Any) -> tuple[Array, Recording]:
    """The columns of the runner's recording, from the unit on its own, and the recording."""
    recording = run_scenario(scenario, settings(**changed)).recording
    with loaded(folder_of(exported(scenario, **changed))) as unit:
        inputs = [n for n, v in unit.variables.items() if v.causality == "input"]
        rows = stimuli(scenario, inputs, **changed)
        return drive(unit, rows, recording.columns, changed.get("step", SAMPLE), every, added_up), recording


@pytest.mark.parametrize(
    ("scenario", "changed"),
    [
        ("tracking", {"stop_time": 1.2}),
        ("tracking", {"stop_time": 1.2, "coupling": "gauss-seidel"}),
        ("retarget", {"stop_time": 1.7}),
        ("hysteresis_imperfect", {"stop_time": 1.2}),
        ("hysteresis_imperfect", {"stop_time": 1.2, "coupling": "gauss-seidel"}),
        ("disturbance", {"stop_time": 1.1, "coupling": "gauss-seidel"}),
        ("step_response", {"stop_time": 1.1}),
        ("single_beam", {"stop_time": 1.2}),
        ("tracking", {"stop_time": 1.2, "step": 1e-3}),  # the controller's clock is five times as fast
        (
            "mismatch",
            {
                "stop_time": 1.1,
                "overrides": {
                    "plant.strain_noise_std": 1e-6,
                    "plant.noise_seed": 5.0,
                    "plant.start_at_rest_under": [50.0, 0.0, -20.0, 0.0],
                    "controller.voltage_limit": 20.0,
                },
            },
        ),
    ],
)
def test_the_unit_gives_what_the_runner_records(scenario: str, changed: dict[str, Any]) -> None:
    """To the last bit: every output, and what the parts pass on to each other."""
    values, recording = alone(scenario, **changed)
    assert np.max(np.abs(values[:, recording.columns.index("plant.y_pi[1]")])) > 1e-5
    np.testing.assert_array_equal(values, recording.values)


def test_two_plants_of_which_one_is_in_the_loop(write_scenario: Callable[[str, str], Path]) -> None:
    """A unit may occur twice, with start values and a basis of its own."""
    values, recording = alone(str(write_scenario("two", TWO_PLANTS)))
    first, second = (values[:, recording.columns.index(f"{name}.y_pi[1]")] for name in ("first", "second"))
    assert np.max(np.abs(first - second)) > 1e-5
    np.testing.assert_array_equal(values, recording.values)


@pytest.mark.parametrize("added_up", [False, True])
def test_longer_steps_of_the_host(added_up: bool) -> None:
    """Five inner steps in one, inputs held, give the same at their ends; so does a clock that adds up its steps."""
    values, recording = alone("tracking", 5, added_up, stop_time=1.2)
    np.testing.assert_array_equal(values, recording.values[::5])


def tracking() -> Path:
    """The folder of the unit that most tests use."""
    return folder_of(exported("tracking", stop_time=1.2))


def walk(unit: Loaded, steps: list[float], **inputs: Any) -> Array:
    """Every value after the steps."""
    for step in steps:
        unit.advance(step, **inputs)
    return unit.everything()


def test_steps_that_end_between_the_inner_ones() -> None:
    """At a common end any division gives the same up to rounding; the parts exchange values at the inner steps."""
    random = np.random.default_rng(5).uniform(1e-5, 5e-4, 400)
    ends = np.r_[np.arange(1, 501) * SAMPLE, np.cumsum(random)[np.cumsum(random) < 0.1]]
    divisions = {
        "inner": [SAMPLE] * 500,
        "cut": [1.5 * SAMPLE] * 333 + [0.5 * SAMPLE],
        "short": [SAMPLE / 4] * 2000,
        "any": np.diff(np.sort(np.r_[0.0, ends])).tolist(),
    }
    found = {}
    for name, steps in divisions.items():
        with loaded(tracking()) as unit:
            found[name] = walk(unit.begin(), steps, **{"y_target": TARGET, "force": 0.02})
    scale = np.maximum(np.abs(found["inner"]), 1e-9 * np.max(np.abs(found["inner"])))
    for name in divisions:
        assert np.max(np.abs(found[name] - found["inner"]) / scale) < 1e-8, name


def test_between_the_inner_steps_the_parts_hold_what_they_were_given(write_scenario: Write) -> None:
    """Also where each takes the newest values: a plant steps twice with what a feedforward gave it in the first."""
    loop = folder_of(exported(str(write_scenario("driven", DRIVEN)), coupling="gauss-seidel"))
    alone = [native_folder(name, "single_beam") for name in ("FlatnessFeedforward", "BeamPlant")]
    with loaded(loop) as unit, loaded(alone[0]) as feedforward, loaded(alone[1]) as plant:
        for one in (unit, feedforward):
            one.begin(**{"feedforward.transition_time" if one is unit else "transition_time": 0.2}).put(
                "y_target", 5e-3
            )
        plant.begin()
        for _ in range(300):
            feedforward.advance(SAMPLE / 4)
            plant.advance(SAMPLE / 4, u=feedforward.take("u_ff")).advance(3 * SAMPLE / 4)
            feedforward.advance(3 * SAMPLE / 4)
            unit.advance(SAMPLE / 4).advance(3 * SAMPLE / 4)
        assert np.abs(plant.take("y_pi")).max() > 1e-4
        np.testing.assert_allclose(unit.take("y_pi", "plant.energy"), plant.take("y_pi", "energy"), rtol=1e-9)


def test_between_the_inner_steps_the_plant_is_exact() -> None:
    """Half an inner step on, it is where a plant of its own is under the voltages held since the last one."""
    with loaded(tracking()) as unit, loaded(native_folder("BeamPlant")) as plant:
        unit.begin()
        plant.begin()
        for _ in range(300):
            plant.put("u", unit.take("plant.u"))
            for one in (unit, plant):
                one.advance(SAMPLE, force=[0.0, 0.1, 0.0])
            unit.put("y_target", TARGET)
        plant.put("u", unit.take("plant.u"))
        for one in (unit, plant):
            one.advance(SAMPLE / 2, force=[-0.3, 0.1, 0.0])
        np.testing.assert_allclose(unit.take("y_pi", "plant.energy"), plant.take("y_pi", "energy"), rtol=1e-10)
        assert unit.take("time", "plant.time") == pytest.approx(300.5 * SAMPLE, rel=1e-12)


def test_states_saved_between_inner_steps_continue_bit_for_bit() -> None:
    steps = [0.3 * SAMPLE, SAMPLE, 1.4 * SAMPLE] * 20
    with loaded(tracking()) as one, loaded(tracking()) as other:
        walk(one.begin(**{"plant.beam[1].density": 1700.0}), steps + [0.1 * SAMPLE], **{"y_target": TARGET})
        saved = one.saved()
        expected = walk(one, steps, **{"force": 0.1})
        assert walk(other.prepare().restore(saved), steps, **{"force": 0.1}).tobytes() == expected.tobytes()
        assert walk(one.restore(saved), steps, **{"force": 0.1}).tobytes() == expected.tobytes()


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (0, -1e9, "setFMUstate: FMU state must have contents that this unit can have saved"),  # steps done
        (1, 1.0, "setFMUstate: FMU state must have contents"),  # share of the next one
        (2, 1e9, "setFMUstate: feedforward: FMU state must have contents"),
    ],
)  # transitions under way
def test_forged_states_are_refused(place: int, value: float, message: str) -> None:
    with loaded(tracking()) as unit:
        content = bytearray(unit.begin().advance(SAMPLE).saved())
        struct.pack_into("<d", content, 384 + 8 * (2 * len(unit.variables) + place), value)
        content[12:16] = struct.pack("<I", zlib.crc32(bytes(content[16:])))
        with pytest.raises(UnitFailure, match=message):
            unit.restore(bytes(content))


def test_the_start_time_shifts_everything() -> None:
    """The times of the parts too, and nothing else."""
    found = []
    for start in (0.0, 3.0):
        with loaded(tracking()) as unit:
            times = [name for name in unit.variables if name == "time" or name.endswith(".time")]
            unit.begin(start)
            np.testing.assert_array_equal(unit.take(*times), [start] * 4)
            found.append(walk(unit, [SAMPLE] * 400, **{"y_target": TARGET}))
            np.testing.assert_allclose(unit.take(*times), [start + 0.08] * 4, rtol=1e-12)
            places = [
                k
                for k, n in enumerate(n for n, v in unit.variables.items() if v.type != "String")
                if not n.endswith("time")
            ]
    scale = np.maximum(np.abs(found[0][places]), 1e-9 * np.max(np.abs(found[0][places])))
    assert np.max(np.abs(found[1][places] - found[0][places]) / scale) < 1e-8


def test_parameters_reach_the_parts() -> None:
    """Set by the host, built in by --set, or set in the runner: the same."""
    changed = {
        "plant.beam[2].tip_mass": 0.05,
        "plant.spring[1].stiffness": 9.0,
        "controller.integral_gain": 2e-4,
        "feedforward.transition_time": 0.7,
        "controller.feedback": False,
    }
    built, recording = alone("tracking", stop_time=1.2, overrides=changed)
    with loaded(tracking()) as unit:
        rows = stimuli("tracking", [n for n, v in unit.variables.items() if v.causality == "input"], stop_time=1.2)
        for name, value in changed.items():
            unit.set_start(name, value)
        values = drive(unit, rows, recording.columns, SAMPLE)
        default, _ = alone("tracking", stop_time=1.2)
    np.testing.assert_array_equal(built, recording.values)
    np.testing.assert_array_equal(values, recording.values)
    assert np.max(np.abs(values - default)) > 1.0


def test_instances_do_not_touch() -> None:
    """In threads side by side each does what it does alone."""

    def work(unit: Loaded, level: float) -> bytes:
        rows = [
            walk(unit.begin() if k == 0 else unit, [SAMPLE] * 20, **{"y_target": level * np.array(TARGET)})
            for k in range(5)
        ]
        return np.array(rows).tobytes()

    levels = [0.25, 0.5, 0.75, 1.0]
    with ExitStack() as stack:  # loaded one by one, since FMPy changes the present directory meanwhile
        alone, beside = (
            [stack.enter_context(loaded(tracking(), f"loop {level}")) for level in levels] for _ in range(2)
        )
        expected = list(map(work, alone, levels))
        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(work, beside, levels)) == expected
    assert len(set(expected)) == 4


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("plant.beam[2].tip_mass", -0.5, r"plant\.beam\[2\]\.tip_mass must be >= 0\.0, got -0\.5"),
        ("plant.beam[1].density", 0.0, r"plant\.beam\[1\]\.density must be >= 1\.0, got 0\.0$"),
        ("controller.integral_gain", 1.5, r"controller\.integral_gain must be <= 0\.0012, got 1\.5"),
        ("force[3]", float("nan"), r"force\[3\] must be finite, got nan"),
        ("controller.u_ff[1]", 1.0, r"controller\.u_ff\[1\] is local and cannot be set, got 1\.0"),
        (
            "y_target[1]",
            0.3,
            r"feedforward: y_target is out of reach: it takes [\d.]+ V at rest, voltage_limit is 1000\.0 V",
        ),
    ],
)
def test_refusals_name_the_variable_of_the_part(name: str, value: float, message: str) -> None:
    with loaded(tracking()) as unit:
        unit.prepare()
        with pytest.raises(UnitFailure, match=message):  # noqa: PT012 either call may be the one that is refused
            unit.set_start(name, value)
            unit.call("exitInitializationMode")


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize(("sign", "rule"), [(1.0, r"<= 10000\.0"), (-1.0, r">= -10000\.0")])
def test_what_is_passed_on_beyond_a_bound_is_refused(sign: float, rule: str, coupling: str) -> None:
    """When the initialisation ends, and in a step, in either direction; patches that answer 20 times as strongly."""
    changed = {"coupling": coupling} if coupling == "gauss-seidel" else {}
    with loaded(folder_of(exported("hysteresis_imperfect", stop_time=1.2, **changed))) as unit:
        plain = unit.begin().advance(SAMPLE).everything()
        unit.call("reset")
        patches = {"actuator.linear_weight": 20.0, "controller.feedback": False}
        message = rf"plant\.u\[1\] must be {rule}, got {'-' if sign < 0 else ''}1\d{{4}}\."
        with pytest.raises(UnitFailure, match=message):
            unit.begin(**patches, **{"actuator.history[1,4]": sign * 800.0})
        unit.call("reset")
        target = np.linalg.pinv(design_of().arrays["static_inverse"]) @ (sign * np.array([800.0, 0.0, 0.0, 0.0]))
        unit.begin(**patches).advance(0.1, y_target=target)
        with pytest.raises(UnitFailure, match=message):
            unit.advance(1.0)
        unit.call("reset")
        np.testing.assert_array_equal(unit.begin().advance(SAMPLE).everything(), plain)


def test_lines_in_the_log_name_the_part() -> None:
    with loaded(tracking()) as unit:
        unit.begin(**{"feedforward.transition_time": 0.1})
        unit.advance(SAMPLE, **{"y_target": TARGET})
        unit.advance(PLANNING_TICKS * SAMPLE)
        unit.advance(SAMPLE, **{"y_target": [0.3, 0.0, 0.0, 0.0]})
        assert [note.partition(" at ")[0] for note in unit.notes] == [
            "unit: feedforward: the transition",
            "unit: feedforward: y_target",
        ]
        unit.call("setReal", [unit.variables["feedforward.voltage_limit"].valueReference], [10.0])
        with pytest.raises(UnitFailure, match=r"plant\.beam\[1\]\.density is fixed and cannot be set after init"):
            unit.put("plant.beam[1].density", 1e3)


def test_what_is_wired_is_local_and_what_is_not_is_an_input() -> None:
    root = ElementTree.parse(tracking() / "modelDescription.xml").getroot()
    variables = {v.get("name", ""): v for v in root.iter("ScalarVariable")}
    arrays: dict[str, set[str]] = {}
    for name, variable in variables.items():
        arrays.setdefault(str(variable.get("causality")), set()).add(name.partition("[")[0])
    assert arrays["input"] == {"y_target", "force"}
    assert arrays["output"] == {
        "u_ff",
        "y_ref",
        "moving",
        "u",
        "y_est",
        "saturated",
        "y_pi",
        "y_pm",
    }
    assert {
        "plant.u",
        "controller.y_pm",
        "controller.u_ff",
        "controller.x_ref",
        "feedforward.x_ref",
        "plant.w",
        "plant.energy",
    } <= arrays["local"]
    assert variables["plant.u[2]"].get("description") == "Voltage of patch pair 2; from controller.u[2]"
    assert (
        len(
            [
                n
                for n, v in variables.items()
                if n.startswith("plant.")
                and v.get("causality") == "parameter"
                and "start_at" not in n
                and "noise" not in n
            ]
        )
        == 37
    )
    assert root.findall(".//Outputs/Unknown[@dependencies='']")
    numbers = {name: str(k) for k, name in enumerate(variables, 1)}
    first = {u.get("index"): str(u.get("dependencies")).split() for u in root.findall(".//InitialUnknowns/Unknown")}
    assert numbers["y_target[3]"] in first[numbers["u[2]"]]
    assert numbers["force[1]"] not in first[numbers["u[2]"]]
    assert numbers["y_target[3]"] not in first[numbers["y_pi[1]"]]
    page = (tracking() / "documentation" / "index.html").read_text()
    assert "<td>feedforward.x_ref</td><td>controller.x_ref</td>" in page
    assert "<code>force[3]</code>" in page


def test_the_command_writes_a_valid_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "loop.fmu"
    assert (
        main(
            [
                "export",
                "single_beam",
                "--format",
                "closed-loop",
                "--platform",
                "aarch64-linux",
                "--stop-time",
                "2.0",
                "--coupling",
                "gauss-seidel",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    assert main(["validate", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n{out}: valid\n"
    assert validate_fmu(str(out)) == []
    with zipfile.ZipFile(out) as archive:
        names = archive.namelist()
        experiment = ElementTree.fromstring(archive.read("modelDescription.xml")).find("DefaultExperiment")
    libraries = [f"binaries/{folder}/BeamClosedLoop.so" for folder in ("aarch64-linux", "linux64")]
    assert [n for n in names if n.startswith("binaries/")] == libraries
    assert experiment is not None
    assert (experiment.get("stopTime"), experiment.get("stepSize")) == ("2.0", "0.0002")


def test_equal_exports_have_equal_bytes(tmp_path: Path) -> None:
    again = export_closed_loop("tracking", tmp_path / "a folder" / "again.fmu", settings(stop_time=1.2))
    assert again.read_bytes() == exported("tracking", stop_time=1.2).read_bytes()


def test_the_unit_runs_in_scenarios_and_packages(tmp_path: Path, write_scenario: Callable[[str, str], Path]) -> None:
    """Its signals then come from outside: from the runner, or from a package's source."""
    (tmp_path / "tracking.fmu").write_bytes(exported("tracking", stop_time=1.2).read_bytes())
    scenario = str(
        write_scenario(
            "outer",
            f"""title = "x"
structure = "kiel"
stop_time = 1.1
[instance.loop]
fmu = "tracking.fmu"
[[input]]
to = "loop.y_target"
targets = [{{ time = 1.0, value = {TARGET} }}]
""",
        )
    )
    expected = run_scenario("tracking", settings(stop_time=1.1)).recording
    own = run_scenario(scenario, settings()).recording
    package = export_ssp(scenario, tmp_path / "outer.ssp", settings())
    assert package_problems(package) == []
    there = run_package(package, settings()).recording
    for recording in (own, there):
        places = [recording.columns.index(f"loop.y_pi[{k}]") for k in (1, 2, 3, 4)]
        wanted = expected.values[:, [expected.columns.index(f"plant.y_pi[{k}]") for k in (1, 2, 3, 4)]]
        assert np.max(np.abs(wanted)) > 1e-5
        np.testing.assert_allclose(recording.values[:, places], wanted, rtol=0, atol=1e-12 * np.max(np.abs(wanted)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ('unit = "BeamPlant"\nbasis', 'fmu = "x.fmu"\n# basis'),
            r"instance\.second\.fmu must be a unit of this project in a closed loop, not an FMU file, got 'x\.fmu'",
        ),
        (
            ("second", "a_name_of_twenty_one"),
            r"instance\.a_name_of_twenty_one must have at most 18 letters, digits and",
        ),
        (("[instance.second]", '[instance."größer"]'), r"instance\.größer must have at most 18 letters"),
        (('to = "second.u"', 'to = "second.u[2]"'), r"connection\[4\] must join equal sizes"),
        (
            ('from = "controller.u"\nto = "first.u"', 'from = "controller.u[1]"\nto = "first.u[3]"'),
            r"first\.u must be wired as a whole or not at all in a closed loop, got first\.u\[3\]",
        ),
    ],
)
def test_what_cannot_be_one_unit_is_refused_in_one_line(
    change: tuple[str, str], message: str, tmp_path: Path, write_scenario: Callable[[str, str], Path]
) -> None:
    text = TWO_PLANTS.replace(*change)
    assert text != TWO_PLANTS
    path = write_scenario("two", text)
    with pytest.raises(InputError, match=message) as caught:
        export_closed_loop(str(path), tmp_path / "loop.fmu", settings())
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "loop.fmu").exists()
