"""Co-simulation of the shipped scenarios, shortened, against the closed loop as one recursion."""

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.plant.galerkin import beam_model
from flexbeams.scenarios.definition.scenario_file import find_scenario, read_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.scenario import run_scenario
from tests.helpers import STRUCTURES, Workshop, design_of
from tests.oracles.flat_series import flat_series
from tests.oracles.gevrey import taylor_coefficients_at
from tests.oracles.monolithic import Coupling, Real, largest_difference, simulate

pytestmark = pytest.mark.native

Write = Callable[[str, str], Path]
SAMPLE = 2e-4
TARGET = (-8e-3, 1e-3, 4e-3, -6e-3)
KIEL = design_of().structure.parameters()
MISMATCH = {
    name: value * {"stiffness": 1.10, "tip_mass": 0.95}[name.split(".")[1]]
    for name, value in KIEL.items()
    if name.endswith(("stiffness", "tip_mass"))
}
MISMATCH |= {
    f"patch[{k}].piezo_ratio": KIEL[f"patch[{k}].piezo_ratio"] * f for k, f in enumerate((0.92, 1.05, 0.95, 1.03), 1)
}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A shipped scenario with its times changed, and how the recursion is told the same."""

    stop: float
    times: dict[str, str]  # time in the shipped file to time here
    structure: str = "kiel"
    basis: str = "clamped_free"  # of the plant
    options: dict[str, Any] = field(default_factory=dict)


CASES = {
    "step_response": Case(stop=1.0, times={"1.0": "0.02"}, options={"step": (0.02, (817.0, -770.0, -807.0, 781.0))}),
    "feedforward": Case(
        stop=1.0, times={"1.0": "0.02"}, options={"use_controller": False, "targets": [(0.02, TARGET)]}
    ),
    "tracking": Case(stop=1.0, times={"1.0": "0.02"}, options={"targets": [(0.02, TARGET)]}),
    "disturbance_open_loop": Case(stop=1.0, times={"1.0": "0.02"}, options={"step": (0.0, (0.0,) * 4), "blow": 0.02}),
    "disturbance": Case(stop=1.0, times={"1.0": "0.02"}, options={"blow": 0.02}),
    "retarget": Case(
        stop=1.3,
        times={"1.0": "0.02", "1.5": "0.2", "2.0": "0.4", "4.0": "0.95"},
        options={
            "targets": [
                (0.02, TARGET),
                (0.2, (-4e-3, 2e-3, 6e-3, -3e-3)),
                (0.4, (3e-3, -1e-3, -2e-3, 4e-3)),
                (0.95, (0.0,) * 4),
            ]
        },
    ),
    "high_fidelity": Case(stop=1.0, times={"1.0": "0.02"}, basis="segment", options={"targets": [(0.02, TARGET)]}),
    "mismatch": Case(stop=1.0, times={"1.0": "0.02"}, options={"targets": [(0.02, TARGET)], "parameters": MISMATCH}),
    "single_beam": Case(
        stop=1.0, times={"1.0": "0.02"}, structure="single_beam", options={"targets": [(0.02, (-5e-3,))]}
    ),
    "five_beams": Case(
        stop=0.6,
        times={"1.0": "0.02"},
        structure="five_beams",
        options={"targets": [(0.02, (-5e-3, 1.7e-3, 2.4e-3, 0.8e-3, -0.5e-3, 7e-3))]},
    ),
}


def shortened(name: str) -> str:
    """The shipped file without its checks and figures, sooner, and with what an oracle can see recorded."""
    case, text = CASES[name], find_scenario(name).read_text(encoding="utf-8")
    text = text[: text.index("[[check]]")]
    text = re.sub(r"^open_loop = .*$", "", text, flags=re.M)
    text, count = re.subn(r"\btime = (\d+\.\d+),", lambda found: f"time = {case.times[found[1]]},", text)
    assert count == len(case.times)
    further = [
        f"{owner}.{variable}"
        for owner, variable in (("feedforward", "x_ref"), ("controller", "x_est"), ("plant", "energy"), ("plant", "w"))
        if f"[instance.{owner}]" in text and (variable != "w" or name == "tracking")
    ]
    return re.sub(r"^stop_time = .*$", f"stop_time = {case.stop}\nrecord = {further}", text, count=1, flags=re.M)


@cache
def recursion(name: str, coupling: Coupling, step: float = SAMPLE, **changed: Any) -> dict[str, Real]:
    """What the co-simulation must give, by array."""
    case = CASES[name]
    design = design_of(case.structure)
    steps = round(case.stop / step)
    time = step * np.arange(steps + 1)
    options = case.options | changed
    force = np.zeros((steps + 1, len(design.structure.beam)))
    if blow := options.pop("blow", 0.0):
        phase = (time - blow) / 5e-3
        inside = (time > blow - 1e-9) & (phase < 1)
        force[inside, 1] = (0.0358 * np.pi / (2 * 5e-3) * np.sin(np.pi * phase))[inside]
    if "step" in options:
        start, value = options.pop("step")
        options["voltage"] = np.outer(time > start - 1e-9, value)
    else:
        leader = read_scenario(find_scenario(name)).instance["feedforward"]
        options = {key: leader.start[key] for key in ("transition_time", "preview") if key in leader.start} | options
    return simulate(
        design,
        beam_model(design.structure, case.basis),
        steps=steps,
        step=step,  # type: ignore[arg-type]
        coupling=coupling,
        force=force,
        **options,
    )


def ran(path: Path, **settings: Any) -> Run:
    """A run that reached its end."""
    run = run_scenario(
        str(path), Settings(record_animation=False, **settings), designs=[design_of(n) for n in STRUCTURES]
    )
    assert run.recording.complete
    return run


def arrays(run: Run) -> dict[str, Real]:
    """The recording by array, (steps + 1, elements)."""
    names = dict.fromkeys(c.partition("[")[0] for c in run.recording.columns)
    return {
        name: run.recording.values[:, [k for k, c in enumerate(run.recording.columns) if c.partition("[")[0] == name]]
        for name in names
    }


def assert_is(run: Run, expected: dict[str, Real]) -> None:
    """Every signal of the run to 1e-10 of its array's largest value."""
    found = arrays(run)
    np.testing.assert_allclose(run.recording.time, expected["time"], rtol=1e-15)
    assert set(found) <= set(expected)
    for signal, values in found.items():
        assert largest_difference(values, expected[signal]) <= 1e-10, signal


# The loop in Python is slow, and its Gauss-Seidel coupling the same for all
RUNS = [
    (name, backend, coupling)
    for name in CASES
    for backend in ("python", "native")
    for coupling in ("jacobi", "gauss-seidel")
    if backend == "native" or coupling == "jacobi" or name in ("feedforward", "tracking", "retarget")
]


@pytest.mark.parametrize(("name", "backend", "coupling"), RUNS)
def test_is_the_recursion_of_the_closed_loop(
    at_run_folder: Path, write_scenario: Write, name: str, backend: str, coupling: Coupling
) -> None:
    run = ran(write_scenario(name, shortened(name)), backend=backend, coupling=coupling)
    assert_is(run, recursion(name, coupling))
    assert np.abs(arrays(run)["plant.y_pi"]).max() > 1e-4


@pytest.mark.parametrize(
    ("parts", "backend", "coupling"),
    [
        (0.5, "python", "jacobi"),
        (0.5, "native", "gauss-seidel"),
        (2, "python", "gauss-seidel"),
        (2, "native", "jacobi"),
        (5, "python", "jacobi"),
        (5, "python", "gauss-seidel"),
        (5, "native", "jacobi"),
        (5, "native", "gauss-seidel"),
    ],
)
def test_other_communication_steps(
    at_run_folder: Path, write_scenario: Write, parts: float, backend: str, coupling: Coupling
) -> None:
    """Half a sample time, two and five: the controller keeps its own clock."""
    step = parts * SAMPLE
    path = write_scenario("steps", f"step = {step}\n" + shortened("tracking"))
    run = ran(path, backend=backend, coupling=coupling)
    assert_is(run, recursion("tracking", coupling, step))


@pytest.mark.parametrize(
    ("values", "options"),
    [
        ({"controller.voltage_limit": 500.0}, {"controller_limit": 500.0}),
        ({"controller.feedback": False}, {"feedback": False}),
        ({"controller.integral_gain": 5e-4, "feedforward.preview": 1e-3}, {"integral_gain": 5e-4, "preview": 1e-3}),
        (
            {"feedforward.transition_time": 0.2, "feedforward.voltage_limit": 900.0},
            {"transition_time": 0.2, "voltage_limit": 900.0},
        ),
    ],
)
def test_parameters_of_feedforward_and_controller(
    at_run_folder: Path, write_scenario: Write, values: dict[str, Any], options: dict[str, Any]
) -> None:
    """The voltage limit holds some of the voltages: saturation and anti-windup are in the recursion too."""
    backend = "python" if "controller.voltage_limit" in values else "native"
    run = ran(write_scenario("tuned", shortened("tracking")), overrides=values, backend=backend)
    expected = recursion("tracking", "jacobi", **options)
    assert_is(run, expected)
    assert bool(expected["controller.saturated"].any()) == ("controller.voltage_limit" in values)


def test_order_of_the_instances_does_not_matter_to_jacobi(at_run_folder: Path, write_scenario: Write) -> None:
    """Initial values too pass along the whole chain when it stands in the file the other way round."""
    text = shortened("tracking").replace(
        "targets = [{", "targets = [{ time = 0.0, value = [-2e-3, 0.0, 1e-3, -1e-3] }, {"
    )
    blocks = re.findall(r"^\[instance\.[^\[]*", text, flags=re.M)
    start = text.index(blocks[0])
    reverse = text[:start] + "".join(reversed(blocks)) + text[start + sum(map(len, blocks)) :]
    forward, backward = (
        arrays(ran(write_scenario(name, t), backend="native")) for name, t in (("forward", text), ("backward", reverse))
    )
    assert np.abs(forward["controller.u"][0]).max() > 100.0
    for name in forward:
        np.testing.assert_array_equal(backward[name], forward[name])


def test_units_of_both_kernels_in_one_run(at_run_folder: Path, write_scenario: Write, workshop: Workshop) -> None:
    """A scenario that names FMU files: a Python plant with native units; relative to the scenario's folder."""
    path = write_scenario("mixed", "")
    shutil.copyfile(workshop.fmu("BeamPlant"), path.parent / "own plant.fmu")
    text = shortened("tracking").replace('unit = "BeamPlant"', 'fmu = "own plant.fmu"')
    assert_is(ran(write_scenario("mixed", text), backend="native"), recursion("tracking", "jacobi"))


def test_new_targets_make_no_jump(at_run_folder: Path, write_scenario: Write) -> None:
    """Between two samples u_ff changes by no more than its derivative allows, and that is continuous in between.

    The derivative is taken from the flat output's, one order higher than what the unit evaluates.
    """
    run = ran(write_scenario("retarget", shortened("retarget")), backend="native")
    u, time = arrays(run)["feedforward.u_ff"], run.recording.time
    expected = recursion("retarget", "jacobi")
    design = design_of()
    c, _ = flat_series(design.arrays["A"], design.arrays["B"])
    inverse = design.arrays["static_inverse"]
    m = len(c) - 1
    goals = np.array([np.zeros(4), *(inverse @ np.array(y) for _, y in CASES["retarget"].options["targets"])])
    fine = np.linspace(time[0], time[-1], 2 * (len(time) - 1) + 1) + SAMPLE  # ahead by the preview
    slope = np.zeros((len(fine), 4))
    for start, duration, change in zip(
        expected["feedforward.starts"], expected["feedforward.durations"], np.diff(goals, axis=0), strict=True
    ):
        series = taylor_coefficients_at(design.options.gevrey_order, (fine - start) / duration, m + 1)
        scales = np.cumprod(np.maximum(np.arange(m + 2), 1.0)) / duration ** np.arange(m + 2)
        slope += np.outer((series * scales)[:, 1:] @ c, change)
    steepest = np.abs(np.stack([slope[:-1:2], slope[1::2], slope[2::2]])).max(axis=0)
    largest = np.abs(slope).max()
    assert np.all(np.abs(np.diff(u, axis=0)) <= SAMPLE * (steepest + 1e-3 * largest))
    assert np.abs(np.diff(slope, axis=0)).max() < 0.01 * largest
