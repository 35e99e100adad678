"""The analysis of a design: static errors, the ranking of pairs and gauges, Bode curves, figures in JSON's types."""

import json
from functools import cache

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from flexbeams.controller.analysis import Analysis, analyse
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.ranking import _losses
from flexbeams.controller.static_error import StaticLoop, random_parameters, static_errors
from flexbeams.plant.basis import Array
from flexbeams.plant.statespace import state_matrices, static_gains
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import design_of
from tests.oracles.monolithic import simulate

TARGET = np.array([[-8e-3, 1e-3, 4e-3, -6e-3]])


@cache
def analysis() -> Analysis:
    return analyse(design_of(), TARGET)


@cache
def offset_free(static_maps: str = "basis") -> Design:
    options = DesignOptions(observer="offset_free", static_maps=static_maps, verify="design")
    return compute_design(read_structure(find_structure("kiel")), options)


@pytest.mark.parametrize("static_maps", ["basis", "segment"])
def test_static_errors_over_200_plants(static_maps: str) -> None:
    """All 37 values +-10 %: median and 95 % of the loop and of the feedforward alone; better in nine of ten."""
    errors = static_errors(offset_free(static_maps), targets=TARGET)
    assert len(errors.loop) == 200
    assert np.median(errors.loop) < 0.36e-3
    assert np.quantile(errors.loop, 0.95) < 0.9e-3
    assert 0.9e-3 < np.median(errors.feedforward) < 1.1e-3
    assert 1.7e-3 < np.quantile(errors.feedforward, 0.95) < 2.1e-3
    assert np.mean(errors.loop < errors.feedforward) >= 0.9


def test_published_observer_does_not_help_at_rest() -> None:
    """0.98 mm in the median, and worse than the feedforward alone in 92 of 200."""
    errors = analysis().static_errors
    assert np.median(errors.loop) == pytest.approx(0.98e-3, rel=0.03)
    assert np.count_nonzero(errors.loop > errors.feedforward) == pytest.approx(92, abs=10)


def test_loop_at_rest_of_the_offset_free_observer_in_closed_form() -> None:
    """u = (G + W (H' - H))^-1 y*."""
    made = offset_free()
    model, W = made.model(), made.arrays["offset_map"]
    G, H = static_gains(model, model.assemble())
    for parameters in random_parameters(
        made.structure.parameters(), dict.fromkeys(made.structure.parameters(), 0.1), 3, seed=8
    ):
        _, other = static_gains(model, model.assemble(parameters))
        expected = np.linalg.solve(G + W @ (other - H), TARGET[0])
        feedforward = TARGET @ made.arrays["static_inverse"].T
        np.testing.assert_allclose(StaticLoop.of(made).voltages(other, feedforward)[0], expected, rtol=1e-7)


def test_loop_at_rest_of_the_published_observer_is_where_a_run_ends() -> None:
    """The plant of the scenario mismatch, with four times the integral action, after 4 s."""
    made = compute_design(read_structure(find_structure("kiel")), DesignOptions(integral_gain=4e-4))
    model = made.model()
    values = made.structure.parameters()
    factors = {"spring[": 1.1, "tip_mass": 0.95}
    parameters = {name: v * f for name, v in values.items() for key, f in factors.items() if key in name}
    for k, factor in enumerate((0.92, 1.05, 0.95, 1.03), 1):
        parameters[f"patch[{k}].piezo_ratio"] = factor * values[f"patch[{k}].piezo_ratio"]
    G, H = static_gains(model, model.assemble(parameters))
    u = StaticLoop.of(made).voltages(H, TARGET @ made.arrays["static_inverse"].T)[0]
    run = simulate(made, model, steps=20000, targets=[(0.01, TARGET[0])], parameters=parameters)
    assert np.max(np.abs(G @ u - TARGET[0])) > 1.3e-3
    np.testing.assert_allclose(run["plant.y_pi"][-1], G @ u, rtol=0, atol=1e-6)


def test_bode_curves_against_the_second_order_matrices() -> None:
    made, bode = design_of(), analysis().bode
    for name, model in {"design": made.model(), "exact": made.model("segment")}.items():
        system, k = model.assemble(), 130
        s = 1j * bode.omega[k]
        q = np.linalg.solve(system.M * s**2 + system.D * s + system.K, system.L)
        np.testing.assert_allclose(bode.deflection[name][k], model.deflection @ q, rtol=1e-6)
        np.testing.assert_allclose(bode.strain[name][k], model.strain @ q, rtol=1e-6)
    assert bode.omega[0] < 14 < 2500 < bode.omega[-1]
    first = bode.deflection["reduced"][0], bode.deflection["design"][0]
    np.testing.assert_allclose(np.abs(first[0]), np.abs(first[1]), rtol=0.02)


def test_ranking_is_that_of_the_resonances() -> None:
    """Shares of the first modes against peaks of a hardly damped plant; a pair alone is all there is."""
    ranking, made = analysis().ranking, design_of()
    model = made.model()
    damping = {name: 0.01 * v for name, v in made.structure.parameters().items() if name.endswith("damping")}
    A, B = state_matrices(model.assemble(damping))
    strain = np.hstack([model.strain, np.zeros_like(model.strain)])
    for mode in range(3):
        peak = np.abs(strain @ np.linalg.solve(1j * ranking.frequencies[mode] * np.eye(len(A)) - A, B))
        gauge, pair = np.unravel_index(np.argmax(peak), peak.shape)
        np.testing.assert_allclose(ranking.pairs[mode], peak[gauge] / peak[gauge].max(), atol=0.01)
        np.testing.assert_allclose(ranking.gauges[mode], peak[:, pair] / peak[:, pair].max(), atol=0.01)
    assert ranking.pairs.shape == (15, 4)
    assert ranking.gauges.shape == (15, 6)
    single = analyse(design_of("single_beam")).ranking
    assert single.pair_losses == pytest.approx([1.0])
    assert np.all((ranking.gauge_losses > 0) & (ranking.gauge_losses < 1))


@pytest.mark.parametrize("distinct", [True, False])
def test_losses_are_those_of_the_hankel_singular_values(distinct: bool) -> None:
    """Roots of the eigenvalues of both Gramians' product, without each input; also where A has no eigenvectors."""
    random = np.random.default_rng(8)
    A = np.eye(5, k=1) - np.diag([1.0, 2.0, 3.0, 4.0, 5.0] if distinct else [2.0] * 5)
    B, C = random.normal(size=(5, 3)), random.normal(size=(2, 5))
    A[0, 3] = -4.0 if distinct else 0.0

    def total(inputs: Array) -> float:
        reach, sight = solve_continuous_lyapunov(A, -inputs @ inputs.T), solve_continuous_lyapunov(A.T, -C.T @ C)
        return float(np.sum(np.sqrt(np.maximum(np.linalg.eigvals(reach @ sight).real, 0))))

    expected = [1 - total(np.delete(B, k, axis=1)) / total(B) for k in range(3)]
    np.testing.assert_allclose(_losses(A, B, C), expected, rtol=1e-7)


def test_figures_are_json_and_name_units() -> None:
    figures = json.loads(json.dumps(analysis().figures(), allow_nan=False))
    assert figures["loops"]["design"]["margins"]["disk"]["alpha"] == pytest.approx(1.155, abs=1e-3)
    assert figures["loops"]["exact"]["margins"]["channels"][0]["delay"] is None
    assert figures["static_error"]["targets"] == TARGET.tolist()
    assert len(figures["loops"]["exact"]["sensitivity"]) == len(figures["loops"]["exact"]["frequency"])
    keys = {"poles", "noise_gain", "frequency", "sensitivity", "control_sensitivity", "static_gain_pm"}
    assert keys <= figures["units"].keys()
    assert {"frequencies", "closed_loop", "static_gain_pi"} <= figures["units"].keys() & design_of().summary.keys()
