"""Anti-windup with more patch pairs than points: what the integral holds after saturation is the rest's again."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest

from flexbeams.controller.design import Design
from flexbeams.controller.observer import tick_matrices
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.choices import Backend
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.references.tracking_controller import controller_experiments
from flexbeams.fmus.units.tracking_controller import TRACKING_CONTROLLER
from flexbeams.plant.structure import PointOfInterest, find_structure, read_structure
from tests.helpers import computed_once, made_once
from tests.native.workshop import needs_zig
from tests.units.loaded import Real, loaded

SAMPLE = 2e-4
GAIN = 1e-3  # k_I
LOWEST = np.array([-1000.0, -200.0])  # V
FAR, NEAR = 1.0, 0.2  # of 900 and 610 V: pair 2 is held at its limit, then both are within
BACKENDS = [pytest.param("native", marks=[pytest.mark.native, needs_zig]), "python"]


@cache
def two_pairs() -> Design:
    """The single beam with a second pair, for its one point of interest; pair 2 goes up to 350 V only."""
    single = read_structure(find_structure("single_beam"))
    [first] = single.patch
    second = replace(first, position=first.position + first.length + 0.02)
    structure = replace(single, patch=(first, second), actuator=None)
    return computed_once(structure, DesignOptions(reduced_modes=3, voltage_max=[600.0, 350.0]))


@cache
def three_pairs() -> Design:
    """The single beam with three pairs for two points: which pairs are held changes how the others' integrals grow."""
    single = read_structure(find_structure("single_beam"))
    [first] = single.patch
    patches = tuple(replace(first, position=position) for position in (0.025, 0.13, 0.235))
    [tip] = single.point_of_interest
    structure = replace(
        single, patch=patches, actuator=None, point_of_interest=(tip, PointOfInterest(beam=1, position=0.2))
    )
    return computed_once(structure, DesignOptions(reduced_modes=4))


def folder_of(backend: Backend, design: Design | None = None) -> Path:
    made = design or two_pairs()

    def make(folder: Path) -> None:
        [file] = build_units([TRACKING_CONTROLLER], made, made.model(), folder, backend=backend)
        fmpy.extract(str(file), unzipdir=str(folder / "unit"))

    return made_once(f"{len(made.structure.patch)}_pairs/{backend}", make) / "unit"


def references(factor: float) -> tuple[Real, Real]:
    """Voltages of the nearest rest, 20 % short, and the state at rest under all of them."""
    a = two_pairs().arrays
    u = a["static_inverse"][:, 0]
    u = factor * 900.0 * u / np.abs(u).max()
    return 0.8 * u, np.asarray(np.linalg.solve(a["A"], -a["B"] @ u))


class Plant:
    """The reduced model, its voltages held over a sample."""

    def __init__(self) -> None:
        self.a = two_pairs().arrays
        self.x = np.zeros(len(self.a["A"]))

    def strain_before(self, u: Real) -> Real:
        """Strains; then a sample under u."""
        strain = self.a["H_pm"] @ self.x + self.a["D_pm"] @ u
        self.x = self.a["A_d"] @ self.x + self.a["B_d"] @ u
        return np.asarray(strain)


def masked_only(steps: int) -> Real:
    """Voltages after the far and the near reference of a controller that only masks the growth, pair by pair."""
    a, plant = two_pairs().arrays, Plant()
    u_ff, x = references(FAR)
    plant.x, u, integral = x.copy(), np.maximum(u_ff, LOWEST), np.zeros(2)
    for factor in (FAR, NEAR):
        u_ff, x_ref = references(factor)
        for _ in range(steps):
            y_pm = plant.strain_before(u)
            innovation = y_pm - a["H_pm"] @ x - a["D_pm"] @ u
            x = a["A_d"] @ x + a["B_d"] @ u + a["estimator_gain"] @ innovation
            wanted = u_ff + a["feedback_gain"] @ (x_ref - x) + integral
            growth = GAIN * a["static_inverse"] @ (a["H_pi"] @ (x_ref - x) + a["D_pi"] @ (u_ff - u))
            integral += np.where((wanted < LOWEST) & (growth < 0), 0.0, growth)
            u = np.clip(wanted, LOWEST, 1000.0)
    return u


def out_of_range(u: Real) -> float:
    """The part of the voltages that moves nothing at rest, V."""
    return float(np.linalg.norm(u - tick_matrices(two_pairs().arrays).integral_range @ u))


def test_the_range_of_the_integral() -> None:
    """A projection onto G_0^+, and the unit matrix itself where the pairs are independent."""
    G = two_pairs().arrays["static_inverse"]
    P = tick_matrices(two_pairs().arrays).integral_range
    np.testing.assert_allclose(P @ P, P, atol=1e-14)
    np.testing.assert_allclose(P @ G, G, rtol=1e-13)
    assert np.linalg.matrix_rank(P) == 1


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.slow
def test_saturation_leaves_nothing_behind(backend: Backend) -> None:
    """A second beyond the limit of pair 2, then a second within: masking alone keeps 178 V that nothing takes back."""
    assert out_of_range(masked_only(5000)) == pytest.approx(177.5, abs=0.1)
    plant = Plant()
    with loaded(folder_of(backend)) as unit:
        u_ff, x_ref = references(FAR)
        plant.x = x_ref.copy()
        unit.begin(integral_gain=GAIN, voltage_min=LOWEST, u_ff=u_ff, x_ref=x_ref)
        for factor in (FAR, NEAR):
            u_ff, x_ref = references(factor)
            unit.put("u_ff", u_ff)
            unit.put("x_ref", x_ref)
            for _ in range(5000):
                unit.advance(SAMPLE, y_pm=plant.strain_before(unit.take("u")))
            assert unit.take("saturated")[0] == (factor == FAR)
        assert 0.5 <= unit.take("saturation_share")[0] < 0.55
        assert out_of_range(unit.take("u")) < 0.2


@pytest.mark.parametrize("backend", BACKENDS)
def test_reference_results_hold_with_redundant_pairs(backend: Backend) -> None:
    """The experiments of the unit, computed in another way; limits are reached in both, the design's for each pair."""
    for experiment in controller_experiments(two_pairs(), two_pairs().model()):
        names, rows = experiment.stimuli.names, experiment.stimuli.values
        with loaded(folder_of(backend)) as unit:
            unit.prepare(**experiment.parameters)
            for name, value in zip(names, rows[0], strict=True):
                unit.put(name, float(value))
            unit.call("exitInitializationMode")
            found = [unit.take("u", "y_est", "saturated")]
            for row in rows[:-1]:
                unit.advance(SAMPLE, **dict(zip(names, row.tolist(), strict=True)))
                found.append(unit.take("u", "y_est", "saturated"))
        expected = experiment.references.values
        scale = np.abs(expected).max(axis=0)
        assert np.abs(np.array(found) - expected).max(axis=0) == pytest.approx(0.0, abs=1e-9 * float(scale.max()))
        assert expected[:, -1].any()
        assert expected[:, 1].max() == min(350.0, experiment.parameters.get("voltage_limit", 1000.0))


@needs_zig
@pytest.mark.native
def test_both_kernels_agree_while_limits_move() -> None:
    """Random strains, references and limits of each pair, with much saturation on both sides: to 1e-12."""
    rng = np.random.default_rng(3)
    design = three_pairs()
    m, gauges = len(design.arrays["A"]), len(design.structure.strain_gauge)
    traces = [
        [unit_inputs(rng, m, gauges), float(rng.choice([SAMPLE, 2 * SAMPLE, 0.3 * SAMPLE])), limits_of_pairs(rng)]
        for _ in range(400)
    ]
    found = []
    for backend in ("native", "python"):
        with loaded(folder_of(backend, design)) as unit:
            unit.begin(integral_gain=1e-3)
            rows = []
            for k, (inputs, step, limits) in enumerate(traces):
                for name, value in limits.items() if k % 10 == 0 else ():
                    unit.put(name, value)
                rows.append(unit.advance(step, **inputs).everything())
            found.append(np.array(rows))
            assert 0.2 < unit.take("saturation_share")[0] < 0.95
    native, python = found
    scale = np.abs(python).max(axis=0)
    assert (np.abs(native - python).max(axis=0) / np.where(scale > 0, scale, 1.0)).max() < 1e-12


def unit_inputs(rng: np.random.Generator, m: int, gauges: int) -> dict[str, Real]:
    return {
        "y_pm": rng.normal(0.0, 3e-5, gauges),
        "u_ff": rng.normal(0.0, 130.0, 3),
        "x_ref": rng.normal(0.0, 1e-2, m),
    }


def limits_of_pairs(rng: np.random.Generator) -> dict[str, Real]:
    return {"voltage_min": -rng.uniform(0.0, 400.0, 3), "voltage_max": rng.uniform(0.0, 400.0, 3)}
