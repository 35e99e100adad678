"""Co-simulation of the shipped scenarios, shortened, against the closed loop as one recursion."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plant.galerkin import beam_model
from scenarios.run import Run, run_scenario
from scenarios.schema import find_scenario
from scenarios.settings import Settings
from tests.conftest import design_of
from tests.oracles.monolithic import Coupling, Real, largest_difference, simulate

SAMPLE = 2e-4
TARGET = (-8e-3, 1e-3, 4e-3, -6e-3)
KIEL = design_of().structure.parameters()
MISMATCH = {name: value * {"stiffness": 1.10, "tip_mass": 0.95}[name.split(".")[1]] for name, value in KIEL.items()
            if name.endswith(("stiffness", "tip_mass"))}
MISMATCH |= {f"patch[{k}].piezo_ratio": KIEL[f"patch[{k}].piezo_ratio"] * f
             for k, f in enumerate((0.92, 1.05, 0.95, 1.03), 1)}


@dataclass(frozen=True, kw_only=True)
class Case:
    """A shipped scenario with its times changed, and how the recursion is told the same."""

    stop: float
    times: dict[str, str]                 # time in the shipped file to time here
    structure: str = "kiel"
    basis: str = "clamped_free"           # of the plant
    options: dict[str, Any] = field(default_factory=dict)


LOOP = {"transition_time": 0.9, "preview": SAMPLE}
CASES = {
    "step_response": Case(stop=1.5, times={"1.0": "0.1"}, options={"step": (0.1, (817.0, -770.0, -807.0, 781.0))}),
    "feedforward": Case(stop=1.5, times={"1.0": "0.1"},
                        options={"transition_time": 0.9, "use_controller": False, "targets": [(0.1, TARGET)]}),
    "tracking": Case(stop=1.5, times={"1.0": "0.1"}, options={**LOOP, "targets": [(0.1, TARGET)]}),
    "disturbance_open_loop": Case(stop=1.5, times={"1.0": "0.1"}, options={"step": (0.0, (0.0,) * 4), "blow": 0.1}),
    "disturbance": Case(stop=1.5, times={"1.0": "0.1"}, options={**LOOP, "blow": 0.1}),
    "retarget": Case(stop=2.4, times={"1.0": "0.1", "1.5": "0.4", "2.0": "0.7", "4.0": "1.5"}, options={
        **LOOP, "targets": [(0.1, TARGET), (0.4, (-4e-3, 2e-3, 6e-3, -3e-3)), (0.7, (3e-3, -1e-3, -2e-3, 4e-3)),
                            (1.5, (0.0,) * 4)]}),
    "high_fidelity": Case(stop=1.5, times={"1.0": "0.1"}, basis="segment",
                          options={**LOOP, "targets": [(0.1, TARGET)]}),
    "mismatch": Case(stop=1.5, times={"1.0": "0.1"},
                     options={**LOOP, "targets": [(0.1, TARGET)], "parameters": MISMATCH}),
    "single_beam": Case(stop=1.5, times={"1.0": "0.1"}, structure="single_beam",
                        options={**LOOP, "targets": [(0.1, (-5e-3,))]}),
    "five_beams": Case(stop=1.5, times={"1.0": "0.1"}, structure="five_beams", options={
        "transition_time": 1.3, "preview": SAMPLE, "targets": [(0.1, (-5e-3, 1.7e-3, 2.4e-3, 0.8e-3, -0.5e-3, 7e-3))]}),
}


def shortened(name: str) -> str:
    """The shipped file without its checks and figures, sooner, and with what an oracle can see recorded."""
    case, text = CASES[name], find_scenario(name).read_text(encoding="utf-8")
    text = text[:text.index("[[check]]")]
    text = re.sub(r"^open_loop = .*$", "", text, flags=re.M)
    text, count = re.subn(r"\btime = (\d+\.\d+),", lambda found: f"time = {case.times[found[1]]},", text)
    assert count == len(case.times)
    further = [f"{owner}.{variable}" for owner, variable in (
        ("feedforward", "x_ref"), ("controller", "x_est"), ("plant", "w"), ("plant", "energy"))
        if f"[instance.{owner}]" in text]
    return re.sub(r"^stop_time = .*$", f"stop_time = {case.stop}\nrecord = {further}", text, count=1, flags=re.M)


@cache
def recursion(name: str, coupling: Coupling) -> dict[str, Real]:
    """What the co-simulation must give, by array."""
    case = CASES[name]
    design = design_of(case.structure)
    steps = round(case.stop / SAMPLE)
    time = SAMPLE * np.arange(steps + 1)
    options = dict(case.options)
    force = np.zeros((steps + 1, len(design.structure.beam)))
    if blow := options.pop("blow", 0.0):
        phase = (time - blow) / 5e-3
        inside = (time > blow - 1e-9) & (phase < 1)
        force[inside, 1] = (0.0358 * np.pi / (2 * 5e-3) * np.sin(np.pi * phase))[inside]
    if "step" in options:
        start, value = options.pop("step")
        options["voltage"] = np.outer(time > start - 1e-9, value)
    return simulate(design, beam_model(design.structure, case.basis), steps=steps, coupling=coupling,  # type: ignore[arg-type]
                    force=force, **options)


def ran(path: Path, **settings: Any) -> Run:
    """A run that reached its end."""
    run = run_scenario(str(path), Settings(frames=False, **settings))
    assert run.recording.complete
    return run


def arrays(run: Run) -> dict[str, Real]:
    """The recording by array, (steps + 1, elements)."""
    names = dict.fromkeys(c.partition("[")[0] for c in run.recording.columns)
    return {name: run.recording.values[:, [k for k, c in enumerate(run.recording.columns)
                                           if c.partition("[")[0] == name]] for name in names}


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("backend", ["python", "native"])
@pytest.mark.parametrize("name", CASES)
def test_is_the_recursion_of_the_closed_loop(at_run_folder: Path, write_scenario: Callable[[str, str], Path],
                                             name: str, backend: str, coupling: Coupling) -> None:
    """Every signal of every instance to 1e-10 of its array's largest value."""
    run = ran(write_scenario(name, shortened(name)), backend=backend, coupling=coupling)
    found, expected = arrays(run), recursion(name, coupling)
    np.testing.assert_allclose(run.recording.time, expected["time"], rtol=1e-15)
    assert set(found) <= set(expected)
    for signal, values in found.items():
        assert largest_difference(values, expected[signal]) <= 1e-10, signal
    assert np.abs(found["plant.y_pi"]).max() > 1e-3
    if name == "disturbance":
        assert np.abs(found["controller.u"]).max() > 10
