"""MfcActuator and MfcCompensator with both kernels: inverse to each other, exact in any step, and what they refuse."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import BuiltUnits, Workshop
from tests.native.workshop import native_folder, needs_zig
from tests.units.loaded import Loaded, Real, loaded

STEP = 2e-4
ZONES = {"dead_zone_threshold[2,2]": 0.0, "dead_zone_threshold[3,2]": -200.0, "dead_zone_slope[3,2]": -0.1}
STATES = int(os.environ.get("FLEXBEAMS_STATES", "500"))  # 10000 for the full proof


@contextmanager
def pair(units: BuiltUnits) -> Iterator[tuple[Loaded, Loaded]]:
    with loaded(units("MfcCompensator")) as compensator, loaded(units("MfcActuator")) as actuator:
        yield compensator, actuator


def wanted(seed: int, steps: int) -> Real:
    """Four channels: random, slow, fast, noisy; within reach."""
    rng, k = np.random.default_rng(seed), np.arange(steps)
    columns = [rng.uniform(-800, 800, steps), 800 * np.sin(k / 60), 700 * np.sin(1.9 * k)]
    return np.column_stack([*columns, 600 * np.sin(k / 30) + rng.normal(0, 10, steps)])


@pytest.mark.parametrize("sequential", [False, True], ids=["jacobi", "gauss-seidel"])
def test_one_after_the_other_they_are_the_identity(units: BuiltUnits, sequential: bool) -> None:
    """From the state after a common history; one step of delay more where all read before all step.

    A dead zone of the second patch begins at zero, both of the third are on one side.
    """
    history = {"history[1,1]": 900.0, "history[1,2]": -500.0, "history[1,4]": 300.0, "history[3,4]": -250.0}
    history |= ZONES
    targets = wanted(1, 250)
    with pair(units) as (compensator, actuator):
        compensator.begin(**history)
        actuator.begin(**history)
        np.testing.assert_array_equal(compensator.take("u"), [300.0, 0.0, -250.0, 0.0])
        found = []
        for row in targets:
            command = compensator.take("u")
            compensator.advance(STEP, u_eff=row)
            actuator.advance(STEP, u=compensator.take("u") if sequential else command)
            found.append(actuator.take("u_eff"))
        delay = 0 if sequential else 1
        np.testing.assert_allclose(found[delay:], targets[: len(targets) - delay], rtol=0, atol=1e-9)


def test_out_of_reach_saturates_says_so_and_recovers(units: BuiltUnits) -> None:
    with pair(units) as (compensator, actuator):
        compensator.begin()
        actuator.begin()
        for k, level in enumerate((500.0, 1300.0, 1300.0, -400.0, 600.0)):
            compensator.advance(STEP, u_eff=[level, 100.0, 0.0, 0.0])
            actuator.advance(STEP, u=compensator.take("u"))
            reached = level < 1000.0
            assert compensator.take("saturated")[0] == (not reached)
            assert compensator.take("u")[0] == 1000.0 or reached
            assert (abs(actuator.take("u_eff")[0] - level) < 1e-9) == reached, k
            assert abs(actuator.take("u_eff")[1] - 100.0) < 1e-9
        assert compensator.get("saturated_steps") == 2
        assert actuator.get("saturated_steps") == 0
        lines = [line for line in compensator.notes if "limit" in line]
        assert len(lines) == 1
        assert "u[1] at 0.0004 s is held at the amplifier's limit 1000.0, asked for 1" in lines[0]


def test_an_actuator_limits_what_is_commanded(units: BuiltUnits) -> None:
    """A supply off the middle of the faces' range leaves less."""
    with loaded(units("MfcActuator")) as actuator:
        actuator.begin(supply=600.0, **{"resolution[2]": 2.5})
        actuator.advance(STEP, u=[2000.0, 101.0, -901.0, 900.0])
        np.testing.assert_array_equal(actuator.take("voltage"), [900.0, 100.0, -900.0, 900.0])
        assert actuator.take("saturated")[0] == 1
        actuator.advance(STEP, u=0.0)
        assert actuator.take("saturated")[0] == 0
        assert actuator.get("saturated_steps") == 1


@pytest.mark.parametrize("unit", ["MfcActuator", "MfcCompensator"])
def test_parameters_at_their_limits_are_taken(units: BuiltUnits, unit: str) -> None:
    """Equal thresholds are one with both weights; a history may end at the amplifier's limit, on either side."""
    output = {"MfcActuator": "u_eff", "MfcCompensator": "u"}[unit]
    with loaded(units(unit)) as one, loaded(units(unit), "other") as other:
        one.begin(**{"history[1,4]": 1000.0, "history[2,4]": -1000.0})
        np.testing.assert_array_equal(
            one.take({"MfcActuator": "voltage", "MfcCompensator": "u"}[unit])[:2], [1e3, -1e3]
        )
        one.call("reset")
        common = {"history[1,3]": 700.0, "history[1,4]": -300.0, "dead_zone_threshold[1,1]": 500.0}
        one.begin(**common, **{"play_threshold[1,3]": 100.0, "dead_zone_threshold[1,2]": 500.0})
        weights = {f"play_weight[1,{k}]": one.take(f"play_weight[1,{k}]")[0] for k in (2, 3)}
        slopes = one.take("dead_zone_slope[1,1]", "dead_zone_slope[1,2]")
        shared = {
            "play_weight[1,2]": sum(weights.values()),
            "play_weight[1,3]": 0.0,
            "dead_zone_slope[1,1]": slopes.sum(),
        }
        other.begin(**common, **shared, **{"dead_zone_slope[1,2]": 0.0, "dead_zone_threshold[1,2]": 600.0})
        for u in (800.0, -200.0, 650.0):
            found = [
                each.advance(STEP, **{"u" if output == "u_eff" else "u_eff": u}).take(output) for each in (one, other)
            ]
            np.testing.assert_allclose(*found, rtol=1e-12)


@pytest.mark.parametrize("amplifier", [{}, {"lag": 1e-3}, {"slew_rate": 1e5}, {"lag": 2e-3, "slew_rate": 3e5}])
def test_a_step_may_be_split(units: BuiltUnits, amplifier: dict[str, float]) -> None:
    rng = np.random.default_rng(2)
    with loaded(units("MfcActuator")) as whole, loaded(units("MfcActuator"), "split") as split:
        whole.begin(**amplifier)
        split.begin(**amplifier)
        for _ in range(12):
            u, step = rng.uniform(-900, 900, 4), float(rng.choice([2e-4, 5e-3, 0.1]))
            whole.advance(step, u=u)
            for part in (0.3, 0.05, 0.65):
                split.advance(part * step, u=u)
            np.testing.assert_allclose(split.take("u_eff"), whole.take("u_eff"), rtol=0, atol=1e-9)


@needs_zig
@pytest.mark.parametrize("unit", ["MfcActuator", "MfcCompensator"])
def test_states_at_random_times_continue_bit_for_bit(unit: str) -> None:
    """The run goes on from each as if nothing had happened."""
    rng = np.random.default_rng(4)
    name = {"MfcActuator": "u", "MfcCompensator": "u_eff"}[unit]
    with loaded(native_folder(unit)) as one, loaded(native_folder(unit), "copy") as other:
        one.begin()
        other.begin()
        for _ in range(STATES):
            inputs = {name: rng.uniform(-900, 900, 4)}
            state, now = one.saved(), one.now
            expected = one.advance(STEP, **inputs).everything()
            other.restore(state).now = now
            np.testing.assert_array_equal(other.advance(STEP, **inputs).everything(), expected)
            assert other.saved() == one.saved()


@pytest.mark.parametrize("unit", ["MfcActuator", "MfcCompensator"])
@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"play_threshold[2,3]": 90.0}, r"play_threshold\[2,3\] must be >= 100.0, the threshold before, got 90.0"),
        ({"dead_zone_threshold[1,1]": 600.0}, r"dead_zone_threshold\[1,2\] must be >= 600.0, the threshold before"),
        (
            {"dead_zone_slope[4,1]": -1.25},
            r"dead_zone_slope\[4,1\] must leave the sum of slopes 1 \+ ... beyond its threshold > 0, else there is no "
            r"inverse, got a sum of -0.25",
        ),
        (
            {"dead_zone_threshold[1,2]": -400.0, "dead_zone_slope[1,1]": 1.0, "dead_zone_slope[1,2]": -1.5},
            r"dead_zone_slope\[1,2\] must leave the sum of slopes .* > 0, else there is no inverse, got a sum of -0.5",
        ),
        ({"supply[3]": 1500.0}, r"supply\[3\] must be between the faces' limits -500.0 and 1500.0, got 1500.0"),
        ({"history[2,4]": -1001.0}, r"history\[2,4\] must be within the amplifier's limit 1000.0, got -1001.0"),
    ],
)
def test_parameters_without_an_inverse_are_named(
    units: BuiltUnits, unit: str, values: dict[str, float], line: str
) -> None:
    with loaded(units(unit)) as one:
        one.prepare(**values)
        with pytest.raises(UnitFailure, match=line):
            one.call("exitInitializationMode")
        one.call("reset")
        output = {"MfcActuator": "u_eff", "MfcCompensator": "u"}[unit]
        np.testing.assert_array_equal(one.begin().take(output), 0.0)


@pytest.mark.parametrize("unit", ["MfcActuator", "MfcCompensator"])
def test_a_state_of_the_initialisation_keeps_what_is_refused_later(units: BuiltUnits, unit: str) -> None:
    with loaded(units(unit)) as one, loaded(units(unit), "other") as other:
        state = one.prepare(**{"dead_zone_slope[1,2]": -1.0}).saved()
        other.prepare()
        with pytest.raises(UnitFailure, match=r"dead_zone_slope\[1,2\] must leave the sum of slopes"):
            other.restore(state).call("exitInitializationMode")
        other.call("reset")
        other.begin().advance(STEP)


@needs_zig
def test_both_kernels_agree() -> None:
    """Over steps of several sizes, with amplifier and history, to 1e-12 of the largest voltage."""
    rng = np.random.default_rng(6)
    for unit, name, output in (("MfcActuator", "u", "u_eff"), ("MfcCompensator", "u_eff", "u")):
        starts = {"history[1,3]": 700.0, "history[2,4]": -300.0, **ZONES}
        starts |= (
            {"lag[1]": 1e-3, "slew_rate[2]": 1e5, "lag[2]": 1e-3, "lag[3]": 1e-3, "slew_rate[3]": 2e5}
            if name == "u"
            else {}
        )
        with loaded(native_folder(unit)) as native, loaded(Workshop().folder(unit)) as python:
            native.begin(**starts)
            python.begin(**starts)
            for _ in range(150):
                u, step = rng.uniform(-1000, 1000, 4), float(rng.choice([2e-4, 3e-3, 0.2]))
                found = [one.advance(step, **{name: u}).take(output) for one in (native, python)]
                np.testing.assert_allclose(*found, rtol=0, atol=1e-12 * 1000)
