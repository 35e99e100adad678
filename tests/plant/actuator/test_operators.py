"""Hysteresis, creep and amplifier: what the operators must obey, and their inverse."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexbeams.plant.actuator.amplifier import Channel, commanded, voltage_limit
from flexbeams.plant.actuator.inverse import Inverse, hysteresis_for, invert, voltage_for
from flexbeams.plant.actuator.operators import (
    Operators,
    broken_rule,
    hysteresis,
    move_plays,
    relax,
    start_from,
    superposition,
    through_dead_zones,
    with_creep,
)
from flexbeams.plant.basis import Array

SCALE = 1000.0  # V
STEP = 2e-4


def drawn(seed: int, channels: int = 1, plays: int = 9, zones: int = 5, creeps: int = 4) -> Operators:
    """Operators that break no rule, with sizes that differ."""
    rng = np.random.default_rng(seed)
    threshold = np.sort(rng.uniform(0.0, 900.0, (channels, plays)))
    threshold[:, 0] = 0.0
    weight = rng.uniform(0.0, 0.1, (channels, plays))
    weight[:, 0] = 0.6
    return Operators(
        play_threshold=threshold,
        play_weight=weight,
        dead_zone_threshold=np.sort(rng.uniform(-900.0, 900.0, (channels, zones))),
        dead_zone_slope=rng.uniform(-0.15, 0.15, (channels, zones)),
        creep_time=10.0 ** rng.uniform(-2, 3, (channels, creeps)),
        creep_weight=rng.uniform(0.0, 0.02, (channels, creeps)),
    )


class Patches:
    """The operators with their states; from the demagnetised one."""

    def __init__(self, operators: Operators) -> None:
        self.operators = operators
        self.plays = np.zeros_like(operators.play_weight)
        self.creeps = np.zeros_like(operators.creep_weight)

    def through(self, voltages: Array) -> Array:
        """h (n,) of the first channel after each voltage."""
        values = []
        for voltage in voltages:
            move_plays(self.operators, self.plays, np.array([voltage]))
            values.append(float(hysteresis(self.operators, self.plays)[0]))
        return np.array(values)

    def hold(self, voltage: Array, step: float) -> Array:
        """u_eff (channels,) at the end of a step."""
        move_plays(self.operators, self.plays, voltage)
        h = hysteresis(self.operators, self.plays)
        relax(self.operators, self.creeps, h, step)
        return with_creep(self.operators, self.creeps, h)


@pytest.mark.parametrize("seed", range(5))
def test_a_larger_loop_wipes_out_smaller_ones(seed: int) -> None:
    """After the same two extremes the state is the same, whatever smaller extremes came between."""
    rng = np.random.default_rng(seed)
    plain, detour = Patches(drawn(seed)), Patches(drawn(seed))
    plain.through(np.array([800.0, -850.0, 900.0]))
    detour.through(
        np.concatenate([[800.0], rng.uniform(-700.0, 700.0, 30), [-850.0], rng.uniform(-800, 800, 9), [900.0]])
    )
    np.testing.assert_allclose(plain.plays, detour.plays, rtol=0, atol=1e-12 * SCALE)


@pytest.mark.parametrize("seed", range(5))
def test_loops_between_the_same_voltages_are_congruent(seed: int) -> None:
    """Of the play operators: dead zones behind them deform a loop by where it lies."""
    path = np.concatenate([np.linspace(-200.0, 500.0, 50), np.linspace(500.0, -200.0, 50)])
    shapes, heights = [], []
    for before in ([900.0, -200.0], [-950.0, 600.0, -200.0]):
        patches = Patches(drawn(seed, zones=1))
        patches.operators = replace(patches.operators, dead_zone_slope=np.zeros((1, 1)))
        patches.through(np.array(before))
        loop = patches.through(path)
        shapes.append(loop - loop[0])
        heights.append(loop[0])
    assert abs(heights[0] - heights[1]) > 1.0
    np.testing.assert_allclose(shapes[0], shapes[1], rtol=0, atol=1e-12 * SCALE)


@pytest.mark.parametrize("seed", range(5))
def test_minor_loops_are_closed(seed: int) -> None:
    patches = Patches(drawn(seed))
    patches.through(np.array([900.0, -300.0]))
    before = patches.plays.copy()
    first = patches.through(np.array([-300.0, 400.0, -300.0]))
    assert first[1] - first[0] > 300.0
    np.testing.assert_allclose(patches.plays, before, rtol=0, atol=1e-12 * SCALE)


def test_hysteresis_does_not_depend_on_the_rate() -> None:
    """One step from extreme to extreme, or a thousand; creep off."""
    extremes = np.random.default_rng(3).uniform(-900.0, 900.0, 20)
    fast, slow = Patches(drawn(3)), Patches(drawn(3))
    expected = fast.through(extremes)
    path = np.concatenate([np.linspace(a, b, 1001)[1:] for a, b in zip([0.0, *extremes], extremes, strict=False)])
    np.testing.assert_allclose(slow.through(path)[999::1000], expected, rtol=0, atol=1e-12 * SCALE)


@pytest.mark.parametrize("seed", range(3))
def test_a_closed_loop_dissipates(seed: int) -> None:
    """The energy of a period, the integral of v du_eff, is positive once the states are periodic; also with creep."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-900.0, 900.0, 8)
    path = np.concatenate([np.linspace(a, b, 40)[1:] for a, b in zip(corners, np.roll(corners, -1), strict=True)])
    for step in (0.01, 1.0):
        patches = Patches(replace(drawn(seed), creep_time=np.array([[0.1, 0.3, 1.0, 3.0]])))
        for _ in range(10 if step < 0.1 else 3):
            u_eff = np.array([patches.hold(np.array([v]), step)[0] for v in path])
        v = (path + np.roll(path, 1)) / 2
        assert float(v @ (u_eff - np.roll(u_eff, 1))) > 0.01 * np.ptp(path) ** 2 * np.min(patches.operators.play_weight)


@pytest.mark.parametrize("kind", ["random", "slow", "fast", "noisy"])
@pytest.mark.parametrize("seed", range(3))
def test_compensator_and_actuator_are_the_identity(kind: str, seed: int) -> None:
    """After a common history, with a step that changes at times."""
    rng = np.random.default_rng(seed)
    k = np.arange(600)
    wanted = {
        "random": rng.uniform(-800, 800, (600, 3)),
        "slow": np.outer(800 * np.sin(k / 100), [1.0, -0.5, 0.7]),
        "fast": np.outer(800 * np.sin(2.0 * k), [1.0, -0.5, 0.7]),
        "noisy": np.outer(800 * np.sin(k / 50), [1.0, -0.5, 0.7]) + rng.normal(0, 5.0, (600, 3)),
    }[kind]
    operators = drawn(seed, channels=3)
    patches, copy = Patches(operators), Patches(operators)
    for each in (patches, copy):
        start_from(
            operators,
            np.array([[900.0, -300.0, 200.0], [0.0, 0.0, 0.0], [-700.0, 500.0, -1.0]]),
            each.plays,
            each.creeps,
        )
    inverse = invert(operators)
    for k, row in enumerate(wanted):
        step = STEP if k % 100 < 70 else 3e-2
        voltage = voltage_for(operators, inverse, copy.plays, hysteresis_for(operators, copy.creeps, row, step))
        copy.hold(voltage, step)
        np.testing.assert_allclose(patches.hold(voltage, step), row, rtol=0, atol=1e-9)


def test_the_inverse_is_that_of_the_published_formulas() -> None:
    """Kuhnen: w'_i = -w_i / (W_i W_{i-1}), r'_i = sum w_j (r_i - r_j), written out for two plays and one dead zone."""
    operators = Operators(
        play_threshold=np.array([[0.0, 100.0, 300.0]]),
        play_weight=np.array([[0.5, 0.2, 0.3]]),
        dead_zone_threshold=np.array([[50.0]]),
        dead_zone_slope=np.array([[0.25]]),
        creep_time=np.ones((1, 1)),
        creep_weight=np.zeros((1, 1)),
    )
    inverse = invert(operators)
    expected = Inverse(
        play_threshold=np.array([[0.0, 50.0, 0.5 * 300 + 0.2 * 200]]),
        play_weight=np.array([[2.0, -0.2 / (0.7 * 0.5), -0.3 / (1.0 * 0.7)]]),
        dead_zone_threshold=np.array([[50.0]]),
        dead_zone_slope=np.array([[-0.25 / 1.25]]),
    )
    for name in ("play_threshold", "play_weight", "dead_zone_threshold", "dead_zone_slope"):
        np.testing.assert_allclose(getattr(inverse, name), getattr(expected, name), rtol=1e-14)
    assert through_dead_zones(operators, np.array([90.0]))[0] == 90.0 + 0.25 * 40.0


def test_creep_grows_by_its_weight_in_each_decade() -> None:
    """Far from the first and the last time constant."""
    decades = 10.0 ** np.arange(-3.0, 6.0)[None, :]
    operators = replace(drawn(1), creep_time=decades, creep_weight=np.full_like(decades, 0.01))
    creeps = np.zeros_like(decades)
    h, seen = np.array([100.0]), []
    for step in np.diff(10.0 ** np.arange(-1.0, 3.1), prepend=0.0):
        relax(operators, creeps, h, float(step))
        seen.append(float(with_creep(operators, creeps, h)[0]))
    np.testing.assert_allclose(np.diff(seen), 1.0, rtol=2e-3)


@pytest.mark.parametrize(("lag", "slew_rate"), [(0.0, 0.0), (1e-2, 0.0), (0.0, 3e4), (1e-2, 3e4), (0.1, 1e3)])
def test_a_step_may_be_split_anyhow(lag: float, slew_rate: float) -> None:
    rng = np.random.default_rng(5)
    whole, split = channel(drawn(5)), channel(drawn(5))
    for _ in range(40):
        command, step = float(rng.uniform(-900, 900)), float(rng.choice([1e-4, 3e-3, 0.05]))
        whole.follow(command, lag, slew_rate, step)
        for part in rng.dirichlet(np.ones(7)):
            split.follow(command, lag, slew_rate, step * part)
    assert abs(whole.voltage - split.voltage) < 1e-12 * SCALE
    np.testing.assert_allclose(whole.plays, split.plays, rtol=0, atol=1e-12 * SCALE)
    np.testing.assert_allclose(whole.creeps, split.creeps, rtol=0, atol=1e-12 * SCALE)


def channel(operators: Operators) -> Channel:
    patches = Patches(operators)
    return Channel(operators=operators, plays=patches.plays, creeps=patches.creeps, voltage=0.0)


@pytest.mark.parametrize(("lag", "slew_rate"), [(1e-2, 0.0), (1e-2, 3e4), (0.1, 1e3)])
def test_the_amplifier_solves_its_equation(lag: float, slew_rate: float) -> None:
    """v' = clip((command - v) / lag), creep driven by h(v), beside an integrator with tight tolerances."""
    operators = replace(drawn(6), creep_time=np.array([[3e-3, 1e-2, 0.1, 5.0]]))
    exact, states = channel(operators), Patches(operators)
    for command, step in ((700.0, 0.03), (-400.0, 0.05), (100.0, 0.004)):
        before = exact.voltage
        start = np.array([before, *exact.creeps[0]])

        def slope(_: float, x: Array, command: float = command) -> Array:
            rate = (command - x[0]) / lag
            rate = np.clip(rate, -slew_rate, slew_rate) if slew_rate else rate
            plays = states.plays.copy()
            move_plays(operators, plays, x[:1])
            return np.array([rate, *((hysteresis(operators, plays)[0] - x[1:]) / operators.creep_time[0])])

        end = solve_ivp(slope, (0.0, step), start, rtol=1e-9, atol=1e-9, max_step=step / 400).y[:, -1]
        exact.follow(command, lag, slew_rate, step)
        states.plays[:] = exact.plays
        np.testing.assert_allclose([exact.voltage, *exact.creeps[0]], end, rtol=0, atol=1e-4)


def test_commands_are_rounded_and_limited() -> None:
    limit = voltage_limit(np.array([-500.0, -500.0]), np.array([1500.0, 1500.0]), np.array([500.0, 400.0]))
    np.testing.assert_array_equal(limit, [1000.0, 900.0])
    resolution = np.array([0.0, 2.5])
    np.testing.assert_array_equal(commanded(np.array([3.2, 3.2]), limit, resolution), [3.2, 2.5])
    np.testing.assert_array_equal(commanded(np.array([-1000.1, 1e4]), limit, resolution), [-1000.0, 900.0])


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            {"play_threshold": np.array([[0.0, 200.0, 100.0]]), "play_weight": np.array([[0.5, 0.1, 0.1]])},
            r"play_threshold\[0, 1\] must be >= 200.0, the threshold before, got 100.0",
        ),
        (
            {"dead_zone_threshold": np.array([[-5.0, 5.0, 9.0]]), "dead_zone_slope": np.array([[0.0, -0.5, -0.5]])},
            r"dead_zone_slope\[0, 2\] must leave the sum of slopes 1 \+ ... beyond its threshold > 0, .* sum of 0.0",
        ),
        (
            {"dead_zone_threshold": np.array([[-9.0, -5.0]]), "dead_zone_slope": np.array([[-0.7, -0.4]])},
            r"dead_zone_slope\[0, 0\] must leave .* got a sum of -0.09999999999999998",
        ),
    ],
)
def test_what_has_no_inverse_is_named(change: dict[str, Array], line: str) -> None:
    rule = broken_rule(replace(drawn(1), **change), lambda key, k, j: f"{key}[{k}, {j}]")
    assert rule is not None
    assert re.match(line, rule), rule
    assert broken_rule(drawn(1), lambda key, k, j: key) is None


def test_the_rest_after_a_history() -> None:
    """Creep has settled, and repeated voltages change nothing."""
    operators = drawn(7, channels=2)
    one, two = Patches(operators), Patches(operators)
    last = start_from(operators, np.array([[500.0, -100.0], [0.0, 300.0]]), one.plays, one.creeps)
    start_from(operators, np.array([[500.0, 500.0, -100.0, -100.0], [0.0, 300.0, 300.0, 300.0]]), two.plays, two.creeps)
    np.testing.assert_array_equal(last, [-100.0, 300.0])
    np.testing.assert_array_equal(one.plays, two.plays)
    before = with_creep(operators, one.creeps, hysteresis(operators, one.plays))
    np.testing.assert_array_equal(one.hold(last, 100.0), before)
    assert superposition(operators, one.plays).shape == (2,)
