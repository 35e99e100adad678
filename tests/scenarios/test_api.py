"""The public names of `flexbeams`."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

import flexbeams as fb
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.processes.children import python_command, python_environment
from flexbeams.scenarios.runs.scenario import run_scenario

HEAVY = ("numpy", "scipy", "click", "pydantic", "fmpy", "importlib.metadata")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = f"import sys, flexbeams; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run(
        python_command("-c", code), capture_output=True, text=True, check=True, env=python_environment()
    )
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there() -> None:
    assert set(fb.__all__) <= set(dir(fb))
    for name in fb.__all__:
        assert getattr(fb, name)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        fb.nothing  # noqa: B018


@pytest.mark.slow
def test_run_is_that_of_the_scenario(at_run_folder: Path) -> None:
    run = fb.run("step_response", start={"plant.beam[1].tip_mass": 0.03}, stop_time=1.1, decimate=10)
    settings = Settings(overrides={"plant.beam[1].tip_mass": 0.03}, stop_time=1.1, decimate=10)
    expected = run_scenario("step_response", settings).recording
    np.testing.assert_array_equal(run.recording.values, expected.values)
    assert run.recording.columns == expected.columns


def test_design_of_names_and_structures() -> None:
    by_name = fb.design("single_beam", reduced_modes=4)
    assert by_name.summary["reduced_order"] == 8
    assert fb.design(fb.structure("single_beam"), reduced_modes=4).design_id == by_name.design_id


def test_linear_models_of_a_design() -> None:
    """Plant, reduced model and controller with their signals, in python-control, scipy and pyMOR."""
    design = fb.design("single_beam", reduced_modes=4)
    plant = design.plant(basis="segment", start={"beam[].tip_mass": 0.03})
    assert plant.inputs == ("u[1]", "force[1]")
    assert plant.outputs == ("y_pi[1]", "y_pm[1]", "y_pm[2]")
    assert design.model.A.shape == (8, 8)
    assert design.feedback_gain.shape == (1, 8)
    assert design.estimator_gain.shape == (8, 2)
    s = 12j
    for model, point in ((plant, s), (design.model, s), (design.controller, np.exp(s * 2e-4))):
        expected = model.C @ np.linalg.solve(point * np.eye(len(model.A)) - model.A, model.B) + model.D
        exported = model.to_control()
        assert (exported.name, exported.input_labels, exported.output_labels) == (
            model.name,
            list(model.inputs),
            list(model.outputs),
        )
        np.testing.assert_allclose(exported(point), expected, rtol=1e-6)
        np.testing.assert_allclose(model.to_pymor().transfer_function.eval_tf(point), expected, rtol=1e-6)
        assert model.to_scipy().A.shape == model.A.shape
    assert plant.to_control(2e-4).dt == plant.to_scipy(2e-4).dt == design.controller.to_control().dt == 2e-4
    heavier = np.linalg.eigvals(plant.A), np.linalg.eigvals(design.plant(basis="segment").A)
    assert np.abs(heavier[0]).min() < np.abs(heavier[1]).min()
    with pytest.raises(fb.FlexbeamsError, match=r"dt must be the sample time of the controller, 0\.0002 s, got 0\.001"):
        design.controller.to_control(1e-3)
    with pytest.raises(fb.FlexbeamsError, match=r"start\.beam\[1\]\.mass is not a parameter"):
        design.plant(start={"beam[1].mass": 1.0})


def test_page_of_a_design() -> None:
    design = fb.design("single_beam", reduced_modes=4)
    assert repr(design) == f"design {design.design_id}: 1 beam, 20 states, reduced to 8"
    page = design._repr_html_()
    assert page.count("<iframe srcdoc=") == 1
    assert design.design_id[:12] in page
    assert "src=&quot;http" not in page


def test_weights_give_the_gains() -> None:
    """Also at another sample time, by scipy's Riccati solver."""
    for sample_time in (2e-4, 5e-4):
        design = fb.design("single_beam", sample_time=sample_time)
        model, w = design.model.sampled(sample_time), design.weights
        H_pm = model.C[1:]
        S = scipy.linalg.solve_discrete_are(model.A, model.B, w.Q_c, w.R_c)
        K = np.linalg.solve(model.B.T @ S @ model.B + w.R_c, model.B.T @ S @ model.A)
        P = scipy.linalg.solve_discrete_are(model.A.T, H_pm.T, w.Q_o, w.R_o)
        L = model.A @ P @ H_pm.T @ np.linalg.inv(H_pm @ P @ H_pm.T + w.R_o)
        np.testing.assert_allclose(K, design.feedback_gain, rtol=0, atol=1e-9 * np.abs(K).max())
        np.testing.assert_allclose(L, design.estimator_gain, rtol=0, atol=1e-9 * np.abs(L).max())


def test_margins_of_a_design_on_another_plant() -> None:
    design = fb.design("single_beam")
    loop = design.loop(design.plant(basis="segment"))
    assert loop.margins().disk.alpha == pytest.approx(1.008, abs=1e-3)
    assert design.loop().margins().disk.alpha == pytest.approx(0.935, abs=1e-3)
    assert loop.poles()[0].real < 0
    assert loop.noise_gain().shape == (1,)
    assert loop.sensitivity(np.array([1.0, 10.0])).S.shape == (2, 1, 1)
    assert design.analysis().loops["exact"].margins == loop.margins()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fb.run("trackin"), "'trackin' is neither a file nor a shipped scenario; did you mean 'tracking'?"),
        (lambda: fb.run("tracking", stop_time=-1.0), "--stop-time must be finite and > 0, got -1.0"),
        (lambda: fb.run("tracking", decimate=0), "decimate must be an integer >= 1, got 0"),
        (lambda: fb.structure("kil"), "'kil' is neither a file nor a shipped structure; did you mean 'kiel'?"),
        (lambda: fb.design(reduced_mode=4), "design: reduced_mode is not a known key; did you mean 'reduced_modes'?"),
        (lambda: fb.export("tracking", format="sspp"), "format must be one of ssp, "),  # type: ignore[arg-type]
        (lambda: fb.export("tracking", "a.fmu", parts=("plant",), format="ssp"), "--parts belongs to --format closed"),
        (lambda: fb.compare("results"), "RUN must be at least two folders of results, or files, got 1"),
    ],
)
def test_mistakes(call: object, message: str) -> None:
    with pytest.raises(fb.FlexbeamsError) as caught:
        call()  # type: ignore[operator]
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_build_refuses_an_unknown_unit() -> None:
    with pytest.raises(fb.FlexbeamsError, match="UNIT is not a unit; did you mean 'BeamPlant'"):
        fb.build(fb.design("single_beam"), ["BeamPlan"])
