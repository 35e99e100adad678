"""The verb `tune`: figures of candidates against runs, the front, resuming, the page, and what is refused."""

import json
import os
import re
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.analysis import loop_of
from flexbeams.controller.closed_loop import closed_loop_poles, sampled_controller, sampled_plant
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.loop import Loop
from flexbeams.controller.margins import loop_margins
from flexbeams.controller.modal_loop import DisturbedPlant, ModalLoop
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.controller.static_error import random_parameters
from flexbeams.controller.tuning import Candidate, Requirements, TuningProblem, pareto_front
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.plant.validation import validate
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.report.tuning import round_ticks
from tests.browser import chromium, needs_browser
from tests.helpers import LOOP_WIRES, design_of, made_once
from tests.oracles.monolithic import simulate

SAMPLE = 2e-4
PLANTS = 200 if os.environ.get("FLEXBEAMS_ROBUSTNESS") == "full" else 20  # uncertain ones
QUICK = ["--evaluations", "100", "--plants", "2"]
# A blow on the single beam
BLOW = (
    """# a blow
title = "blow"
structure = "single_beam"
stop_time = 8.0
[instance.feedforward]
unit = "FlatnessFeedforward"
[instance.controller]
unit = "TrackingController"
[instance.plant]
unit = "BeamPlant"
"""
    + LOOP_WIRES
    + """[[input]]
to = "plant.force[1]"
pulse = { time = 0.1, duration = 5e-3, impulse = 0.01 }
"""
)


def blow(steps: int, beams: int) -> np.ndarray:
    """20 samples of 1 N on the last beam, from sample 5 on."""
    force = np.zeros((steps, beams))
    force[5:25, -1] = 1.0
    return force


@cache
def tuned() -> Design:
    """The design of disturbance_tuned."""
    file = load_scenario("disturbance_tuned")
    return compute_design(read_structure(find_structure("kiel")), file.scenario.design)


@cache
def searched() -> Path:
    """Results of a short search."""

    def make(folder: Path) -> None:
        (folder / "blow.toml").write_text(BLOW, encoding="utf-8")
        assert main(["tune", str(folder / "blow.toml"), "--out", str(folder), *QUICK]) == 0

    return made_once("tuning", make)


def test_modal_figures_are_those_of_the_loop() -> None:
    """Response against the recursion, noise and poles against the matrix, disk margin a little below the exact one."""
    made = design_of("single_beam")
    controller = sampled_controller(made.arrays, made.integral_gain)
    disturbed = DisturbedPlant.of(made.model(), SAMPLE)
    modal, loop = ModalLoop(disturbed, controller), Loop(controller, disturbed.plant)
    force = blow(6001, 1)
    run = simulate(made, made.model(), steps=6000, force=force, controller_limit=1e9)
    response = modal.response(force, 1.2)
    rows = np.rint(response.time / SAMPLE).astype(int)
    np.testing.assert_allclose(response.y, run["plant.y_pi"][rows], atol=1e-7 * np.abs(run["plant.y_pi"]).max())
    np.testing.assert_allclose(response.u, run["controller.u"][rows], atol=1e-6 * np.abs(run["controller.u"]).max())
    assert rows[-1] > 5980
    assert modal.growth == pytest.approx(loop.poles()[0].real, rel=1e-9)
    np.testing.assert_allclose(modal.noise_gain(), loop.noise_gain(), rtol=1e-8)
    exact = loop_margins(loop).disk.alpha
    assert exact == pytest.approx(modal.disk_margin(), rel=0.01)


def test_front_is_what_no_other_candidate_beats() -> None:
    random = np.random.default_rng(4)
    candidates = [
        Candidate(
            weights={},
            decay=d,
            worst_decay=d,
            noise_voltage=n,
            peak_voltage=1.0,
            disk_margin=1.0,
            violation=float(v > 0.7),
        )
        for d, n, v in random.uniform(size=(60, 3))
    ]
    front = pareto_front(candidates)
    allowed = [c for c in candidates if c.feasible]
    expected = [
        c
        for c in allowed
        if not any(
            o.worst_decay <= c.worst_decay and o.noise_voltage <= c.noise_voltage and o is not c for o in allowed
        )
    ]
    assert front == sorted(expected, key=lambda c: c.noise_voltage)


def test_requirements_count_as_violations() -> None:
    made = design_of("single_beam")
    problem = [
        TuningProblem(made, made.model(), {}, blow(100, 1), 2.0, Requirements(plants=1, **limits))
        for limits in ({}, {"disk_margin": 1.5}, {"voltage_limit": 0.1})
    ]
    nominal, narrow, weak = (p.evaluate(Weights()) for p in problem)
    assert nominal.feasible
    assert narrow.violation == pytest.approx(1.5 - narrow.disk_margin)
    assert weak.violation == pytest.approx(np.log(weak.peak_voltage / 0.1))
    assert nominal.worst_decay >= nominal.decay
    unstable = problem[0].evaluate(replace(Weights(), kalman_q_velocity=1e12, lqr_q_velocity=1e9))
    assert unstable.violation >= 10


def test_decades_of_a_design_are_those_of_its_effective_weights() -> None:
    made = design_of("single_beam")
    problem = TuningProblem(made, made.model(), {}, blow(100, 1), 2.0, Requirements(plants=1))
    assert problem.decades() == [0.0] * 4
    other = Weights(kalman_measurement=2.0, lqr_q_total=20.0, lqr_q_velocity=1e-2)
    problem.design = replace(made, options=replace(made.options, weights=other))
    assert problem.decades() == pytest.approx([1.0, 1.0, -1.0, 0.0])
    chosen = problem.weights(problem.decades())
    assert problem.evaluate(chosen).figures()["decay"] == pytest.approx(problem.evaluate(other).decay, rel=1e-9)


@pytest.mark.slow
def test_search_writes_a_design_section_and_a_page(tmp_path: Path) -> None:
    """The section is one of a scenario; all candidates are in the log, on the front only verified ones."""
    folder = searched()
    options = validate(DesignOptions, tomllib.loads((folder / "design.toml").read_text())["design"], "design.toml")
    assert options.weights != Weights()
    compute_design(read_structure(find_structure("single_beam")), options)
    lines = (folder / "candidates.jsonl").read_text().splitlines()
    assert 150 < len(lines) <= 1 + 192  # two generations of 32 for each of three prices; equal weights stand once
    page = (folder / "tune.html").read_text(encoding="utf-8")
    assert "<h1>Tuning: blow</h1>" in page
    assert page.count('role="button"') == page.count('<button type="button" class="small" data-point')
    assert not re.search(r'(src|href)="(?!#|data:)', page)


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [
        (0.01, 20.0, "0.01 0.02 0.05 0.1 0.2 0.5 1 2 5 10 20"),
        (1.2 / 1.15, 1.2 * 1.15, "1.1 1.2 1.3"),  # of candidates that are all alike
        (0.108, 0.143, "0.11 0.12 0.13 0.14"),
        (0.3, 0.45, "0.3 0.35 0.4 0.45"),
    ],
)
def test_an_axis_of_the_front_has_labels(low: float, high: float, ticks: str) -> None:
    assert " ".join(f"{v:g}" for v in round_ticks(low, high)) == ticks


@pytest.mark.slow
def test_an_interrupted_search_goes_on_from_its_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Half of the log, its last line cut off: the same results; another search's log is refused."""
    lines = (searched() / "candidates.jsonl").read_text().splitlines()
    (tmp_path / "candidates.jsonl").write_text("\n".join(lines[:50]) + "\n" + lines[50][:20] + "\n")
    command = ["tune", str(searched() / "blow.toml"), "--out", str(tmp_path), *QUICK]
    assert main(command) == 0
    assert (tmp_path / "design.toml").read_bytes() == (searched() / "design.toml").read_bytes()
    keys = [json.loads(line)["key"] for line in (tmp_path / "candidates.jsonl").read_text().splitlines()[51:]]
    assert keys == [json.loads(line)["key"] for line in lines[50:]]
    capsys.readouterr()
    assert main([*command, "--seed", "2"]) == 2
    assert "candidates.jsonl: belongs to another search" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tracking"], "input must have a force on plant to tune for"),
        (["step_response"], "input must have a force on plant to tune for"),
        (["disturbance", "--disk-margin", "0"], "'--disk-margin'"),
        (["disturbanc"], "did you mean 'disturbance'?"),
    ],
)
def test_tune_refuses(arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", *arguments, "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.browser
@needs_browser
def test_every_point_is_one_click_from_its_response() -> None:
    file = searched() / "tune.html"
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 390, "height": 800})
        complaints: list[str] = []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(file.as_uri())
        count = page.evaluate("data.responses.length")
        for k in range(count):
            page.locator(f"#picture [data-point='{k}']").dispatch_event("click")
            name = "Published weights" if k == 0 else f"Point {k}"
            assert page.locator("#response-title").text_content() == f"Response: {name}"
            assert page.locator("#responses canvas").count() == 2
            assert page.locator("#toml").is_visible() == (k > 0)
        page.locator("#picture [data-point='1']").focus()
        page.keyboard.press("Enter")
        assert page.locator("#response-title").text_content() == "Response: Point 1"
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert not complaints


def test_disturbance_tuned_is_stable_on_uncertain_plants_with_delay_and_little_noise() -> None:
    """All parameters +-10 %; two samples more of delay on both plants; 0.3 V at 2e-7."""
    made = tuned()
    controller = sampled_controller(made.arrays, made.integral_gain)
    model, values = made.model(), made.structure.parameters()
    for parameters in random_parameters(values, dict.fromkeys(values, 0.1), PLANTS, seed=11):
        assert closed_loop_poles(controller, sampled_plant(model, SAMPLE, parameters))[0].real < -0.1
    for basis in ("clamped_free", "segment"):
        plant = sampled_plant(made.model(basis), SAMPLE)  # type: ignore[arg-type]
        assert closed_loop_poles(controller, plant, extra_delay=2)[0].real < -0.1
        assert 2e-7 * loop_of(made, plant).noise_gain().max() < 0.3
        assert loop_margins(loop_of(made, plant)).disk.alpha >= 0.8
