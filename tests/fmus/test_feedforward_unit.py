"""FlatnessFeedforward: transitions, targets during the motion, the voltage limit, preview."""

import re

import numpy as np
import pytest

from flexbeams.controller.planner import PLANNING_TICKS, InputShapes, PendingTransitions
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import STRUCTURES, BuiltUnits, design_of
from tests.units.loaded import Loaded, Real, loaded

SAMPLE = 2e-4
PLANNING = PLANNING_TICKS * SAMPLE  # s, from a target in a motion to its transition
TARGET = np.array([-8e-3, 1e-3, 4e-3, -6e-3])
FAR = TARGET * 1.5  # beyond the voltage limit at rest
OUTPUTS = ("u_ff", "x_ref", "y_ref")


def voltages_of(target: Real, structure: str = "kiel") -> Real:
    return np.asarray(design_of(structure).arrays["static_inverse"] @ target)


def reachable(structure: str) -> Real:
    """A target that takes 400 V at most."""
    design = design_of(structure)
    direction = np.cos(np.arange(len(design.structure.patch)))
    return np.asarray(np.linalg.pinv(design.arrays["static_inverse"]) @ direction) * 400.0


def trace(unit: Loaded, steps: int, step: float = SAMPLE, **changes: dict[int, Real]) -> Real:
    """u_ff, x_ref, y_ref after each step; `changes` has new values of inputs and parameters by step."""
    rows = []
    for k in range(steps):
        unit.advance(step, **{name: at[k] for name, at in changes.items() if k in at})
        rows.append(unit.take(*OUTPUTS))
    return np.array(rows)


def assert_groups_close(found: Real, wanted: Real, tolerance: float) -> None:
    """u_ff, x_ref and y_ref (4, 30, 4), each to `tolerance` of its largest magnitude."""
    for part in (slice(0, 4), slice(4, 34), slice(34, 38)):
        scale = np.abs(wanted[..., part]).max()
        assert np.abs(found[..., part] - wanted[..., part]).max() <= tolerance * scale


@pytest.mark.parametrize("structure", STRUCTURES)
def test_from_rest_to_rest(units: BuiltUnits, structure: str) -> None:
    """Zero at first, the target's static voltages at the end of the transition and exactly constant from there."""
    target = reachable(structure)
    wanted = 1.4
    with loaded(units("FlatnessFeedforward", structure)) as unit:
        unit.begin(transition_time=wanted)
        assert not unit.take(*OUTPUTS, "moving").any()
        unit.advance(0.1)
        assert not unit.take(*OUTPUTS, "moving").any()
        unit.advance(0.1, y_target=target)
        duration = unit.take("planned_time")[0]
        assert duration == wanted
        unit.advance(wanted - 0.1 - 1e-6)
        assert unit.take("moving")[0] == 1
        unit.advance(2e-6)
        assert unit.take("moving")[0] == 0
        end = unit.take(*OUTPUTS)
        np.testing.assert_allclose(unit.take("u_ff"), voltages_of(target, structure), rtol=1e-12)
        # The direct terms of the static correction make the reduced model's points meet the target
        np.testing.assert_allclose(unit.take("y_ref"), target, atol=1e-9 * np.abs(target).max())
        np.testing.assert_array_equal(unit.advance(5.0).take(*OUTPUTS), end)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_reference_state_follows_the_reduced_model(units: BuiltUnits, structure: str) -> None:
    """x' = A x + B u between samples, by Simpson's rule over pairs of small steps at several places."""
    design = design_of(structure)
    A, B, n_u = design.arrays["A"], design.arrays["B"], len(design.structure.patch)
    target, step = reachable(structure), 2e-5
    with loaded(units("FlatnessFeedforward", structure)) as unit:
        unit.begin(transition_time=1.4)
        unit.advance(0.25, y_target=target)
        for _ in range(5):
            rows = [unit.take("u_ff", "x_ref")] + [unit.advance(step).take("u_ff", "x_ref") for _ in range(2)]
            slopes = [A @ row[n_u:] + B @ row[:n_u] for row in rows]
            change = rows[2][n_u:] - rows[0][n_u:]
            rule = step / 3 * (slopes[0] + 4 * slopes[1] + slopes[2])
            assert np.abs(change - rule).max() < 1e-6 * np.abs(change).max()
            unit.advance(0.2)


@pytest.mark.slow
def test_outputs_do_not_depend_on_the_steps(units: BuiltUnits) -> None:
    """One run at 4 ms, one of it in parts, one in a single leap between changes of the target."""
    targets = {0: TARGET, 75: -0.5 * TARGET, 175: 0.25 * TARGET}
    with loaded(units("FlatnessFeedforward")) as unit:
        whole = trace(unit.begin(), 400, 4e-3, y_target=targets)
    for parts in (2, 5, 7):
        with loaded(units("FlatnessFeedforward")) as unit:
            split = trace(
                unit.begin(), 400 * parts, 4e-3 / parts, y_target={k * parts: value for k, value in targets.items()}
            )
        assert_groups_close(split[parts - 1 :: parts], whole, 1e-12)
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin()
        leaps = [
            unit.advance(step, y_target=target).take(*OUTPUTS)
            for step, target in zip((0.3, 0.4, 0.6), targets.values(), strict=True)
        ]
    assert_groups_close(np.array(leaps), whole[[74, 174, 324]], 1e-12)


def test_transitions_add_up(units: BuiltUnits) -> None:
    """Targets during the motion: the outputs are the sum of those that each change alone would give."""
    changes = {0: TARGET, 400: 0.4 * TARGET[::-1], 900: 1e-3 * np.ones(4)}
    parts, before, later = np.zeros((1850, 38)), np.zeros(4), round(PLANNING / 1e-3)
    for k, target in changes.items():
        with loaded(units("FlatnessFeedforward")) as unit:
            alone = {k + later * (k > 0): target - before}
            parts += trace(unit.begin(voltage_limit=1e4), 1850, 1e-3, y_target=alone)
        before = target
    with loaded(units("FlatnessFeedforward")) as unit:
        found = trace(unit.begin(voltage_limit=1e4), 1850, 1e-3, y_target=changes)
        assert unit.take("moving")[0] == 0
    assert_groups_close(found, parts, 1e-12)
    np.testing.assert_allclose(found[-1, :4], voltages_of(before), rtol=1e-12)


@pytest.mark.slow
def test_transitions_of_different_durations_add_up(units: BuiltUnits) -> None:
    """A short one ends while a long one that began earlier, and one that began later, go on."""
    changes = {0: (TARGET, 1.3), 200: (0.4 * TARGET[::-1], 0.45), 300: (1e-3 * np.ones(4), 0.9), 650: (0 * TARGET, 0.5)}
    parts, before, later = np.zeros((1400, 38)), np.zeros(4), round(PLANNING / 1e-3)
    folder = units("FlatnessFeedforward")
    for k, (target, time) in changes.items():
        with loaded(folder) as unit:
            alone = {k + later * (k > 0): target - before}
            parts += trace(unit.begin(voltage_limit=1e4, transition_time=time), 1400, 1e-3, y_target=alone)
        before = target
    with loaded(folder) as unit:
        found = trace(
            unit.begin(voltage_limit=1e4),
            1400,
            1e-3,
            y_target={k: target for k, (target, _) in changes.items()},
            transition_time={k: time for k, (_, time) in changes.items()},  # type: ignore[misc]
        )
        assert unit.take("moving")[0] == 0
    assert_groups_close(found, parts, 1e-12)


def test_the_start_time_shifts_the_motion(units: BuiltUnits) -> None:
    """To the rounding of the clock, which has 14 digits behind the point at 100 s."""
    traces = []
    for start in (0.0, 100.0):
        with loaded(units("FlatnessFeedforward")) as unit:
            traces.append(trace(unit.begin(start), 1600, 1e-3, y_target={100: TARGET, 600: -0.5 * TARGET}))
            assert unit.take("moving")[0] == 0
    assert_groups_close(traces[1], traces[0], 1e-9)


def test_a_transition_ends_at_its_very_end(units: BuiltUnits) -> None:
    """At times without rounding."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=0.5, preview=0.0)
        unit.advance(0.25, y_target=0.1 * TARGET)
        assert unit.take("moving", "planned_time").tolist() == [1.0, 0.5]
        unit.advance(0.25)
        assert unit.take("moving")[0] == 0
        np.testing.assert_allclose(unit.take("u_ff"), voltages_of(0.1 * TARGET), rtol=1e-12)


def test_new_target_does_not_jump(units: BuiltUnits) -> None:
    """Around a change in mid-motion, voltages bend no more than they do without it (Remark 5)."""
    with loaded(units("FlatnessFeedforward")) as unit:
        u = trace(unit.begin(), 600, 1e-3, y_target={0: TARGET, 450: np.zeros(4)})[:, :4]
    bend = np.abs(np.diff(u, 2, axis=0)).max(axis=1)
    assert bend[440:460].max() < bend.max()
    assert np.abs(np.diff(u, axis=0))[445:455].max() < np.abs(np.diff(u, axis=0)).max()


def test_ninth_target_waits_for_a_free_slot(units: BuiltUnits) -> None:
    """Eight transitions can be under way; the latest of the targets that came meanwhile is taken when one ends."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=1.0)
        for k in range(8):
            unit.advance(0.1, y_target=TARGET * (k + 1) / 16)
        unit.advance(0.05, y_target=TARGET * 0.9)  # t = 0.85
        unit.advance(0.05, y_target=TARGET * 0.6)  # t = 0.9
        held = [unit.advance(0.001).take(*OUTPUTS) for _ in range(90)]
        with loaded(units("FlatnessFeedforward")) as without:
            without.begin(transition_time=1.0)
            for k in range(8):
                without.advance(0.1, y_target=TARGET * (k + 1) / 16)
            without.advance(0.1)
            np.testing.assert_allclose(
                [without.advance(0.001).take(*OUTPUTS) for _ in range(90)], held, rtol=1e-9, atol=1e-12
            )
        unit.advance(0.02)  # the first ends at 1.0, the last target starts
        unit.advance(0.02)
        for _ in range(10):
            assert unit.take("moving")[0] == 1
            unit.advance(0.1)
        assert unit.take("moving")[0] == 0
        np.testing.assert_allclose(unit.take("y_ref"), 0.6 * TARGET, atol=1e-9)
        np.testing.assert_allclose(unit.take("u_ff"), voltages_of(0.6 * TARGET), rtol=1e-10)
        assert unit.notes == []


def test_a_transition_may_take_as_long_as_one_under_way(units: BuiltUnits) -> None:
    """While one takes 4000 s from end to end, the middle is in reach only as slowly; 0.1 s and many times are tried."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(y_target=TARGET, transition_time=4000.0).advance(200.0, y_target=-TARGET)
        unit.advance(200.0).advance(200.0).advance(200.0).advance(200.0).advance(200.0)
        u = trace(unit, 40, 100.0, y_target={0: 0 * TARGET}, transition_time={0: 0.1})[:, :4]  # type: ignore[dict-item]
        assert unit.take("target_refused", "moving").tolist() == [0.0, 0.0]
        assert 500.0 < unit.take("planned_time")[0] < 4000.0
        assert 950.0 < np.abs(u).max() <= 1001.0
        np.testing.assert_allclose(unit.take("y_ref"), 0.0, atol=1e-9)


def test_a_slot_is_free_when_the_preview_sees_the_end(units: BuiltUnits) -> None:
    """The ninth target takes the first one's slot at 0.95 s, its plan effect 125 samples later."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=1.0, preview=0.05)
        for k in range(8):
            unit.advance(0.1, y_target=TARGET * (k + 1) / 16)
        unit.advance(0.95 + PLANNING - 0.8, y_target=0.6 * TARGET, transition_time=0.9)
        assert unit.take("planned_time")[0] == 1.0
        assert unit.advance(2 * SAMPLE).take("planned_time")[0] == 0.9


def test_a_motion_ends_with_a_target_that_is_refused(units: BuiltUnits) -> None:
    """A longer preview sees the end in the step that refuses the next target."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=0.5, preview=0.0).advance(0.48, y_target=0.1 * TARGET)
        unit.advance(SAMPLE, preview=0.05, y_target=FAR)
        assert unit.take("target_refused", "moving").tolist() == [1.0, 0.0]
        np.testing.assert_allclose(unit.take("u_ff"), voltages_of(0.1 * TARGET), rtol=1e-12)


def test_a_target_refused_on_the_way_is_named_by_its_time(units: BuiltUnits) -> None:
    """That at which it was set, not that at which its search ended."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=0.9).advance(0.3, y_target=TARGET)
        unit.advance(0.1, voltage_limit=500.0, transition_time=3.0, y_target=0.3 * TARGET)
        assert unit.take("target_refused")[0] == 1
        [note] = unit.notes
        assert note.startswith("unit: y_target at 0.3 s is refused: it takes ")
        assert note.endswith(" V on the way, voltage_limit is 500.0 V; the target before is held")


def test_target_out_of_reach_is_held_with_one_warning(units: BuiltUnits) -> None:
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin()
        unit.advance(0.5, y_target=TARGET)
        unit.advance(0.3, y_target=FAR)
        peak = np.abs(voltages_of(FAR)).max()
        assert unit.notes == [
            f"unit: y_target at 0.5 s is refused: it takes {peak:.1f} V at rest, voltage_limit is "
            "1000.0 V; the target before is held"
        ]
        assert unit.take("target_refused")[0] == 1
        assert unit.take("planned_peak")[0] == pytest.approx(peak)
        for _ in range(5):
            unit.advance(0.3)
        np.testing.assert_allclose(unit.take("y_ref"), TARGET, atol=1e-9)
        assert len(unit.notes) == 1
        unit.advance(0.1, y_target=0.5 * TARGET)
        assert unit.take("target_refused", "moving").tolist() == [0.0, 1.0]
        unit.advance(2.0)
        np.testing.assert_allclose(unit.take("y_ref"), 0.5 * TARGET, atol=1e-9)


def test_first_target_out_of_reach_is_refused(units: BuiltUnits) -> None:
    peak = np.abs(voltages_of(FAR)).max()
    with (
        loaded(units("FlatnessFeedforward")) as unit,
        pytest.raises(
            UnitFailure, match=re.escape(f"out of reach: it takes {peak:.1f} V at rest, voltage_limit is 1000.0 V")
        ),
    ):
        unit.begin(y_target=FAR)


def test_a_target_that_takes_the_limit_itself_is_in_reach(units: BuiltUnits) -> None:
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin().advance(0.1, y_target=FAR)
        [peak] = unit.take("planned_peak")
        unit.call("reset")
        unit.begin(voltage_limit=peak, y_target=FAR)
        assert np.abs(unit.take("u_ff")).max() == peak
        unit.call("reset")
        with pytest.raises(UnitFailure, match="out of reach"):
            unit.begin(voltage_limit=np.nextafter(peak, 0), y_target=FAR)
        unit.call("reset")
        np.testing.assert_array_equal(unit.begin(y_target=TARGET).take("y_target"), TARGET)


def test_starts_at_rest_at_its_first_target(units: BuiltUnits) -> None:
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(y_target=TARGET)
        start = unit.take(*OUTPUTS)
        np.testing.assert_allclose(unit.take("u_ff"), voltages_of(TARGET), rtol=1e-12)
        np.testing.assert_allclose(unit.take("y_ref"), TARGET, atol=1e-9)
        np.testing.assert_array_equal(unit.advance(1.0).take(*OUTPUTS), start)
        assert unit.take("moving")[0] == 0


@pytest.mark.parametrize(("wanted", "share"), [(0.2, 1.0), (0.6, 1.2), (0.35, 0.5)])
@pytest.mark.slow
def test_fast_transition_is_stretched_to_the_limit(units: BuiltUnits, wanted: float, share: float) -> None:
    """Voltages stay within 0.1 % of the limit and come close to it; planned_peak and planned_time tell."""
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=wanted)
        u = trace(unit, 8000, 5e-4, y_target={0: TARGET * share})[:, :4]
        time, peak = unit.take("planned_time", "planned_peak")
        assert time > wanted
        assert f"is stretched from {wanted:.4g} s to {time:.4g} s to stay within 1000.0 V" in unit.notes[0]
        assert np.abs(u).max() <= 1001.0
        assert peak == pytest.approx(np.abs(u).max(), rel=5e-3)
        # A step of the planner's table shorter would break the limit
        shapes = design_of().arrays["shape_times"]
        with loaded(units("FlatnessFeedforward")) as faster:
            faster.begin(transition_time=time / (shapes[1] / shapes[0]) * 0.999, voltage_limit=1e4)
            assert np.abs(trace(faster, 4000, 5e-4, y_target={0: TARGET * share})[:, :4]).max() > 999.0


@pytest.mark.slow
def test_whole_motion_is_kept_within_the_limit(units: BuiltUnits) -> None:
    """Targets to and fro between the limits: each new transition is planned with what is still under way."""
    rng = np.random.default_rng(2)
    targets = {
        k: np.linalg.pinv(design_of().arrays["static_inverse"]) @ rng.uniform(-950, 950, 4) for k in range(0, 4000, 350)
    }
    with loaded(units("FlatnessFeedforward")) as unit:
        u = trace(unit.begin(transition_time=0.4), 7000, 1e-3, y_target=targets)[:, :4]
        assert unit.take("moving")[0] == 0
        assert any("stretched" in note for note in unit.notes)
    assert np.abs(u).max() <= 1001.0


def test_limits_of_a_pair(units: BuiltUnits) -> None:
    """Voltages at rest are about 817, -770, -807 and 781 V: refused at rest, stretched, and in reach again."""
    u = voltages_of(TARGET)
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(voltage_min=[-1e4, -700.0, -1e4, -1e4])
        unit.advance(0.1, y_target=TARGET)
        assert unit.notes == [
            f"unit: y_target at 0 s is refused: it takes {u[1]:.1f} V at rest, voltage_min[2] is -700.0 V; "
            "the target before is held"
        ]
        unit.advance(0.1, voltage_min=-1e4, transition_time=0.45, y_target=0.5 * TARGET)
        assert unit.take("planned_time")[0] < 0.5
        unit.advance(2.0, y_target=0.0).advance(2.0)
        unit.put("voltage_max", [1.05 * 0.5 * u[0], 30.0, 1e4, 1e4])
        moved = trace(unit, 2500, 1e-3, y_target={0: 0.5 * TARGET})[:, :4]
        time, peak = unit.take("planned_time", "planned_peak")
        assert unit.notes[-1].endswith(f"to {time:.4g} s to stay within voltage_max[1] = {1.05 * 0.5 * u[0]:.1f} V")
        assert moved.max(axis=0)[0] <= 1.05 * 0.5 * u[0] * 1.001
        assert moved.max(axis=0)[1] <= 30.0
        assert peak == pytest.approx(np.abs(moved).max(), rel=5e-3)


def test_first_target_beyond_the_limit_of_a_pair(units: BuiltUnits) -> None:
    """The limit itself is in reach; the voltage of a pair that may be high may not be low."""
    with loaded(units("FlatnessFeedforward")) as unit:
        [lowest] = unit.begin(y_target=TARGET).take("u_ff[2]")
        unit.call("reset")
        np.testing.assert_allclose(unit.begin(y_target=TARGET).take("u_ff[2]"), lowest)
        unit.call("reset")
        unit.begin(**{"voltage_min[2]": lowest}, y_target=TARGET)
        assert unit.take("u_ff[2]")[0] == lowest
        unit.call("reset")
        rule = re.escape(f"out of reach: it takes {lowest:.1f} V at rest, voltage_min[2] is {lowest:.1f} V")
        with pytest.raises(UnitFailure, match=rule):
            unit.begin(**{"voltage_min[2]": np.nextafter(lowest, 0)}, y_target=TARGET)
        unit.call("reset")
        with pytest.raises(UnitFailure, match=r"takes 781\.\d V at rest, voltage_max\[4\] is 0\.0 V"):
            unit.begin(**{"voltage_max[4]": 0.0}, y_target=TARGET)


@pytest.mark.parametrize("preview", [1e-3, 0.013])
def test_preview_shifts_the_outputs(units: BuiltUnits, preview: float) -> None:
    steps = round(preview / 1e-3)
    targets = {10: TARGET, 510: 0.3 * TARGET}
    folder = units("FlatnessFeedforward")
    with loaded(folder) as plain, loaded(folder) as ahead:
        later = trace(plain.begin(), 1600 + steps, 1e-3, y_target=targets)
        found = trace(ahead.begin(preview=preview), 1600, 1e-3, y_target=targets)
    # Up to a change of the target the preview knows nothing of it
    for start, stop in ((10, 510), (510 + steps, 1600)):
        assert_groups_close(found[start : stop - steps], later[start + steps : stop], 1e-11)


def test_parameters_can_be_tuned_between_transitions(units: BuiltUnits) -> None:
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=1.2)
        unit.advance(0.1, y_target=TARGET)
        assert unit.take("planned_time")[0] == 1.2
        unit.advance(0.1, transition_time=1.7, y_target=0.5 * TARGET)
        assert unit.take("planned_time")[0] == 1.7
        unit.advance(0.1, voltage_limit=500.0, y_target=0.9 * TARGET)
        assert unit.take("target_refused")[0] == 1
        unit.advance(0.1, voltage_limit=900.0, y_target=0.91 * TARGET)
        assert unit.take("target_refused")[0] == 0
        ahead = unit.take("y_ref")
        unit.advance(1e-6, preview=0.05)
        assert np.abs(unit.take("y_ref") - ahead).max() > 1e-6


def test_planned_voltages_are_those_put_out(units: BuiltUnits) -> None:
    """The planner's table against the series that the unit evaluates, along a superposed motion."""
    arrays = design_of().arrays
    with loaded(units("FlatnessFeedforward")) as unit:
        u = trace(unit.begin(), 2000, 1e-3, y_target={0: TARGET, 300: -0.2 * TARGET})[:, :4]
    first, second = voltages_of(TARGET), voltages_of(-1.2 * TARGET)
    motion = PendingTransitions(
        offset=np.zeros(4),
        starts=np.array([0.0, 0.3 + PLANNING]),
        durations=np.array([0.9, 0.9]),
        changes=np.array([first, second]),
    )
    planned = motion.voltage(
        InputShapes(times=arrays["shape_times"], values=arrays["shape_values"]), 1e-3 * np.arange(1, 2001)
    )
    assert np.abs(planned - u).max() < 1e-3 * np.abs(u).max()


def test_the_planned_peak_is_the_voltage_at_the_start_where_that_is_the_largest(units: BuiltUnits) -> None:
    """A motion from 817 V to rest goes on to the other side: by the planner's table at the tick of the new plan."""
    arrays = design_of().arrays
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(y_target=TARGET).advance(0.4, y_target=0 * TARGET).advance(0.05, y_target=-0.3 * TARGET)
        [peak] = unit.take("planned_peak")
    u = voltages_of(TARGET)
    motion = PendingTransitions(offset=u, starts=np.zeros(1), durations=np.full(1, 0.9), changes=-u[None])
    shapes = InputShapes(times=arrays["shape_times"], values=arrays["shape_values"])
    at_start = motion.voltage(shapes, np.array([0.4 + PLANNING]))
    assert peak == pytest.approx(np.abs(at_start).max(), rel=1e-9)
