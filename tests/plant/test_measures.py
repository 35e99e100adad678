"""Overshoot, settling and decay on signals whose measures have a closed form."""

import numpy as np
import pytest
from scipy.optimize import brentq

from flexbeams.plant.measures import decay_time, last_time_outside, motion_settling_time, overshoots, settling_time

SAMPLE = 1e-3
TIME = np.arange(0, 12, SAMPLE)


def step_response(time: np.ndarray, decay: float, frequency: float) -> np.ndarray:
    """Second-order step response to 1: 1 - e^{-at} (cos bt + a/b sin bt)."""
    wave = np.cos(frequency * time) + decay / frequency * np.sin(frequency * time)
    return np.asarray(1 - np.exp(-decay * time) * wave)


def test_overshoot_of_a_second_order_system() -> None:
    """exp(-pi a / b) of the end value, at t = pi / b, in the direction of motion."""
    decay, frequency = 0.4, np.pi / 0.5
    end = np.array([2.0, -3.0, 5.0])
    y = step_response(TIME, decay, frequency)[:, None] * end
    np.testing.assert_allclose(overshoots(y, end), np.abs(end) * np.exp(-np.pi * decay / frequency), rtol=1e-12)


def test_no_overshoot_of_a_signal_that_creeps() -> None:
    y = (1 - np.exp(-TIME))[:, None] * np.array([1.0, -1.0])
    np.testing.assert_array_equal(overshoots(y, np.array([1.0, -1.0])), [0.0, 0.0])


def test_undershoot_is_no_overshoot() -> None:
    y = np.stack([-2 * np.sin(TIME), 2 * np.sin(TIME)], axis=1) * (np.pi > TIME)[:, None]
    np.testing.assert_allclose(overshoots(y, np.array([1.0, 1.0])), [0.0, 1.0], atol=1e-6)


def test_last_time_outside() -> None:
    y = np.exp(-TIME)[:, None] * np.array([1.0, -3.0])
    assert last_time_outside(TIME, y, 0.01) == pytest.approx(np.log(300), abs=SAMPLE)
    assert last_time_outside(TIME, y, np.array([0.5, np.inf])) == pytest.approx(np.log(2), abs=SAMPLE)
    assert last_time_outside(TIME, y, 3.0) == -np.inf


def test_a_signal_that_is_not_a_number_never_settles() -> None:
    y = np.zeros((TIME.size, 2))
    y[-1, 1] = np.nan
    assert last_time_outside(TIME, y, 1.0) == TIME[-1]


def test_settling_of_exponentials() -> None:
    """ln 50 time constants to 2 %, the slowest output decides, each within its own band."""
    rates, end = np.array([2.0, 0.8, 1.0]), np.array([1.0, -1e-3, 40.0])
    y = (1 - np.exp(-np.maximum(TIME - 1, 0)[:, None] * rates)) * end
    assert settling_time(TIME, y, end, 1.0) == pytest.approx(np.log(50) / 0.8, abs=SAMPLE)
    assert settling_time(TIME, y, end, 1.0, tolerance=0.1) == pytest.approx(np.log(10) / 0.8, abs=SAMPLE)
    assert settling_time(TIME, y, end, 0.0) == pytest.approx(1 + np.log(50) / 0.8, abs=SAMPLE)


def test_settling_of_an_oscillation() -> None:
    """The last crossing of the band, found as a root between the last peak outside and the next zero."""
    decay, frequency, share = 0.5, 9.0, 0.02
    peaks = np.arange(1, 60) * np.pi / frequency
    last = peaks[np.abs(1 - step_response(peaks, decay, frequency)) > share][-1]
    exact = brentq(
        lambda t: abs(1 - step_response(np.array([t]), decay, frequency)[0]) - share,
        last,
        last + 0.4 * np.pi / frequency,
    )
    y = step_response(TIME, decay, frequency)[:, None] * np.array([-2.0])
    assert settling_time(TIME, y, np.array([-2.0]), 0.0) == pytest.approx(exact, abs=SAMPLE)


def test_motion_settling_counts_in_the_largest_end_value() -> None:
    """2 % of 40: the small output is inside from ln(10 / 0.8) time constants on."""
    end = np.array([10.0, 40.0])
    y = np.stack([10 - 10 * np.exp(-TIME), np.full(TIME.size, 40.0)], axis=1)
    assert motion_settling_time(TIME, y, end, 0.0) == pytest.approx(np.log(10 / 0.8), abs=SAMPLE)
    assert settling_time(TIME, y, end, 0.0) == pytest.approx(np.log(50), abs=SAMPLE)


def test_decay_of_a_disturbance() -> None:
    """A cosine that decays from 5 about a rest that is not zero, in shares of a peak of 4."""
    before, start = np.array([7.0, -1.0]), 2.0
    late = np.maximum(TIME - start, 0)
    wave = 5 * np.exp(-late) * np.cos(200 * late) * (start <= TIME)
    y = before + np.stack([wave, 0.1 * wave], axis=1)
    exact = np.log(5 / (0.02 * 4))
    assert decay_time(TIME, y, before, start, 4.0) == pytest.approx(exact, abs=np.pi / 200)


@pytest.mark.parametrize("measure", [settling_time, motion_settling_time])
def test_settled_before_the_start_is_zero(measure: object) -> None:
    y = np.ones((TIME.size, 2))
    y[:5] = 0
    assert callable(measure)
    assert measure(TIME, y, np.ones(2), 1.0) == 0.0


def test_decayed_before_the_start_is_zero() -> None:
    assert decay_time(TIME, np.zeros((TIME.size, 3)), np.zeros(3), 1.0, 1.0) == 0.0
