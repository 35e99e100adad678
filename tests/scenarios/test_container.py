"""A scenario's container: one valid unit that a host drives, with the results of the runner under both couplings."""

import hashlib
import os
import re
import struct
import sys
import zipfile
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from flexbeams.fmus.errors import BuildError
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import find_scenario, read_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.signals import signal_of
from flexbeams.scenarios.exporting.container import export_container
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.recording import Recording
from tests.helpers import ALLOCATOR_NOISE, CYCLES, PUSHED_SCENARIO, Export, exported_once, resident
from tests.units.loaded import pushed_in_turn

pytestmark = pytest.mark.native

STEP = 2e-4
STOPS = {"tracking": 1.3, "disturbance": 1.1, "retarget": 1.7, "hysteresis_imperfect": 1.3}  # s: into the motions
DRIVEN = ("plant.u[", "plant.force[", "actuator.u[", "compensator.u_eff[")  # recorded inputs
COUPLINGS = ("jacobi", "gauss-seidel")
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")

Host = Callable[[Path], UnitInstance]
# Outputs that keep no instance in the container, as they are unique
OWNERS = {
    "u_eff": "actuator",
    **dict.fromkeys(("y_pi", "y_pm"), "plant"),
    **dict.fromkeys(("u", "y_est", "saturated"), "controller"),
    **dict.fromkeys(("u_ff", "y_ref", "moving"), "feedforward"),
}


@pytest.fixture(scope="module")
def export() -> Export:
    return exported_once(export_container, ".fmu")


@pytest.fixture
def load(tmp_path: Path) -> Host:
    """Loads a container from a folder of its own: extracting over a loaded library would be fatal."""

    def extract(file: Path) -> UnitInstance:
        folder = tmp_path / f"{file.stem}{len(list(tmp_path.iterdir()))}"
        fmpy.extract(str(file), unzipdir=str(folder))
        return loaded(folder)

    return extract


@pytest.fixture(scope="module")
def reference(run_folder: Path) -> Callable[[str, Any], Recording]:
    """The runner's recording of a scenario under a coupling, each made once."""
    made: dict[tuple[str, str], Recording] = {}

    def run(scenario: str, coupling: Any) -> Recording:
        if (scenario, coupling) not in made:
            settings = Settings(
                record_animation=False,
                build_folder=run_folder / "build/fmus",
                coupling=coupling,
                stop_time=STOPS[scenario],
            )
            made[scenario, coupling] = run_scenario(scenario, settings).recording
        return made[scenario, coupling]

    return run


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small scenario with a target and a push on one beam, 0.1 s."""
    path = tmp_path_factory.mktemp("scenario") / "pushed.toml"
    path.write_text(PUSHED_SCENARIO.format(stop=0.1))
    return path


def loaded(folder: Path) -> UnitInstance:
    return UnitInstance("loop", folder, fmpy.read_model_description(str(folder)), lambda text: None)


def initialise(unit: UnitInstance) -> None:
    unit.call("setupExperiment", None, 0.0, None)
    unit.call("enterInitializationMode")
    unit.call("exitInitializationMode")


def without_owner(name: str) -> str:
    """<variable> of <instance>.<variable>."""
    return name.partition(".")[2]


def drive(
    unit: UnitInstance, scenario: str, steps: int, multiple: int = 1, time: Callable[[int], float] | None = None
) -> tuple[list[str], Array]:
    """Number outputs, named as in a run, and their values at 0 and after each of `steps` steps of the host.

    It is driven as in the scenario.
    """
    step = multiple * STEP
    names = [n for n, v in unit.variables.items() if v.causality == "input"]
    outputs = [
        n
        for kind in ("Real", "Boolean")
        for n, v in unit.variables.items()
        if v.causality == "output" and v.type == kind
    ]
    inputs, path = np.zeros((steps + 1, len(names))), find_scenario(scenario)
    for signal in read_scenario(path).input:
        places = [
            k
            for k, n in enumerate(names)
            for to in (signal.to, without_owner(signal.to))
            if re.match(rf"{re.escape(to)}(\[|$)", n)
        ]
        inputs[:, places] = signal_of(signal, path.parent).sample(np.arange(steps + 1) * step)
    values, rows = np.zeros(len(outputs)), np.empty((steps + 1, len(outputs)))
    unit.connect(outputs, values, names)
    unit.call("setupExperiment", None, 0.0, steps * step)
    unit.call("enterInitializationMode")
    unit.inputs[:] = inputs[0]
    unit.write()
    unit.call("exitInitializationMode")
    for k in range(steps):
        unit.read()
        rows[k] = values
        unit.inputs[:] = inputs[k]
        unit.write()
        unit.step(time(k) if time else k * step, step)
    unit.read()
    rows[-1] = values
    return [n if "." in n else f"{OWNERS[n.partition('[')[0]]}.{n}" for n in outputs], rows


def deviation(reference: Recording, outputs: list[str], rows: Array, multiple: int = 1) -> float:
    """Largest difference of an output, relative to its largest value in the reference."""
    expected = reference.values[::multiple, [reference.columns.index(n) for n in outputs]]
    scale = np.max(np.abs(expected), axis=0)
    error = np.max(np.abs(expected - rows), axis=0)
    assert np.all(error[scale == 0] == 0)
    return float(np.max(error[scale > 0] / scale[scale > 0]))


@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("scenario", STOPS)
def test_the_container_runs_as_its_scenario(
    scenario: str, coupling: str, export: Export, load: Host, reference: Callable[[str, str], Recording]
) -> None:
    expected = reference(scenario, coupling)
    with load(export(scenario, coupling=coupling)) as unit:
        outputs, rows = drive(unit, scenario, expected.steps)
    assert set(outputs) == {c for c in expected.columns if not c.startswith(DRIVEN)}
    assert {n.split("[")[0] for n in outputs} >= {"plant.y_pi", "plant.y_pm", "controller.u", "feedforward.y_ref"}
    assert np.max(np.abs(rows[:, outputs.index("controller.u[1]")])) > 1
    assert deviation(expected, outputs, rows) <= 1e-12
    (other,) = set(COUPLINGS) - {coupling}
    assert deviation(reference(scenario, other), outputs, rows) > 1e-4


@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("multiple", [5, 25])
def test_larger_steps_of_the_host_give_the_same_results(
    multiple: int, coupling: str, export: Export, load: Host, reference: Callable[[str, str], Recording]
) -> None:
    """The host's time may carry the rounding errors of a sum."""
    expected = reference("tracking", coupling)
    steps = expected.steps // multiple
    sums = np.concatenate([[0.0], np.cumsum(np.full(steps, multiple * STEP))])
    assert np.any(sums != np.arange(steps + 1) * multiple * STEP)
    for time in (None, lambda k: float(sums[k])):
        with load(export("tracking", coupling=coupling)) as unit:
            outputs, rows = drive(unit, "tracking", steps, multiple, time)
        assert deviation(expected, outputs, rows, multiple) <= 1e-12


def test_fmpy_s_master_gives_the_same_results(
    export: Export, write_scenario: Callable[[str, str], Path], short: Callable[..., Settings]
) -> None:
    """Targets and parameters that a host sets before the initialisation count from the first step on."""
    text = find_scenario("tracking").read_text().replace("time = 1.0, value", "time = 0.0, value")
    values = {"feedforward.transition_time": 0.1, "plant.beam[2].tip_mass": 0.03, "controller.feedback": False}
    reference = run_scenario(str(write_scenario("early", text)), short(stop_time=0.3, overrides=values)).recording
    target = dict(zip([f"y_target[{k}]" for k in (1, 2, 3, 4)], (-8e-3, 1e-3, 4e-3, -6e-3), strict=True))
    outputs = [n for n in reference.columns if n.startswith(("plant.y_p", "controller.u", "feedforward.y_ref"))]
    table = fmpy.simulate_fmu(
        str(export("tracking", coupling="jacobi")),
        stop_time=0.3,
        step_size=STEP,
        output_interval=STEP,
        start_values=values | target,
        output=[without_owner(n) for n in outputs],
    )
    rows = np.column_stack([table[without_owner(n)] for n in outputs])
    assert len(rows) == reference.steps + 1
    assert deviation(reference, outputs, rows) <= 1e-12


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_structure_that_starts_at_rest_under_voltages(
    coupling: Any, export: Export, load: Host, short: Callable[..., Settings]
) -> None:
    """The first values of the strains pass through the loop as in the runner."""
    values: dict[str, Any] = {f"plant.start_at_rest_under[{k}]": 50.0 * k for k in (1, 2, 3, 4)}
    reference = run_scenario("tracking", short(stop_time=0.04, coupling=coupling, overrides=values)).recording
    with load(export("tracking", coupling=coupling)) as unit:
        for name, value in values.items():
            unit.set_start(name, value)
        outputs, rows = drive(unit, "tracking", reference.steps)
    assert np.all(rows[0, [outputs.index(f"plant.y_pm[{k}]") for k in (1, 2, 3)]] != 0)
    assert deviation(reference, outputs, rows) <= 1e-12


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_the_container_is_valid(coupling: Any, export: Export, capsys: pytest.CaptureFixture[str]) -> None:
    path = export("tracking", coupling=coupling)
    assert validate_fmu(str(path)) == []  # with FMI's schema
    assert main(["validate", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: valid\n"
    description = fmpy.read_model_description(str(path))
    assert description.modelName == description.coSimulation.modelIdentifier == "tracking"
    assert (description.defaultExperiment.stepSize, description.defaultExperiment.stopTime) == ("0.0002", "6.0")
    assert not description.coSimulation.canBeInstantiatedOnlyOncePerProcess
    assert not description.coSimulation.canGetAndSetFMUstate
    assert coupling in description.description


def test_nothing_drives_the_loop_but_its_host(export: Export) -> None:
    path = export("disturbance", coupling="jacobi")
    variables = {v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
    inputs = [n for n, v in variables.items() if v.causality == "input"]
    assert inputs == [*(f"y_target[{k}]" for k in (1, 2, 3, 4)), *(f"force[{k}]" for k in (1, 2, 3))]
    assert not [n for n, v in variables.items() if v.causality == "output" and ("x_ref" in n or "." in n)]
    assert variables["time"].valueReference == 0
    units = {
        "y_target[1]": "m",
        "force[2]": "N",
        "u[4]": "V",
        "y_pi[1]": "m",
        "feedforward.transition_time": "s",
        "controller.voltage_limit": "V",
        "plant.beam[1].youngs_modulus": "Pa",
    }
    assert {n: variables[n].unit for n in units} == units
    assert variables["controller.feedback"].variability == "tunable"
    assert variables["plant.beam[1].tip_mass"].min == "0.0"
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        flags = archive.read("resources/container.txt").decode().splitlines()[2]
    assert sorted(n for n in names if n.endswith(".so") and "linux64" in n and "resources" in n) == [
        "resources/00/binaries/linux64/FlatnessFeedforward.so",
        "resources/01/binaries/linux64/TrackingController.so",
        "resources/02/binaries/linux64/BeamPlant.so",
    ]
    assert flags == "0 0 0"  # one thread, no profiling, no sequence
    assert {"documentation/licenses/LICENSE", "documentation/licenses/FMUContainer"} <= set(names)


def test_start_values_are_equal_in_description_and_kernel(export: Export, load: Host) -> None:
    values: dict[str, Any] = {
        "plant.beam[2].tip_mass": 0.033,
        "plant.noise_seed": 5.0,
        "controller.feedback": False,
        "plant.force": [0.0, 0.5, 0.0],
    }
    wanted = {
        "plant.beam[2].tip_mass": 0.033,
        "plant.noise_seed": 5.0,
        "controller.feedback": 0.0,
        "force[2]": 0.5,
    }
    with load(export("mismatch", overrides=values)) as unit:
        read = {"Boolean": lambda text: {"true": 1.0, "false": 0.0}[text], "Real": float, "Integer": float}
        starts = {n: read[v.type](v.start) for n, v in unit.variables.items() if v.start is not None and v.type in read}
        assert len(starts) > 50
        assert wanted.items() <= starts.items()
        assert {
            n: float(unit.call(f"get{unit.variables[n].type}", [unit.variables[n].valueReference])[0]) for n in starts
        } == starts
        design = next(v for n, v in unit.variables.items() if n == "plant.design_id")
        assert unit.get("plant.design_id") == design.start


def test_parameters_can_be_tuned_while_it_runs(export: Export, load: Host) -> None:
    """Without feedback the feedforward's voltages of the step before pass through."""
    with load(export("tracking", coupling="jacobi")) as unit:
        initialise(unit)
        unit.set_start("y_target[1]", -5e-3)
        for k in range(500):
            unit.step(k * STEP, STEP)
        assert unit.get("u[1]") != unit.get("u_ff[1]") != 0
        unit.set_start("controller.feedback", False)
        for k in range(500, 503):
            before = unit.get("u_ff[1]")
            unit.step(k * STEP, STEP)
        assert unit.get("u[1]") == before


def test_a_reset_container_runs_as_a_new_one(export: Export, load: Host) -> None:
    with load(export("retarget", coupling="jacobi")) as unit:
        first = drive(unit, "retarget", 6000)[1]
        unit.call("reset")
        assert np.array_equal(drive(unit, "retarget", 6000)[1], first)


def test_values_that_units_refuse_are_refused(export: Export, load: Host) -> None:
    with load(export("tracking", coupling="jacobi")) as unit:
        with pytest.raises(UnitFailure, match="setReal"):
            unit.set_start("plant.beam[1].tip_mass", -1.0)
        unit.call("reset")
        initialise(unit)
        with pytest.raises(UnitFailure):
            unit.set_start("y_target[1]", float("nan"))


def test_equal_exports_have_equal_bytes(pushed: Path, export: Export, tmp_path: Path) -> None:
    one, other = export(str(pushed)), export(str(pushed), coupling="gauss-seidel")
    again = export_container(str(pushed), tmp_path / "again.fmu", Settings(record_animation=False, coupling="jacobi"))
    assert hashlib.sha256(one.read_bytes()).digest() == hashlib.sha256(again.read_bytes()).digest()
    assert fmpy.read_model_description(str(one)).guid != fmpy.read_model_description(str(other)).guid


def test_the_console_stays_clean(pushed: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "loop.fmu"
    assert main(["export", str(pushed), "--format", "container", "-o", str(path)]) == 0
    out, err = capfd.readouterr()
    assert out == f"{path}\n"
    assert err == (
        "building FlatnessFeedforward, TrackingController, BeamPlant\nthe host drives y_target[1], force[1]\n"
    )
    assert list(tmp_path.iterdir()) == [path]


def test_binaries_lie_where_the_container_looks_for_them(pushed: Path, tmp_path: Path) -> None:
    """The tool's macOS binary is one for arm64, and loads units from darwin64."""
    wanted = ("x86_64-linux", "x86_64-windows", "aarch64-darwin")
    path = export_container(str(pushed), tmp_path / "all.fmu", Settings(record_animation=False), wanted)
    with zipfile.ZipFile(path) as archive:
        binaries = [n for n in archive.namelist() if "binaries/" in n]
        folders = {re.sub(r".*binaries/(.*)/.*", r"\1", n) for n in binaries if n.startswith("binaries/")}
        assert folders == {"linux64", "win64", "darwin64", *wanted}
        for k, unit in enumerate(("FlatnessFeedforward", "TrackingController", "BeamPlant")):
            place = f"resources/{k:02x}/binaries/"
            inside = {n.removeprefix(place) for n in binaries if n.startswith(place)}
            assert inside == {f"linux64/{unit}.so", f"win64/{unit}.dll", f"darwin64/{unit}.dylib"}
        for name in (n for n in binaries if "darwin" in n):
            magic, machine = struct.unpack_from("<II", archive.read(name))
            assert (magic, machine) == (0xFEEDFACF, 0x0100000C)  # 64-bit Mach-O, arm64
    assert validate_fmu(str(path)) == []


@pytest.mark.parametrize(
    ("platforms", "message"),
    [
        (
            ("aarch64-linux",),
            "--platform must be among x86_64-linux, x86_64-windows, aarch64-darwin for a container, "
            "whose tool has no other binaries; --format closed-loop builds for all, got 'aarch64-linux'",
        ),
        (("host", "x86_64-darwin"), "--platform must be among .*, got 'x86_64-darwin'"),
        (("all",), "--platform must be among .*, got 'aarch64-linux, x86_64-darwin'"),
    ],
)
def test_platforms_without_a_binary_are_refused(
    platforms: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "no.fmu"
    with pytest.raises(InputError, match=message):
        export_container("tracking", out, Settings(record_animation=False), platforms)
    options = [option for platform in platforms for option in ("--platform", platform)]
    assert main(["export", "tracking", "--format", "container", "-o", str(out), *options]) == 2
    assert re.fullmatch(f"flexbeams: {message}\n", capsys.readouterr().err)
    assert not out.exists()


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (
            None,
            r"containers need fmu-manipulation-toolbox 2\.0 or newer: pip install 'fmu-manipulation-toolbox>=2\.0', or "
            "choose --format closed-loop",
        ),
        ("1.9.4.2", r"containers need fmu-manipulation-toolbox 2\.0 or newer, 1\.9\.4\.2 is installed: pip install "),
    ],
)
def test_a_missing_tool_is_named(
    found: str | None, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def version(package: str) -> str:
        if found is None:
            raise PackageNotFoundError(package)
        return found

    monkeypatch.setattr("flexbeams.scenarios.exporting.container.version", version)
    with pytest.raises(BuildError, match=message):
        export_container("tracking", tmp_path / "no.fmu", Settings(record_animation=False))
    assert main(["export", "tracking", "--format", "container", "-o", str(tmp_path / "no.fmu")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_the_tool_refuses_is_one_line(pushed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fmu_manipulation_toolbox.container import FMUContainer, FMUContainerError

    def refuse(self: Any, *arguments: Any) -> None:
        raise FMUContainerError("no such port")

    monkeypatch.setattr(FMUContainer, "add_link", refuse)
    with pytest.raises(BuildError, match=r"^the container cannot be made: no such port$"):
        export_container(str(pushed), tmp_path / "no.fmu", Settings(record_animation=False))
    assert list(tmp_path.iterdir()) == []


BROUGHT = (
    'title = "x"\nstructure = "single_beam"\nstop_time = 0.05\nrecord = ["theirs.energy"]\n[instance.theirs]\n'
    'fmu = "theirs.fmu"\n{start}\n[instance.ours]\nunit = "BeamPlant"\n[[input]]\nto = "theirs.u"\n'
    'constant = 10.0\n[[input]]\nto = "ours.u"\nconstant = 10.0\n'
)


def test_fmus_that_a_scenario_brings_along_go_inside(
    tmp_path: Path,
    write_scenario: Callable[[str, str], Path],
    pushed: Path,
    export: Export,
    load: Host,
    short: Callable[..., Settings],
) -> None:
    with zipfile.ZipFile(export(str(pushed))) as archive, zipfile.ZipFile(tmp_path / "theirs.fmu", "w") as theirs:
        for name in archive.namelist():
            if name.startswith("resources/02/"):
                theirs.writestr(name.removeprefix("resources/02/"), archive.read(name))
    scenario = write_scenario("both", BROUGHT.format(start=""))
    both = export_container(str(scenario), tmp_path / "both.fmu", Settings(record_animation=False))
    assert validate_fmu(str(both)) == []
    description = fmpy.read_model_description(str(both))
    assert all(unknown.dependencies is None for unknown in description.outputs)  # nobody knows them
    reference = run_scenario(str(scenario), short()).recording
    with load(both) as unit:
        outputs, rows = drive(unit, str(scenario), reference.steps)
    assert {n.split(".")[0] for n in outputs} == {"theirs", "ours"}
    assert np.max(np.abs(rows)) > 0
    assert deviation(reference, outputs, rows) <= 1e-12

    def refused(message: str, platforms: tuple[str, ...] = ("host",)) -> None:
        with pytest.raises(InputError, match=message):
            export_container(str(scenario), tmp_path / "no.fmu", Settings(record_animation=False), platforms)
        assert not (tmp_path / "no.fmu").exists()

    refused(r"instance\.theirs\.fmu must have a binary for x86_64-windows, got 'theirs\.fmu'", ("x86_64-windows",))
    scenario.write_text(BROUGHT.format(start="start.noise_seed = 3"))
    refused(r"instance\.theirs must keep the start values of its FMU in a container, got 'noise_seed'")


def test_scenarios_of_any_name_and_with_one_unit_only(
    tmp_path: Path, load: Host, short: Callable[..., Settings]
) -> None:
    scenario = tmp_path / "2 steps-up.toml"
    scenario.write_text(
        'title = "x"\nstructure = "single_beam"\nstop_time = 0.05\nrecord = ["plant.energy"]\n'
        '[instance.plant]\nunit = "BeamPlant"\n[[input]]\nto = "plant.u[1]"\nconstant = 100.0\n'
    )
    path = export_container(str(scenario), tmp_path / "one.fmu", Settings(record_animation=False))
    assert validate_fmu(str(path)) == []
    assert fmpy.read_model_description(str(path)).modelName == "_2_steps_up"
    reference = run_scenario(str(scenario), short()).recording
    with load(path) as unit:
        outputs, rows = drive(unit, str(scenario), reference.steps)
        energy = unit.get("plant.energy")
    assert deviation(reference, outputs, rows) <= 1e-12
    assert energy == reference.values[-1, reference.columns.index("plant.energy")] > 0


def test_containers_live_side_by_side(export: Export, load: Host, tmp_path: Path) -> None:
    """Two of equal names and other units inside, and two instances of one library."""
    heavy = export("tracking", coupling="jacobi", overrides={"plant.beam[1].tip_mass": 0.5})
    light = export("tracking", coupling="jacobi")

    def walk(units: list[UnitInstance]) -> list[list[float]]:
        rows = pushed_in_turn(units, "force[1]", "y_pi[1]")
        for unit in reversed(units):
            unit.close()
        return rows

    def started(*units: UnitInstance) -> list[UnitInstance]:
        for unit in units:
            initialise(unit)
        return list(units)

    alone = [walk(started(load(file)))[0] for file in (light, heavy)]
    fmpy.extract(str(light), unzipdir=str(tmp_path / "shared"))
    together = walk(started(load(light), load(heavy), loaded(tmp_path / "shared"), loaded(tmp_path / "shared")))
    assert alone[0] != alone[1]
    assert together == [*alone, alone[0], alone[0]]


@LINUX
def test_memory_is_flat_over_loading_and_unloading(export: Export, tmp_path: Path) -> None:
    folder = tmp_path / "loop"
    fmpy.extract(str(export("tracking", coupling="jacobi")), unzipdir=str(folder))

    def cycle() -> None:
        unit = loaded(folder)
        initialise(unit)
        unit.step(0.0, STEP)
        unit.close()

    def state() -> tuple[int, int, int]:
        """Libraries in memory, open files, threads."""
        libraries = sum(".so" in line for line in Path("/proc/self/maps").read_text().splitlines())
        return libraries, len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))

    for _ in range(50):  # until the tables of the interpreter and of the allocator have their sizes
        cycle()
    before, at_first = resident(), state()
    for _ in range(4 * CYCLES):
        cycle()
    assert resident() - before < ALLOCATOR_NOISE
    assert state() == at_first
