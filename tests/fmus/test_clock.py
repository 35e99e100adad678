"""The clock of the units: start times, repeated and skipped steps, hosts that add up their times, long runs, absurd
times. What a step does depends on the time since the start and the step alone."""

from collections.abc import Callable

import numpy as np
import pytest

from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import BuiltUnits, design_of
from tests.native.workshop import native_folder, needs_zig
from tests.units.loaded import Loaded, Real, loaded

H = 2e-4  # s
STARTS = (-1e9, 1e4, 2e6, 1e9, 1.7e9)  # the last ones are seconds since 1970
UNITS = ("BeamPlant", "FlatnessFeedforward", "TrackingController")
LOOP = "BeamClosedLoop"


def excite(unit: Loaded) -> None:
    """Inputs that move the unit, whichever it is."""
    target = np.array([-1e-3, 0.1e-3, 0.5e-3, -0.7e-3])
    for name, value in {
        "u": [200.0, -150.0, 100.0, 50.0],
        "y_target": target,
        "feedforward.y_target": target,
        "y_pm": np.linspace(-1e-5, 2e-5, 6),
        "u_ff": [100.0, 50.0, -20.0, 10.0],
    }.items():
        variable = next((v for v in unit.variables if v == name or v.startswith(f"{name}[")), None)
        if variable is not None and unit.variables[variable].causality == "input":
            unit.put(name, value)


def outputs(unit: Loaded) -> Real:
    """Every output."""
    return np.concatenate([unit._take(n) for n, v in unit.variables.items() if v.causality == "output"])


def run(folder: object, steps: int, step: float, start: float, time_of: Callable[[int], float]) -> Real:
    with loaded(folder) as unit:  # type: ignore[arg-type]
        unit.prepare(start)
        assert unit.take("time")[0] == start
        unit.call("exitInitializationMode")
        excite(unit)
        rows = []
        for k in range(steps):
            unit.step(time_of(k), step)
            rows.append(outputs(unit))
        return np.array(rows)


@pytest.mark.parametrize("step", [H, 1e-3, 1e-6])
@pytest.mark.parametrize("unit", UNITS)
def test_the_start_time_changes_nothing(units: BuiltUnits, unit: str, step: float) -> None:
    """Bit for bit, with steps down to four times the resolution of the host's clock."""
    folder, steps = units(unit), 40
    wanted = run(folder, steps, step, 0.0, lambda k: k * step)
    assert np.ptp(wanted, axis=0).max() > 0 or step == 1e-6
    for start in STARTS:
        np.testing.assert_array_equal(run(folder, steps, step, start, lambda k, s=start: s + k * step), wanted)


@needs_zig
@pytest.mark.parametrize("step", [H, 1e-3, 1e-6])
def test_the_start_time_changes_nothing_in_a_loop(step: float) -> None:
    folder = native_folder(LOOP)
    wanted = run(folder, 400, step, 0.0, lambda k: k * step)
    for start in STARTS:
        np.testing.assert_array_equal(run(folder, 400, step, start, lambda k, s=start: s + k * step), wanted)


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_short_steps_after_long_ones_at_a_late_start(units: BuiltUnits, start: float) -> None:
    """A step of 1 us moves the deflection by almost nothing, as do 500 of them."""
    with loaded(units("BeamPlant", "single_beam")) as plant:
        plant.begin(start).put("u[1]", 100.0)
        for k in range(500):
            plant.step(start + k * 1e-3, 1e-3)
        (rest,) = plant.take("y_pi[1]")
        assert rest == pytest.approx(-2.2e-3, rel=0.05)
        for k in range(500):
            plant.step(start + 0.5 + k * 1e-6, 1e-6)
            assert plant.take("y_pi[1]")[0] == pytest.approx(rest, rel=1e-4 if k == 0 else 0.05)


class AddingHost:
    """A host that adds up its steps instead of multiplying."""

    def __init__(self, start: float, step: float) -> None:
        self._time, self._step = start, step

    def __call__(self, k: int) -> float:
        time = self._time
        self._time += self._step
        return time


@needs_zig
@pytest.mark.parametrize("start", [0.0, 1e4, 1.7e9])
@pytest.mark.parametrize("unit", [*UNITS, LOOP])
def test_hosts_that_add_up_their_steps_get_the_same_bits(unit: str, start: float) -> None:
    steps = 4000
    wanted = run(native_folder(unit), steps, H, start, lambda k: start + k * H)
    np.testing.assert_array_equal(run(native_folder(unit), steps, H, start, AddingHost(start, H)), wanted)


@needs_zig
@pytest.mark.parametrize("start", [0.0, 1e6, 1.7e9])
def test_hosts_that_subtract_times_get_the_same_ticks(start: float) -> None:
    """Steps of ever new length, each a tick: rounding of 1 part in 1000 at epoch seconds."""
    with loaded(native_folder(LOOP)) as one, loaded(native_folder(LOOP)) as other:
        one.begin(start)
        other.begin(start)
        excite(one)
        excite(other)
        for k in range(2000):
            time = start + k * H
            one.step(time, H)
            other.step(time, (start + (k + 1) * H) - time)
        np.testing.assert_array_equal(outputs(other), outputs(one))


@pytest.mark.parametrize("start", [0.0, 1e6, 1.7e9])
@pytest.mark.parametrize("step", [H, 1e-6])
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("shift", [-1, 1, -5])
def test_repeated_skipped_and_reversed_steps_are_refused(
    units: BuiltUnits, unit: str, step: float, start: float, shift: int
) -> None:
    """One line that names both times; the instance works again after a reset."""
    with loaded(units(unit)) as one:
        one.begin(start)
        for k in range(5):
            one.step(start + k * step, step)
        with pytest.raises(UnitFailure, match=r"currentCommunicationPoint must be .*, the end of the last step, got"):
            one.step(start + (5 + shift) * step, step)
        one.call("reset")
        one.begin(start)
        one.step(start, step)


@needs_zig
@pytest.mark.parametrize("start", [0.0, 1e6, 1.7e9])
@pytest.mark.parametrize("step", [H, 1e-6])
@pytest.mark.parametrize("shift", [-1, 1, -5])
def test_repeated_skipped_and_reversed_steps_of_a_loop_are_refused(step: float, start: float, shift: int) -> None:
    with loaded(native_folder(LOOP)) as one:
        one.begin(start)
        for k in range(5):
            one.step(start + k * step, step)
        with pytest.raises(UnitFailure, match="currentCommunicationPoint"):
            one.step(start + (5 + shift) * step, step)
        one.call("reset")
        one.begin(start)
        one.step(start, step)


def scenario(start: float, step: float) -> Real:
    """Outputs of a loop over 1.6 s: a target, another one on the way to it, a push, feedback off at the end."""
    with loaded(native_folder(LOOP)) as loop:
        loop.begin(start, **{"feedforward.transition_time": 0.7})
        rows = []
        for k in range(round(1.6 / step)):
            time = k * step
            if k in (round(0.1 / step), round(0.5 / step)):
                loop.put("y_target", (1.0 if time < 0.3 else -0.4) * np.array([-8e-3, 1e-3, 4e-3, -6e-3]))
            if k in (round(0.9 / step), round(0.905 / step)):
                loop.put("force", 0.3 if time < 0.9025 else 0.0)
            if k == round(1.3 / step):
                loop.put("controller.feedback", False)
            loop.step(start + time, step)
            if k % 5 == 4:
                rows.append(outputs(loop))
    return np.array(rows)


@needs_zig
@pytest.mark.parametrize("step", [H, 1e-3])
def test_a_scenario_at_another_time_is_the_same(step: float) -> None:
    """Shifted to times that a rig has: 1e-9 of each signal's largest value was asked for, the bits are equal."""
    wanted = scenario(0.0, step)
    assert np.count_nonzero(np.ptp(wanted, axis=0) == 0) <= 1  # no voltage reaches its limit
    for start in (1e4, 2e6, 1e9, 1.7e9):
        np.testing.assert_array_equal(scenario(start, step), wanted)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize(
    ("start", "step", "text"),
    [
        (1e15, H, "communicationStepSize must be > .*, the resolution of the clock at 1"),
        (1e300, H, "communicationStepSize must be > .*, the resolution of the clock at 1"),
        (0.0, 1e9, r"communicationStepSize must be <= 200\.0, got 1"),
        (1e300, 1e300, r"communicationStepSize must be <= 200\.0, got 1"),
        (0.0, np.inf, "communicationStepSize must be finite and > 0, got inf"),
        (0.0, np.nan, "communicationStepSize must be finite and > 0, got nan"),
    ],
)
def test_absurd_times_are_refused_at_once(units: BuiltUnits, unit: str, start: float, step: float, text: str) -> None:
    with loaded(units(unit)) as one:
        one.begin(start)
        with pytest.raises(UnitFailure, match=text):
            one.step(start, step)


@pytest.mark.parametrize("start", [0.0, 1.7e9])
@pytest.mark.parametrize("unit", UNITS)
def test_a_step_beyond_the_stop_time_is_refused(units: BuiltUnits, unit: str, start: float) -> None:
    with loaded(units(unit)) as one:
        one.call("setupExperiment", None, start, start + 50 * H)
        one.call("enterInitializationMode")
        one.call("exitInitializationMode")
        for k in range(50):
            one.step(start + k * H, H)
        with pytest.raises(UnitFailure, match=r"communicationStepSize must end by stopTime .*, got 0\.0002 from"):
            one.step(start + 50 * H, H)


@pytest.mark.parametrize("step", [H, 1e-3, 1.7e-4])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
@pytest.mark.parametrize("unit", UNITS)
def test_a_state_goes_on_in_another_instance(units: BuiltUnits, unit: str, start: float, step: float) -> None:
    """Bit for bit, whatever steps the other instance has seen before."""
    with loaded(units(unit)) as one, loaded(units(unit)) as other:
        one.begin(start)
        other.begin(0.0)
        excite(one)
        for k in range(30):
            one.step(start + k * step, step)
        other.step(0.0, 3e-4)
        state = one.call("getFMUstate")
        content = one.call("serializeFMUstate", state)
        one.call("freeFMUstate", state)
        other.restore(bytes(content))
        for k in range(30, 90):
            one.step(start + k * step, step)
            other.step(start + k * step, step)
        np.testing.assert_array_equal(other.everything(), one.everything())


@needs_zig
def test_a_state_in_memory_of_another_unit_or_structure_is_refused() -> None:
    folders = [native_folder("TrackingController"), native_folder("BeamPlant", "single_beam")]
    with loaded(native_folder("BeamPlant")) as plant:
        plant.begin()
        for folder in folders:
            with loaded(folder) as other:
                other.begin()
                state = other.call("getFMUstate")
                with pytest.raises(
                    UnitFailure, match="FMU state must be of the same unit and design, got that of anot"
                ):
                    plant.call("setFMUstate", state)
                other.call("freeFMUstate", state)
        plant.call("reset")
        plant.begin().advance(H)


def test_ticks_and_outputs_do_not_depend_on_the_pieces_of_a_step(units: BuiltUnits) -> None:
    """A controller ticks once for each sample time, whatever the host's steps are made of."""
    with loaded(units("TrackingController")) as whole, loaded(units("TrackingController")) as pieces:
        for one in (whole, pieces):
            one.begin(1.7e9)
            excite(one)
        for k in range(60):
            whole.step(1.7e9 + k * H, H)
            for j in range(4):
                pieces.step(1.7e9 + (k + j / 4) * H, H / 4)
        np.testing.assert_array_equal(outputs(pieces), outputs(whole))
    assert design_of().options.sample_time == H


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("drift", [-1.5e-10, 1.5e-10])
def test_a_host_that_has_drifted_reaches_the_stop_time(units: BuiltUnits, unit: str, drift: float) -> None:
    """By its own clock, 0.6 us off after 4000 steps: it adds a short step, or shortens the last one."""
    stop = 4000 * H
    with loaded(units(unit)) as one:
        one.call("setupExperiment", None, 0.0, stop)
        one.call("enterInitializationMode")
        one.call("exitInitializationMode")
        time = 0.0
        while stop - time > 1e-12:
            step = min(H, stop - time)
            one.step(time, step)
            time += step + (drift if time < stop - 3 * H else 0.0)


def test_a_host_whose_clock_is_fast_does_all_its_steps(units: BuiltUnits) -> None:
    """0.6 us ahead after 3999 of 4000 steps, it may do the last one whole: by the unit's clock it ends in time."""
    with loaded(units("FlatnessFeedforward")) as one:
        one.call("setupExperiment", None, 0.0, 4000 * H)
        one.call("enterInitializationMode")
        one.call("exitInitializationMode")
        time = 0.0
        for _ in range(4000):
            one.step(time, H)
            time += H + 1.5e-10
        with pytest.raises(UnitFailure, match="communicationStepSize must end by stopTime"):
            one.step(time, H)


@pytest.mark.parametrize("unit", UNITS)
def test_a_reset_takes_the_start_time_back(units: BuiltUnits, unit: str) -> None:
    """A host may leave out fmi2SetupExperiment: then the start is 0."""
    with loaded(units(unit)) as one:
        one.begin(3.0).advance(H).call("reset")
        for function in ("enterInitializationMode", "exitInitializationMode"):
            one.call(function)
        assert one.take("time")[0] == 0.0
        one.step(0.0, H)
        found = one.everything()
        one.call("reset")
        np.testing.assert_array_equal(one.begin().advance(H).everything(), found)
