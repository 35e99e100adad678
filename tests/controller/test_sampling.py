"""Weights hold at any sample time; rates that are too slow for the retained modes are refused."""

import re

import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.errors import DesignError
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import design_of

KIEL = read_structure(find_structure("kiel"))


def at(sample_time: float) -> Design:
    return compute_design(KIEL, DesignOptions(sample_time=sample_time))


def structural_pole(made: Design) -> float:
    """Decay of the slowest oscillation in the closed loop on the design's own plant, 1/s."""
    from flexbeams.controller.closed_loop import closed_loop_poles, sampled_controller, sampled_plant

    controller = sampled_controller(made.arrays, made.integral_gain)
    poles = closed_loop_poles(controller, sampled_plant(made.model(), made.options.sample_time))
    return float(-poles[poles.imag > 1.0].real.max())


@pytest.mark.parametrize("rate", [500.0, 1e3, 2e4, 5e4])
def test_the_loop_decays_alike_at_every_rate(rate: float) -> None:
    """The slowest structural pole within 5 % of that at 5 kHz, and the integral as fast in seconds."""
    made, reference = at(1 / rate), design_of()
    assert structural_pole(made) == pytest.approx(structural_pole(reference), rel=0.05)
    assert made.integral_gain * rate == pytest.approx(reference.integral_gain * 5e3, rel=1e-12)
    assert made.integral_gain_limit * rate == pytest.approx(reference.integral_gain_limit * 5e3, rel=0.1)


def test_published_weights_hold_to_the_last_bit_at_the_published_rate() -> None:
    """A ratio of sample times of exactly 1 changes nothing."""
    from flexbeams.controller.kalman import hankel_weights, predictor_gain

    made = design_of()
    a, s = made.arrays, made.summary
    sigma = np.array(s["hankel_position"][:15]), np.array(s["hankel_velocity"][:15])
    Q = np.diag(hankel_weights(*sigma, total=50.0, position=5e3, velocity=10.0))
    assert set(s["state_groups"]["position"]) == {1}  # signs only: Q is diagonal
    np.testing.assert_array_equal(predictor_gain(a["A_d"], a["H_pm"], Q, 20 * np.eye(6)), a["estimator_gain"])


def test_a_rate_below_the_retained_modes_is_refused_with_what_fits() -> None:
    with pytest.raises(DesignError, match=r"retained mode at 24\d\d rad/s: the Nyquist frequency is 314") as refusal:
        at(1e-2)
    fitting = re.search(r"(fits), or a sample time of at most (\S+) s", str(refusal.value))
    assert fitting is not None
    at(float(fitting[2]))


def test_the_refusal_names_a_number_of_modes_that_fits() -> None:
    """In the energy norm the lowest modes are retained, so fewer of them are slower."""
    options = {"sample_time": 1e-2, "output_weight": "energy"}
    with pytest.raises(DesignError, match=r"retained mode at 24\d\d rad/s") as refusal:
        compute_design(KIEL, DesignOptions(**options))  # type: ignore[arg-type]
    fitting = re.search(r"reduced_modes = (\d) fits", str(refusal.value))
    assert fitting is not None
    compute_design(KIEL, DesignOptions(**options, reduced_modes=int(fitting[1])))  # type: ignore[arg-type]
    with pytest.raises(DesignError, match="too long for the retained mode"):
        compute_design(KIEL, DesignOptions(**options, reduced_modes=int(fitting[1]) + 1))  # type: ignore[arg-type]


def test_a_mode_above_a_third_of_nyquist_is_a_warning() -> None:
    assert any("above a third of the Nyquist frequency" in line for line in at(1e-3).summary["warnings"])
    assert at(3e-4).summary["warnings"] == []
