"""Plans within the voltage limit, against the exact voltages of the motion that comes out."""

from functools import cache

import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.planner import InputShapes, PendingTransitions, plan_transition, sample_grid
from flexbeams.controller.voltage_limits import VoltageLimits
from flexbeams.plant.basis import Array
from flexbeams.plant.structure import find_structure, read_structure
from tests.oracles.examples import five_beams
from tests.oracles.flat_series import factorials, flat_series
from tests.oracles.gevrey import taylor_coefficients_at

STRUCTURES = {"kiel": read_structure(find_structure("kiel")), "five": five_beams()}
LIMIT = 1000.0
GOAL = np.array([817.0, -770.0, -807.0, 781.0])  # V (48)


@cache
def design(name: str = "kiel", gevrey_order: float = 1.9) -> Design:
    """The design of a structure."""
    return compute_design(STRUCTURES[name], DesignOptions(gevrey_order=gevrey_order))


def shapes(made: Design) -> InputShapes:
    """The planner's table of a design."""
    return InputShapes(times=made.arrays["shape_times"], values=made.arrays["shape_values"])


def at_rest(offset: Array) -> PendingTransitions:
    """No transition under way."""
    return PendingTransitions(
        offset=offset, starts=np.zeros(0), durations=np.zeros(0), changes=np.zeros((0, len(offset)))
    )


def voltages(made: Design, motion: PendingTransitions, time: Array) -> Array:
    """u* (k, n_u) at time (k,), from D_u and closed forms of Theta's derivatives."""
    c, _ = flat_series(made.arrays["A"], made.arrays["B"])
    u, degree = np.tile(motion.offset, (len(time), 1)), len(c) - 1
    for start, duration, step in zip(motion.starts, motion.durations, motion.changes, strict=True):
        tau = np.clip((time - start) / duration, 0, 1)
        series = taylor_coefficients_at(made.options.gevrey_order, tau, degree)
        u += np.outer(series @ (c * factorials(degree) / duration ** np.arange(degree + 1)), step)
    return u


def limits(lowest: list[float], highest: list[float]) -> VoltageLimits:
    return VoltageLimits(lowest=np.array(lowest), highest=np.array(highest))


def peak(made: Design, motion: PendingTransitions, now: float) -> float:
    """Largest |u*| from `now` on, looked at 1000 times in each transition, closer at its ends."""
    time = np.unique(motion.starts[:, None] + np.outer(motion.durations, sample_grid(1000)))
    return float(np.max(np.abs(voltages(made, motion, time[time >= now]))))


@pytest.mark.parametrize(("name", "gevrey_order"), [("kiel", 1.9), ("kiel", 1 + 1 / 1.9), ("five", 1.9)])
def test_table(name: str, gevrey_order: float) -> None:
    """Midway between tabulated durations the peak is met or passed by up to 10 %, by 1 % where it is below 1.3."""
    made = design(name, gevrey_order)
    table, n_u = shapes(made), made.arrays["B"].shape[1]
    for duration in table.times[[0, 3, 7, 12, 20]] * 1.027:
        one = at_rest(np.zeros(n_u)).with_transition(0.0, float(duration), np.ones(n_u))
        exact, found = (
            voltages(made, one, duration * sample_grid(2000))[:, 0],
            table.at(float(duration), sample_grid(2000)),
        )
        top = np.max(np.abs(exact))
        assert top * (1 - 1e-3) <= np.max(np.abs(found)) <= top * (1.1 if top > 1.3 else 1.01)
        if top < 1.3:
            assert np.max(np.abs(found - exact)) < 0.02 * top


def test_table_at_its_own_places_and_beyond_its_ends() -> None:
    table = shapes(design())
    tau = sample_grid(table.values.shape[1] - 1)
    np.testing.assert_allclose(table.at(float(table.times[7]), tau), table.values[7], rtol=1e-12, atol=1e-300)
    np.testing.assert_allclose(table.at(float(table.times[-1]), tau), table.values[-1], rtol=1e-12, atol=1e-300)
    np.testing.assert_array_equal(table.at(1e6, tau), table.at(float(table.times[-1]), tau))
    np.testing.assert_array_equal(table.at(0.9, np.array([0.0, 1.0])), [0.0, 1.0])


def test_a_transition_that_fits_takes_the_wanted_time() -> None:
    plan = plan_transition(at_rest(np.zeros(4)), shapes(design()), now=3.0, change=GOAL, requested=0.9, limit=LIMIT)
    assert (plan.duration, plan.peak_at_rest) == (0.9, 817.0)
    assert plan.peak == pytest.approx(817.0, rel=1e-12)


@pytest.mark.parametrize(("wanted", "scale"), [(0.5, 1.0), (0.45, 0.8), (0.4, 0.6), (0.5, 1.2), (0.05, 0.1)])
def test_a_transition_over_the_limit_is_stretched_as_little_as_needed(wanted: float, scale: float) -> None:
    made = design()
    step = GOAL * scale
    plan = plan_transition(at_rest(np.zeros(4)), shapes(made), now=0.0, change=step, requested=wanted, limit=LIMIT)
    assert plan.duration > wanted
    assert plan.peak_at_rest == pytest.approx(817 * scale)
    motion = at_rest(np.zeros(4)).with_transition(0.0, plan.duration, step)
    exact = peak(made, motion, 0.0)
    assert exact <= LIMIT * (1 + 2e-3)
    assert plan.peak == pytest.approx(exact, rel=0.03)
    shorter = at_rest(np.zeros(4)).with_transition(0.0, plan.duration / 1.06, step)
    if plan.duration > shapes(made).times[0]:
        assert peak(made, shorter, 0.0) > LIMIT


@pytest.mark.parametrize(("name", "gevrey_order"), [("kiel", 1.9), ("kiel", 1 + 1 / 1.9), ("five", 1.9)])
def test_every_plan_while_moving_keeps_the_limit(name: str, gevrey_order: float) -> None:
    """Random targets, some nearly out of reach, each in the midst of the motion before; plans hold from now on."""
    made = design(name, gevrey_order)
    n_u, generator = made.arrays["B"].shape[1], np.random.default_rng(8)
    stretched = 0
    for _ in range(5):
        motion, now = at_rest(300 * generator.uniform(-1, 1, size=(n_u,))), 0.0
        for _ in range(3):
            goal = generator.uniform(-1, 1, n_u) * 10 ** generator.uniform(1.5, 2.99)
            step = goal - motion.offset - motion.changes.sum(axis=0)
            wanted = float(10 ** generator.uniform(-0.7, 0.3))
            plan = plan_transition(motion, shapes(made), now=now, change=step, requested=wanted, limit=LIMIT)
            if plan.duration == 0:
                break
            assert plan.duration >= wanted
            stretched += plan.duration > max(wanted, shapes(made).times[0])
            motion = motion.with_transition(now, plan.duration, step)
            assert peak(made, motion, now) <= LIMIT * (1 + 2e-3)
            now += plan.duration * generator.uniform(0.05, 0.9)
    assert stretched > 1


def test_a_plan_sees_what_is_still_under_way() -> None:
    """From rest at the first target the second takes 0.59 s; on top of the first's overshoot that breaks the limit."""
    made = design()
    first = at_rest(np.zeros(4)).with_transition(0.0, 0.46, np.array([400.0, 0, 0, 0]))
    step = np.array([550.0, 0, 0, 0])
    later = plan_transition(at_rest(first.changes[0]), shapes(made), now=0.1, change=step, requested=0.5, limit=LIMIT)
    assert peak(made, first.with_transition(0.1, later.duration, step), 0.1) > 1.2 * LIMIT
    plan = plan_transition(first, shapes(made), now=0.1, change=step, requested=0.5, limit=LIMIT)
    assert plan.duration > 2 * later.duration > 0
    assert peak(made, first.with_transition(0.1, plan.duration, step), 0.1) <= LIMIT * (1 + 2e-3)


def test_transitions_add_without_a_jump() -> None:
    """Retargeted in mid-motion the voltages between two samples move no more than a smooth motion's do."""
    made = design()
    first = at_rest(np.zeros(4)).with_transition(0.0, 0.9, GOAL)
    both = first.with_transition(0.4, 0.9, -0.5 * GOAL)
    time = np.arange(0.0, 1.6, 2e-4)
    u = voltages(made, both, time)
    np.testing.assert_array_equal(u[time <= 0.4], voltages(made, first, time[time <= 0.4]))
    np.testing.assert_allclose(u[-1], 0.5 * GOAL, rtol=1e-12)
    assert np.max(np.abs(np.diff(u, axis=0))) < 2 * np.max(np.abs(np.diff(voltages(made, first, time), axis=0)))
    np.testing.assert_allclose(both.voltage(shapes(made), time), u, rtol=0, atol=2e-3 * np.abs(u).max())


def test_a_target_out_of_reach_at_rest_is_refused_with_its_voltage() -> None:
    plan = plan_transition(
        at_rest(np.zeros(4)), shapes(design()), now=0.0, change=1.3 * GOAL, requested=0.9, limit=LIMIT
    )
    assert plan.duration == 0
    assert plan.peak == plan.peak_at_rest == pytest.approx(1.3 * 817)


def test_the_way_back_from_a_target_at_the_limit_is_planned() -> None:
    """At rest on the limit itself, and away from it again."""
    edge = LIMIT * GOAL / 817
    plan = plan_transition(at_rest(np.zeros(4)), shapes(design()), now=0.0, change=edge, requested=0.9, limit=LIMIT)
    assert plan.duration > 0
    plan = plan_transition(at_rest(edge), shapes(design()), now=0.0, change=-edge, requested=0.9, limit=LIMIT)
    assert plan.duration > 0


def test_a_motion_that_breaks_the_limit_anyway_is_refused_on_its_way() -> None:
    """The transition under way passes a limit lowered meanwhile; the target itself would be within it."""
    first = at_rest(np.zeros(4)).with_transition(0.0, 0.9, GOAL)
    plan = plan_transition(first, shapes(design()), now=0.8, change=-0.9 * GOAL, requested=0.9, limit=700.0)
    assert plan.duration == 0
    assert plan.peak > 700
    assert plan.peak_at_rest == pytest.approx(81.7)


def test_the_way_back_from_beyond_a_lowered_limit_is_planned() -> None:
    """It starts beyond the limit and goes no further; a target beyond the limit stays refused."""
    rest = at_rest(GOAL)
    plan = plan_transition(rest, shapes(design()), now=3.0, change=-0.9 * GOAL, requested=0.9, limit=400.0)
    assert plan.duration == 0.9
    assert plan.peak == pytest.approx(817)
    assert (
        plan_transition(rest, shapes(design()), now=3.0, change=-0.4 * GOAL, requested=0.9, limit=400.0).duration == 0
    )


def test_shortest_transition_is_the_tables() -> None:
    plan = plan_transition(
        at_rest(np.zeros(4)), shapes(design()), now=0.0, change=1e-6 * GOAL, requested=1e-3, limit=LIMIT
    )
    assert plan.duration == shapes(design()).times[0]


def extremes(made: Design, motion: PendingTransitions, now: float) -> tuple[Array, Array]:
    """Lowest and highest u* of each pair from `now` on, looked at as in `peak`."""
    time = np.unique(motion.starts[:, None] + np.outer(motion.durations, sample_grid(1000)))
    u = voltages(made, motion, time[time >= now])
    return u.min(axis=0), u.max(axis=0)


@pytest.mark.parametrize("pair", range(4))
def test_the_limit_of_one_pair_stretches_the_transition_for_all(pair: int) -> None:
    """A limit 5 % above what a pair needs at rest, on the side to which it moves; on the other side 2 % are enough."""
    made, step = design(), 0.5 * GOAL
    free = plan_transition(at_rest(np.zeros(4)), shapes(made), now=0.0, change=step, requested=0.4, limit=LIMIT)
    one, other = [-1000.0] * 4, [1000.0] * 4
    (other if step[pair] > 0 else one)[pair] = 1.05 * step[pair]
    narrow = limits(one, other)
    plan = plan_transition(at_rest(np.zeros(4)), shapes(made), now=0.0, change=step, requested=0.4, limit=narrow)
    assert plan.duration > free.duration > 0
    assert (plan.violation.pair, plan.violation.is_below) == (pair, bool(step[pair] < 0))
    lowest, highest = extremes(made, at_rest(np.zeros(4)).with_transition(0.0, plan.duration, step), 0.0)
    assert np.all(lowest >= narrow.lowest * (1 + 2e-3))
    assert np.all(highest <= narrow.highest * (1 + 2e-3))
    shorter = at_rest(np.zeros(4)).with_transition(0.0, plan.duration / 1.06, step)
    assert narrow.furthest_beyond(*extremes(made, shorter, 0.0)).excess > 0
    (one if step[pair] > 0 else other)[pair] = -0.02 * step[pair]
    same = plan_transition(at_rest(np.zeros(4)), shapes(made), now=0.0, change=step, requested=0.9, limit=narrow)
    assert same.duration == pytest.approx(max(0.9, plan.duration), rel=0.06)


def test_every_plan_keeps_limits_of_its_own_for_each_pair() -> None:
    """Random limits around zero and random targets within them, each in the midst of the motion before."""
    made, generator = design(), np.random.default_rng(11)
    stretched = 0
    for _ in range(6):
        within = limits(list(-generator.uniform(50, 900, 4)), list(generator.uniform(50, 900, 4)))
        motion, now = at_rest(np.zeros(4)), 0.0
        for _ in range(3):
            goal = within.lowest + (within.highest - within.lowest) * generator.uniform(0.03, 0.97, 4)
            step = goal - motion.offset - motion.changes.sum(axis=0)
            wanted = float(10 ** generator.uniform(-0.7, 0.3))
            plan = plan_transition(motion, shapes(made), now=now, change=step, requested=wanted, limit=within)
            if plan.duration == 0:
                assert not plan.at_rest
                break
            stretched += plan.duration > max(wanted, shapes(made).times[0])
            motion = motion.with_transition(now, plan.duration, step)
            assert within.furthest_beyond(*extremes(made, motion, now)).excess < 2e-3 * 900
            now += plan.duration * generator.uniform(0.05, 0.9)
    assert stretched > 3


def test_a_target_beyond_one_pairs_limit_is_refused_with_that_pair() -> None:
    """On the side of its sign only; the limit itself is within."""
    table, rest = shapes(design()), at_rest(np.zeros(4))
    narrow = limits([-1000.0, -700.0, -1000.0, -50.0], [1000.0, 50.0, 1000.0, 1000.0])
    plan = plan_transition(rest, table, now=0.0, change=GOAL, requested=0.9, limit=narrow)
    assert (plan.duration, plan.at_rest, plan.violation.pair, plan.violation.is_below) == (0.0, True, 1, True)
    assert (plan.violation.voltage, plan.violation.excess) == (-770.0, 70.0)
    edge = limits([-1000.0, -770.0, -1000.0, -50.0], [1000.0, 50.0, 1000.0, 1000.0])
    assert plan_transition(rest, table, now=0.0, change=GOAL, requested=2.0, limit=edge).duration >= 2.0
    assert plan_transition(rest, table, now=0.0, change=-0.1 * GOAL, requested=0.9, limit=edge).at_rest


def test_a_pair_beyond_its_narrowed_limit_gives_the_others_no_leave() -> None:
    """Pair 1 rests at 817 V beyond 400 V; pair 2, at -770 V within its limits, must keep those."""
    narrow = limits([-1000.0] * 4, [400.0, 1000.0, 1000.0, 1000.0])
    wide = narrow.containing(GOAL)
    assert (wide.lowest.tolist(), wide.highest.tolist()) == ([-1000.0] * 4, [817.0, 1000.0, 1000.0, 1000.0])
    plan = plan_transition(at_rest(GOAL), shapes(design()), now=3.0, change=-0.9 * GOAL, requested=0.9, limit=narrow)
    assert (plan.duration, plan.peak) == (0.9, pytest.approx(817))


def test_a_pair_that_may_not_move_at_all() -> None:
    still = limits([-1000.0, 0.0, -1000.0, -1000.0], [1000.0, 0.0, 1000.0, 1000.0])
    table, rest, change = shapes(design()), at_rest(np.zeros(4)), np.array([500.0, 0.0, -400.0, 300.0])
    assert plan_transition(rest, table, now=0.0, change=change, requested=0.9, limit=still).duration == 0.9
    change[1] = 1e-3
    assert plan_transition(rest, table, now=0.0, change=change, requested=0.9, limit=still).at_rest
