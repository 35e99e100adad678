"""BeamPlant against the exact solution of M q'' + D q' + K q = L u + F force, set up here on its own."""

import re
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve, expm

from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import STRUCTURES, BuiltUnits, design_of
from tests.units.loaded import Loaded, Real, loaded

SAMPLE = 2e-4
PARAMETERS = list(design_of().structure.parameters())
MAY_VANISH = ("tip_mass", "viscous_damping", "structural_damping", "stiffness")


class Motion:
    """The model's motion in the coordinates (q, q'), for inputs held over each step; at rest under u at first."""

    def __init__(self, model: BeamModel, u: Real | float = 0.0, parameters: dict[str, float] | None = None) -> None:
        system = model.assemble(parameters)
        self.M, self.K, self.n, self.model = system.M, system.K, model.size, model
        mass = cho_factor(system.M, lower=True)
        below = -cho_solve(mass, np.hstack([system.K, system.D]))
        self.A = np.vstack([np.hstack([np.zeros_like(self.M), np.eye(self.n)]), below])
        inputs = np.hstack([system.L, system.F])
        self.B = np.vstack([np.zeros_like(inputs), cho_solve(mass, inputs)])
        self.x = np.zeros(2 * self.n)
        self.x[: self.n] = cho_solve(cho_factor(system.K, lower=True), system.L @ np.broadcast_to(u, system.L.shape[1]))
        self._transition = cache(self._held)

    def _held(self, step: float) -> Real:
        size = sum(self.B.shape)
        block = np.zeros((size, size))
        block[: 2 * self.n] = np.hstack([self.A, self.B])
        return np.asarray(expm(block * step))[: 2 * self.n]

    def advance(self, step: float, inputs: Real) -> None:
        self.x = self._transition(step) @ np.concatenate([self.x, inputs])

    @property
    def energy(self) -> float:
        q, v = self.x[: self.n], self.x[self.n :]
        return float(v @ self.M @ v + q @ self.K @ q) / 2

    def values(self) -> Real:
        """y_pi, y_pm, w and energy."""
        q = self.x[: self.n]
        return np.concatenate(
            [self.model.deflection @ q, self.model.strain @ q, (self.model.stations @ q).ravel(), [self.energy]]
        )


def inputs_of(model: BeamModel, steps: int) -> Real:
    """Voltages and tip forces, (steps, n_u + r): each held for 5 steps."""
    n_u, r = len(model.structure.patch), len(model.structure.beam)
    held = np.random.default_rng(5).normal(0, 1, (-(-steps // 5), n_u + r)) * np.repeat([600.0, 0.05], [n_u, r])
    return np.repeat(held, 5, axis=0)[:steps]


def run(plant: Loaded, inputs: Real, step: float = SAMPLE, parts: int = 1) -> Real:
    """y_pi, y_pm, w and energy after each step, each step made in equal parts."""
    n_u = len(plant.take("u"))
    trace = []
    for row in inputs:
        plant.put("u", row[:n_u])
        plant.put("force", row[n_u:])
        for _ in range(parts):
            plant.advance(step / parts)
        trace.append(plant.take("y_pi", "y_pm", "w", "energy"))
    return np.array(trace)


def expected(motion: Motion, inputs: Real, step: float = SAMPLE) -> Real:
    trace = []
    for row in inputs:
        motion.advance(step, row)
        trace.append(motion.values())
    return np.array(trace)


def assert_close(found: Real, wanted: Real, model: BeamModel, tolerance: float) -> None:
    """Each of y_pi, y_pm, w and energy to `tolerance` of its largest magnitude."""
    r, stations, _ = model.stations.shape
    for start, stop in pairwise(np.cumsum([0, len(model.deflection), len(model.strain), r * stations, 1])):
        scale = np.abs(wanted[:, start:stop]).max()
        assert scale > 0
        assert np.abs(found[:, start:stop] - wanted[:, start:stop]).max() <= tolerance * scale


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize(("basis", "tolerance"), [("clamped_free", 1e-10), ("segment", 1e-8)])
def test_motion_is_exact(units: BuiltUnits, structure: str, basis: str, tolerance: float) -> None:
    """The unit's energy coordinates against (q, q'); those lose digits themselves for the stiff basis."""
    model = design_of(structure, basis).model()
    inputs = inputs_of(model, 300)
    with loaded(units("BeamPlant", structure, basis)) as plant:
        found = run(plant.begin(), inputs)
    assert_close(found, expected(Motion(model), inputs), model, tolerance)


@pytest.mark.parametrize("step", [1e-5, 3e-3, 0.25])
def test_motion_is_exact_for_any_step(units: BuiltUnits, step: float) -> None:
    model = design_of().model()
    inputs = inputs_of(model, 60)
    with loaded(units("BeamPlant")) as plant:
        found = run(plant.begin(), inputs, step)
    assert_close(found, expected(Motion(model), inputs, step), model, 1e-10)


@pytest.mark.parametrize(
    ("basis", "steps", "tolerance"), [("clamped_free", 400, 1e-12), ("segment", 5, 1e-12), ("segment", 400, 2e-11)]
)
def test_splitting_a_step_changes_nothing(units: BuiltUnits, basis: str, steps: int, tolerance: float) -> None:
    """Rounding of the stiff basis's matrix exponential shifts phases by 1e-14 a step, which adds up."""
    model = design_of("kiel", basis).model()
    inputs = inputs_of(model, steps)
    traces = {}
    for parts in (1, 2, 5, 7):
        with loaded(units("BeamPlant", "kiel", basis)) as plant:
            traces[parts] = run(plant.begin(), inputs, 1e-3, parts)
    for parts in (2, 5, 7):
        assert_close(traces[parts], traces[1], model, tolerance)


def test_steps_of_many_lengths(units: BuiltUnits) -> None:
    """More different steps than the unit keeps matrices for."""
    model = design_of().model()
    with loaded(units("BeamPlant")) as plant:
        plant.begin(u=[500.0, -300.0, 200.0, 100.0])
        motion = Motion(model)
        for k in range(150):
            step = 1e-4 * (1 + k % 71)
            plant.advance(step)
            motion.advance(step, np.array([500.0, -300.0, 200.0, 100.0, 0.0, 0.0, 0.0]))
        found = plant.take("y_pi", "y_pm", "w", "energy")
    assert_close(found[None], motion.values()[None], model, 1e-10)


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_acts_as_the_model_says(units: BuiltUnits, name: str) -> None:
    structure = design_of().structure
    value = structure.parameters()[name] * 1.3
    model = beam_model(structure.with_parameters({name: value}))
    inputs = inputs_of(model, 40)
    rest = [300.0, -200.0, 100.0, 50.0]
    with loaded(units("BeamPlant")) as plant:
        found = run(plant.begin(**{name: value, "start_at_rest_under": rest}), inputs, 2e-3)
        plant.call("reset")
        before = run(plant.begin(start_at_rest_under=rest), inputs, 2e-3)
    assert_close(found, expected(Motion(model, np.array(rest)), inputs, 2e-3), model, 1e-10)
    assert np.abs(found - before).max() > 1e-6 * np.abs(before).max()


def test_all_parameters_at_once(units: BuiltUnits) -> None:
    structure = design_of().structure
    factors = np.random.default_rng(11).uniform(0.7, 1.4, len(PARAMETERS))
    values = {n: v * f for (n, v), f in zip(structure.parameters().items(), factors, strict=True)}
    model = beam_model(structure.with_parameters(values))
    inputs = inputs_of(model, 100)
    with loaded(units("BeamPlant")) as plant:
        found = run(plant.begin(**values), inputs, 1e-3)
    assert_close(found, expected(Motion(model), inputs, 1e-3), model, 1e-10)


@pytest.mark.parametrize("name", PARAMETERS)
def test_impossible_parameters_are_refused_by_name(units: BuiltUnits, name: str) -> None:
    with loaded(units("BeamPlant")) as plant:
        plant.prepare()
        with pytest.raises(UnitFailure) as failure:
            plant.put(name, -1e-3)
        least = float(plant.variables[name].min)
        assert f"{name} must be >= {least!r}, got -0.001" in str(failure.value)
        plant.call("reset")
        plant.prepare()
        if name.endswith(MAY_VANISH):
            plant.put(name, 0.0)
            plant.call("exitInitializationMode")
            assert np.all(np.isfinite(plant.advance(1e-3, u=100.0).take("y_pi", "y_pm", "w", "energy")))
            return
        with pytest.raises(UnitFailure, match=re.escape(f"{name} must be >= {least!r}, got 0.0")):
            plant.put(name, 0.0)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_starts_at_rest_under_voltages_and_stays(units: BuiltUnits, structure: str) -> None:
    model = design_of(structure).model()
    u = 400.0 * np.cos(np.arange(len(model.structure.patch)))
    force = np.zeros(len(model.structure.beam))
    with loaded(units("BeamPlant", structure)) as plant:
        plant.begin(start_at_rest_under=u)
        start = plant.take("y_pi", "y_pm", "w", "energy")
        found = run(plant, np.tile(np.concatenate([u, force]), (100, 1)), 0.01)
    assert_close(start[None], Motion(model, u).values()[None], model, 1e-10)
    assert_close(found, np.tile(start, (100, 1)), model, 1e-10)


def test_w_runs_from_the_clamp_to_the_tip(units: BuiltUnits) -> None:
    """Deflections at equal distances: zero at the clamp; their cubic interpolation meets y_pi of the same beam."""
    structure = design_of().structure
    with loaded(units("BeamPlant")) as plant:
        plant.begin(start_at_rest_under=[817.0, -770.0, -807.0, 781.0])
        w, y = plant.take("w").reshape(3, 21), plant.take("y_pi")
    assert np.abs(w[:, 0]).max() < 1e-15 * np.abs(w).max()
    for k, point in enumerate(structure.point_of_interest):
        z = np.linspace(0, structure.beam[point.beam - 1].length, 21)
        near = np.sort(np.argsort(np.abs(z - point.position))[:6])
        interpolated = np.polyval(np.polyfit(z[near], w[point.beam - 1][near], 5), point.position)
        assert interpolated == pytest.approx(y[k], rel=1e-4)


def test_energy_is_kept_without_damping_and_lost_with_it(units: BuiltUnits) -> None:
    none = {name: 0.0 for name in PARAMETERS if name.endswith("damping")}
    rest = {"start_at_rest_under": [817.0, -770.0, -807.0, 781.0]}
    with loaded(units("BeamPlant")) as plant:
        plant.begin(**none, **rest)
        start = plant.take("energy")[0]
        kept = [plant.advance(1e-3).take("energy")[0] for _ in range(2000)]
        plant.call("reset")
        plant.begin(**rest)
        lost = [plant.take("energy")[0], *(plant.advance(1e-3).take("energy")[0] for _ in range(2000))]
    np.testing.assert_allclose(kept, start, rtol=1e-10)
    assert np.all(np.diff(lost) < 0)
    assert lost[-1] < 0.9 * lost[0]


def test_a_force_does_work(units: BuiltUnits) -> None:
    """Undamped, from rest, a constant force on a tip: what it does to the tip's deflection is all the energy."""
    none = {name: 0.0 for name in PARAMETERS if name.endswith("damping")}
    with loaded(units("BeamPlant")) as plant:
        plant.begin(**none)
        for _ in range(50):
            plant.advance(3e-3, force=[0.0, 0.2, 0.0])
            assert plant.take("energy")[0] == pytest.approx(0.2 * plant.take("w[2,21]")[0], rel=1e-9)


def test_the_start_time_changes_no_motion(units: BuiltUnits) -> None:
    traces = []
    for start in (0.0, 3600.0):
        with loaded(units("BeamPlant")) as plant:
            plant.begin(start, u=300.0, strain_noise_std=1e-7)
            traces.append([plant.advance(SAMPLE).take("y_pi", "w", "energy") for _ in range(20)])
    np.testing.assert_array_equal(traces[0], traces[1])


# Strain noise


def strains(
    units: BuiltUnits, steps: int, step: float = SAMPLE, *, std: float = 1e-6, seed: int = 1, parts: int = 1
) -> Real:
    """Strains at the start and after each step, (steps + 1, n_pm), of a plant under constant voltage."""
    u = [300.0, -200.0, 100.0, 50.0]
    with loaded(units("BeamPlant")) as plant:
        plant.begin(u=u, start_at_rest_under=u, strain_noise_std=std, noise_seed=seed)
        trace = [plant.take("y_pm")]
        for _ in range(steps):
            for _ in range(parts):
                plant.advance(step / parts)
            trace.append(plant.take("y_pm"))
    return np.array(trace)


def test_noise_has_the_given_deviation_and_is_white(units: BuiltUnits) -> None:
    """Bounds of 4 standard deviations of each estimate from n samples, for a fixed seed."""
    n = 8000
    noise = (strains(units, n - 1, std=2e-6) - strains(units, 1, std=0.0)[0]) / 2e-6
    assert np.all(np.abs(noise.mean(axis=0)) < 4 / np.sqrt(n))
    assert np.all(np.abs(noise.std(axis=0) - 1) < 4 / np.sqrt(2 * n))
    assert np.all(np.abs((noise**3).mean(axis=0)) < 4 * np.sqrt(15 / n))
    assert np.all(np.abs((noise**4).mean(axis=0) - 3) < 4 * np.sqrt(96 / n))
    correlation = noise.T @ noise / n - np.eye(6)
    assert np.abs(correlation[~np.eye(6, dtype=bool)]).max() < 4 / np.sqrt(n)
    for lag in range(1, 8):
        assert np.abs(noise[lag:].T @ noise[:-lag] / n).max() < 4.5 / np.sqrt(n)


def test_noise_is_the_seeds_whatever_the_steps(units: BuiltUnits) -> None:
    first = strains(units, 40)
    np.testing.assert_array_equal(strains(units, 40), first)
    scale = np.abs(first).max()
    np.testing.assert_allclose(strains(units, 40, parts=3), first, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(strains(units, 8, 5 * SAMPLE), first[::5], rtol=0, atol=1e-12 * scale)
    other = strains(units, 40, seed=2)
    assert np.abs(other - first).max(axis=1).min() > 1e-8
    assert np.abs(np.corrcoef((other - other.mean(axis=0)).ravel(), (first - first.mean(axis=0)).ravel())[0, 1]) < 0.25


def test_noise_is_measured_only(units: BuiltUnits) -> None:
    """Noise neither moves the plant nor shows in the deflections."""
    traces = []
    for std in (0.0, 1e-5):
        with loaded(units("BeamPlant")) as plant:
            plant.begin(u=500.0, strain_noise_std=std)
            traces.append([plant.advance(SAMPLE).take("y_pi", "w", "energy") for _ in range(30)])
    np.testing.assert_array_equal(traces[0], traces[1])


def test_seed_of_the_largest_integer(units: BuiltUnits) -> None:
    assert np.all(np.isfinite(strains(units, 3, seed=2**31 - 1)))
