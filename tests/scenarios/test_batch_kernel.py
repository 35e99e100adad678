"""The batch kernel against the FMI units, sample by sample: noise, saturation, forces, each measure that it covers."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.study_file import load_study
from flexbeams.scenarios.results.checks import Measurement
from flexbeams.scenarios.runs.repeated import RepeatedRun, lean
from flexbeams.scenarios.runs.scenario import unit_files
from flexbeams.scenarios.simulation.batch_kernel import INCLUDES, SOURCES, Batch, batch_libraries
from flexbeams.scenarios.simulation.native_stepper import stepper_library
from flexbeams.scenarios.studies.batch import COVERED, BatchPlan, batch_plan
from flexbeams.scenarios.studies.planning import StudyPlan, plan_study
from tests.helpers import LOOP_WIRES, PUSHED_SCENARIO

pytestmark = pytest.mark.native

THREE_BEAMS = (
    """title = "three beams, pushed"
structure = "kiel"
stop_time = 0.1
[instance.controller]
unit = "TrackingController"
[instance.feedforward]
unit = "FlatnessFeedforward"
start.transition_time = 0.9
[instance.plant]
unit = "BeamPlant"
"""
    + LOOP_WIRES
    + """[[input]]
to = "plant.force[2]"
pulse = { time = 0.02, duration = 5e-3, impulse = 0.03 }
[[input]]
to = "feedforward.y_target"
targets = [{ time = 0.01, value = [-8e-3, 1e-3, 4e-3, -6e-3] }]
"""
)
PARAMETERS = """title = "batch"
scenario = "batched.toml"
runs = 11
[[parameter]]
name = "plant.beam[].tip_mass"
range = [0.8, 1.2]
relative = true
[[parameter]]
name = "plant.patch[].piezo_ratio"
range = [0.8, 1.2]
relative = true
"""
NOISE = """[[parameter]]
name = "plant.noise_seed"
distribution = "randint"
arguments = { low = 1.0, high = 1e9 }
[[parameter]]
name = "plant.strain_noise_std"
values = [0.0, 1e-6]
"""
MEASURES = "".join(
    f"""[[measure]]
name = "{kind} {reference}"
measure = "{kind}"
of = "{of}"
reference = "{reference}"
after = {after}
share = 0.5
"""
    for kind, of, reference, after in (
        *((kind, "plant.y_pi", "target", 0.02) for kind in COVERED),
        *((kind, "plant.y_pi", "end", 0.0) for kind in ("largest", "overshoot")),
        ("largest", "plant.y_pm", "start", 0.03),
        ("largest", "controller.u", "zero", 0.0),
        ("largest_change", "plant.u[1]", "zero", 0.0),
    )
)


@pytest.fixture
def plan_of(tmp_path: Path) -> Callable[..., StudyPlan]:
    """A function that plans a study of a scenario's text."""

    def plan(scenario: str, parameters: str = PARAMETERS, **settings: Any) -> StudyPlan:
        (tmp_path / "batched.toml").write_text(scenario, encoding="utf-8")
        path = tmp_path / "study.toml"
        path.write_text(parameters + MEASURES, encoding="utf-8")
        return plan_study(load_study(path), Settings(**settings))

    return plan


def batched(plan: StudyPlan) -> tuple[BatchPlan, dict[str, Path]]:
    settings = plan.prepared.settings
    library = stepper_library(settings.build_folder, settings.compiler)
    found = batch_plan(plan.prepared, plan.axes, plan.checks, unit_files(plan.prepared, print), library)
    assert found is not None
    return found, batch_libraries(settings.build_folder, settings.compiler)


def through_units(plan: StudyPlan) -> Array:
    """Measures (runs, measures) of the FMI units."""
    prepared, settings = plan.prepared, plan.prepared.settings
    run, library = lean(prepared), stepper_library(settings.build_folder, settings.compiler)
    scenario = replace(prepared.scenario, check=plan.checks)
    found = []
    with RepeatedRun(run, unit_files(prepared, print), library) as loop:
        for row in plan.samples.values:
            starts: dict[str, dict[str, float | int]] = {}
            for axis, value in zip(plan.axes, row.tolist(), strict=True):
                for target in axis.targets:
                    own = int(value) if target.variable == "noise_seed" else value * target.factor
                    starts.setdefault(target.instance, {})[target.variable] = own
            recording = loop.run(starts)  # type: ignore[arg-type]
            assert recording.failure is None
            found.append([o.value for o in Measurement(scenario, "", recording, None).outcomes()])
    return np.array(found)


def largest_gap(measures: Array, units: Array) -> float:
    """Relative to each measure (runs, measures) of the units, at least to a millionth of its largest."""
    scale = np.maximum(np.abs(units), 1e-6 * np.max(np.abs(units), axis=0))
    return float(np.max(np.abs(measures - units) / np.where(scale > 0, scale, 1.0)))


@pytest.mark.parametrize(
    ("scenario", "parameters", "overrides"),
    [
        (PUSHED_SCENARIO.format(stop=0.06), PARAMETERS, {}),
        (PUSHED_SCENARIO.format(stop=0.06), PARAMETERS + NOISE, {}),
        (THREE_BEAMS, PARAMETERS, {}),
        (THREE_BEAMS, PARAMETERS + NOISE, {"controller.voltage_limit": 10.0, "controller.integral_gain": 1e-3}),
    ],
)
def test_measures_are_those_of_the_units(
    plan_of: Callable[..., StudyPlan], scenario: str, parameters: str, overrides: dict[str, float]
) -> None:
    plan = plan_of(scenario, parameters, overrides=overrides)
    batch, libraries = batched(plan)
    units = through_units(plan)
    with Batch(batch.task, libraries) as loop:
        figures, covered = loop.run(batch.values(plan.samples.values))
    assert covered.all()
    measures = batch.measured(figures)
    if overrides:
        assert np.max(measures[:, [c.of == "controller.u" for c in plan.checks]]) == 10.0
    assert largest_gap(measures, units) < 1e-9


def test_bits_do_not_depend_on_neighbours_and_instructions(plan_of: Callable[..., StudyPlan], tmp_path: Path) -> None:
    """All variants that this machine can run, plain doubles in place of vectors, and gcc where there is one."""
    plan = plan_of(THREE_BEAMS, PARAMETERS + NOISE)
    batch, libraries = batched(plan)
    values = batch.values(plan.samples.values)
    with Batch(batch.task, libraries) as best:
        whole = best.run(values)[0]
        assert np.array_equal(best.run(values[::-1])[0][::-1], whole)
        assert np.array_equal(np.concatenate([best.run(row[None])[0] for row in values]), whole)
    others = [
        {name: file for name, file in libraries.items() if name in names} for names in ("baseline", "baseline v3")
    ]
    for compiler, definitions in (("zig", ["FLEXBEAMS_PLAIN_LANES"]), ("gcc", [])):
        if compiler == "zig" or shutil.which(compiler):
            built = tmp_path / f"{compiler}.so"
            find_compiler(compiler).build(built, SOURCES, INCLUDES, host_platform(), definitions)
            others.append({"baseline": built})
    if shutil.which("gcc") and "v3" in libraries:  # which fuses some products, allowed or not
        built = tmp_path / "gcc-v3.so"
        find_compiler("gcc").build(built, SOURCES, INCLUDES, host_platform(), processor="x86-64-v3")
        others.append({"baseline": libraries["baseline"], "v3": built})
    for other in others:
        with Batch(batch.task, other) as loop:
            assert np.array_equal(loop.run(values)[0], whole)


def test_a_sample_outside_leaves_its_neighbours_alone(plan_of: Callable[..., StudyPlan]) -> None:
    """One without a mass, and one with a strain that the controller would leave out."""
    plan = plan_of(THREE_BEAMS, overrides={"controller.strain_limit": 2e-4})
    batch, libraries = batched(plan)
    values = batch.values(plan.samples.values)
    broken, pushed = values.copy(), replace(batch.task, controller={**batch.task.controller, "strain_limit": 1e-9})
    references = batch.task.plant["parameters"][:, 0]
    broken[1, references[0]] = 0.0  # a density
    with Batch(batch.task, libraries) as loop:
        whole, _ = loop.run(values)
        figures, covered = loop.run(broken)
    assert covered.tolist() == [True, False, *[True] * 9]
    assert np.array_equal(figures[covered], whole[covered])
    with Batch(pushed, libraries) as loop:
        assert not loop.run(values)[1].any()


def test_a_plant_with_real_eigenvalues_is_set_up_by_itself(plan_of: Callable[..., StudyPlan]) -> None:
    """The iteration for damped modes does not converge there; its neighbours go on side by side."""
    damping = """[[parameter]]
name = "plant.beam[].structural_damping"
values = [1.0, 300.0]
relative = true
together = true
"""
    plan = plan_of(THREE_BEAMS, PARAMETERS + damping)
    batch, libraries = batched(plan)
    values = batch.values(plan.samples.values)
    units = through_units(plan)
    with Batch(batch.task, libraries) as loop:
        figures, covered = loop.run(values)
        alone = [loop.run(row[None])[0][0] for row in values]
    assert covered.all()
    assert np.array_equal(figures, alone)
    assert largest_gap(batch.measured(figures), units) < 1e-9


@pytest.mark.parametrize(
    "settings",
    [
        {"coupling": "gauss-seidel"},
        {"step": 4e-4},
        {"overrides": {"controller.feedback": False}},
        {"backend": "python"},
    ],
)
def test_other_loops_go_through_the_units(plan_of: Callable[..., StudyPlan], settings: dict[str, Any]) -> None:
    plan = plan_of(PUSHED_SCENARIO.format(stop=0.06), **settings)
    assert batch_plan(plan.prepared, plan.axes, plan.checks, {}, Path()) is None
