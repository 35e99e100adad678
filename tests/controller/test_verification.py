"""Designs are verified on the loop that is closed: the limit of the integral gain, refusals and the weight to blame."""

import re
from dataclasses import replace
from functools import cache

import pytest

from flexbeams.controller.closed_loop import closed_loop_poles, sampled_controller, sampled_plant
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.plant.errors import DesignError
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import design_of

pytestmark = pytest.mark.slow

KIEL = read_structure(find_structure("kiel"))


@cache
def published(name: str) -> float:
    return float(getattr(Weights(), name))


def scaled(kalman: float = 1.0, lqr: float = 1.0) -> Weights:
    """The published weights with their totals scaled."""
    return Weights(kalman_q_total=kalman * published("kalman_q_total"), lqr_q_total=lqr * published("lqr_q_total"))


def pole(made: Design, plant: str, integral_gain: float) -> complex:
    """Least stable pole of the loop on a plant, "design" or "exact"."""
    model = made.model() if plant == "design" else made.model("segment")
    controller = sampled_controller(made.arrays, integral_gain)
    return complex(closed_loop_poles(controller, sampled_plant(model, made.options.sample_time))[0])


@pytest.mark.parametrize("structure", ["kiel", "five_beams", "single_beam"])
def test_summary_has_the_poles_and_the_limit(structure: str) -> None:
    """The limit is stable and 5 % above it is not, on one of the plants; the default is at most a third of it."""
    made = design_of(structure)
    limit = made.integral_gain_limit
    assert 0 < made.integral_gain <= min(1e-4, limit / 3)
    for plant, (real, imaginary) in made.summary["closed_loop"].items():
        found = pole(made, plant, made.integral_gain)
        assert (real, abs(imaginary)) == pytest.approx((found.real, abs(found.imag)), abs=1e-6)
        assert pole(made, plant, limit).real < 0
    assert max(pole(made, plant, 1.05 * limit).real for plant in ("design", "exact")) > 0


def test_limits_of_the_shipped_structures() -> None:
    assert design_of().integral_gain_limit == pytest.approx(1.2e-3, rel=0.02)
    assert 5e-4 < design_of("five_beams").integral_gain_limit < 1e-3


@pytest.mark.parametrize(("structure", "gain", "limit"), [("kiel", 2e-3, "0.0012"), ("five_beams", 1e-3, r"0\.000\d+")])
def test_an_integral_gain_beyond_the_limit_is_refused(structure: str, gain: float, limit: str) -> None:
    message = rf"integral_gain = {gain:g} makes the sampled loop unstable; {limit} still holds"
    with pytest.raises(DesignError, match=message):
        compute_design(read_structure(find_structure(structure)), DesignOptions(integral_gain=gain))


def test_an_integral_gain_that_the_rounded_limit_leaves_out_is_accepted() -> None:
    assert compute_design(KIEL, DesignOptions(integral_gain=1.205e-3)).integral_gain == 1.205e-3


@pytest.mark.parametrize(
    ("weights", "plant", "blamed"),
    [
        (scaled(1e3, 1e3), "the design's own plant", "kalman_q_total"),
        (scaled(10.0, 1e6), "the exact plant", "lqr_q_total"),
        (scaled(1e2, 1e3), "the exact plant", "lqr_q_total"),
    ],
)
def test_an_unstable_loop_is_refused_with_the_weight_to_blame(weights: Weights, plant: str, blamed: str) -> None:
    """The value that still holds does, and 1.5 times the distance from it does not."""
    with pytest.raises(DesignError, match=rf"the sampled loop is unstable on {plant}.*, pole [\d.]+[+-]") as refusal:
        compute_design(KIEL, DesignOptions(weights=weights))
    found = re.search(r"weights\.(\w+) = \S+ is to blame; (\S+) still holds", str(refusal.value))
    assert found is not None
    assert found[1] == blamed
    held = replace(weights, **{blamed: float(found[2])})
    compute_design(KIEL, DesignOptions(weights=held))
    with pytest.raises(DesignError, match="is unstable on"):
        compute_design(KIEL, DesignOptions(weights=replace(weights, **{blamed: 1.5 * float(found[2])})))
    assert ('verify = "design"' in str(refusal.value)) == ("exact" in plant)


def test_a_loop_that_is_unstable_on_the_exact_plant_alone_can_be_accepted_with_a_warning() -> None:
    made = compute_design(KIEL, DesignOptions(weights=scaled(1e2, 1e3), verify="design"))
    assert pole(made, "design", made.integral_gain).real < 0 < pole(made, "exact", made.integral_gain).real
    assert any('verify = "design"' in line and "unstable, pole" in line for line in made.summary["warnings"])
    assert design_of().summary["warnings"] == []
