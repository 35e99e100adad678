"""Random histories of each unit: what a reset, a restored state or a refusal leaves behind is nothing.

An instance lives through steps, new inputs, switched parameters, saved and restored states, resets, refusals and new
set-ups. Of these its story keeps what should matter: the last set-up and, from there or from the saved state, every
value set and every step. A fresh instance that goes through the story alone must agree with it bit for bit, as must one
in another process that goes on from a saved state. The same history gives the same values from the C and from the
Python kernel.

FLEXBEAMS_CALLS=10000000 goes on with further histories until each unit has had so many FMI calls.
"""

import os
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description

from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import Workshop, design_of
from tests.native.workshop import native_folder, needs_zig
from tests.units.copies import Case, Story, in_second_process, replay
from tests.units.loaded import Loaded, Real, loaded

LENGTH = 80  # actions of a history
SEEDS = (1, 2, 3, 4, 5)
CALLS = int(float(os.environ.get("FLEXBEAMS_CALLS", "0")))
STARTS = (0.0, 3.0, -1e9, 1.7e9)  # s


@dataclass(frozen=True, kw_only=True)
class Profile:
    """What a unit can be made to do; values are drawn by functions of a random generator."""

    steps: Sequence[float]  # s
    starts: dict[str, Callable[[np.random.Generator], Any]]  # before the initialisation
    values: dict[str, Callable[[np.random.Generator], Any]]  # at any time
    refused: Sequence[tuple[str, float]]  # by fmi2SetXXX, at any time
    impossible: Sequence[dict[str, float]] = ()  # refused when the initialisation ends
    burst: str = ""  # an input that is changed at ten steps in a row
    moving: str = ""  # an output that tells whether a motion is under way
    kernels: float = 1e-12  # largest difference of the C and the Python kernel, of the largest value of a variable


def uniform(low: float, high: float) -> Callable[[np.random.Generator], float]:
    return lambda rng: float(rng.uniform(low, high))


def normal(scale: float, size: int) -> Callable[[np.random.Generator], Real]:
    return lambda rng: rng.normal(0.0, scale, size)


def switch(rng: np.random.Generator) -> bool:
    return bool(rng.integers(2))


def spiked(rng: np.random.Generator) -> Real:
    """Strains, one of them absurd three times of ten."""
    strains = rng.normal(0.0, 3e-5, 6)
    if rng.uniform() < 0.3:
        strains[rng.integers(6)] = rng.choice([0.2, -1e308])
    return strains


def target(rng: np.random.Generator) -> Real:
    """Reachable nine times of ten."""
    voltages = rng.uniform(-700.0, 700.0, 4) * (5.0 if rng.uniform() < 0.1 else 1.0)
    return np.asarray(statics() @ voltages)


@cache
def statics() -> Real:
    """Deflections of the points of interest at rest under voltages."""
    return np.asarray(np.linalg.pinv(design_of().arrays["static_inverse"]))


PROFILES = {
    "BeamPlant": Profile(
        steps=(2e-4, 1e-3, 7e-5, 0.02),
        starts={
            "beam[1].density": uniform(1500.0, 3000.0),
            "beam[2].youngs_modulus": uniform(2e10, 6e10),
            "spring[1].stiffness": uniform(5.0, 20.0),
            "strain_noise_std": uniform(0.0, 1e-6),
            "noise_seed": lambda rng: int(rng.integers(1, 99)),
            "start_at_rest_under": normal(300.0, 4),
        },
        values={"u": normal(300.0, 4), "force": normal(0.05, 3)},
        refused=[("u[2]", np.nan), ("u[1]", 1e308), ("force[3]", -1e308), ("beam[1].density", 0.0), ("noise_seed", -1)],
    ),
    "FlatnessFeedforward": Profile(
        steps=(2e-4, 1e-3, 0.05, 0.31),
        starts={"preview": uniform(0.0, 0.02), "transition_time": uniform(0.2, 1.0)},
        values={
            "y_target": target,
            "transition_time": uniform(0.1, 1.2),
            "voltage_limit": uniform(700.0, 1100.0),
            "voltage_min": lambda rng: -rng.uniform(500.0, 1200.0, 4),
            "voltage_max": lambda rng: rng.uniform(500.0, 1200.0, 4),
            "preview": uniform(0.0, 0.1),
        },
        refused=[("y_target[1]", np.inf), ("y_target[2]", 1e308), ("transition_time", 1e-4), ("voltage_limit", -1.0)]
        + [("voltage_min[2]", 1.0), ("voltage_max[4]", -1.0)],
        impossible=[{"voltage_limit": 12.5, "y_target": -2e-3}, {"voltage_max": 12.5, "y_target": -2e-3}],
        burst="y_target",
        moving="moving",
        kernels=1e-11,  # states are sums of up to 30 derivatives that cancel
    ),
    "TrackingController": Profile(
        steps=(2e-4, 1e-3, 5e-5, 7e-4),
        starts={"u_ff": normal(300.0, 4), "x_ref": normal(1e-2, 30), "integral_gain": uniform(0.0, 1e-3)},
        values={
            "y_pm": spiked,
            "u_ff": normal(400.0, 4),
            "x_ref": normal(1e-2, 30),
            "feedback": switch,
            "integral_gain": uniform(0.0, 1e-3),
            "voltage_limit": uniform(300.0, 1000.0),
            "voltage_min": lambda rng: -rng.uniform(0.0, 600.0, 4),
            "voltage_max[3]": uniform(0.0, 600.0),
            "strain_limit": uniform(1e-4, 0.1),
        },
        refused=[
            ("y_pm[3]", np.nan),
            ("u_ff[1]", 1e308),
            ("x_ref[7]", -1e308),
            ("integral_gain", 1.5),
            ("voltage_limit", -1.0),
            ("voltage_min[1]", 1e-3),
            ("voltage_max[2]", np.nan),
        ],
    ),
}
_PATCHES: dict[str, Callable[[np.random.Generator], Any]] = {
    "linear_weight": uniform(0.4, 0.8),
    "play_weight": uniform(0.0, 0.2),
    "play_threshold[1,7]": uniform(600.0, 900.0),
    "dead_zone_slope": uniform(-0.4, 0.1),
    "dead_zone_threshold[1,2]": lambda rng: float(rng.choice([-200.0, 0.0, 500.0])),
    "dead_zone_threshold[2,1]": lambda rng: float(rng.choice([-400.0, 0.0, 500.0])),
    "creep_weight": uniform(0.0, 0.05),
    "creep_time[2,1]": uniform(1e-4, 1e3),
    "history[1,4]": uniform(-900.0, 900.0),
    "history[2,2]": uniform(-900.0, 900.0),
    "supply": uniform(400.0, 600.0),
}
PROFILES["MfcActuator"] = Profile(
    steps=(2e-4, 1e-3, 7e-5, 0.3),
    starts={
        **_PATCHES,
        "lag": lambda rng: float(rng.choice([0.0, 1e-3])),
        "slew_rate": lambda rng: float(rng.choice([0.0, 1e5])),
        "resolution[3]": uniform(0.0, 5.0),
    },
    values={"u": normal(500.0, 4)},
    refused=[("u[2]", np.nan), ("u[1]", 1e308), ("lag[1]", -1e-3), ("play_weight[1,2]", -0.1)],
    impossible=[{"dead_zone_slope": -1.5}, {"play_threshold[2,3]": 10.0}, {"supply": 1600.0}, {"history": 1100.0}],
)
PROFILES["MfcCompensator"] = Profile(
    steps=(2e-4, 1e-3, 7e-5, 0.3),
    starts=_PATCHES,
    values={"u_eff": normal(500.0, 4)},
    refused=[("u_eff[2]", np.nan), ("u_eff[1]", 1e308), ("creep_time[1,1]", 0.0), ("linear_weight[1]", 0.0)],
    impossible=[{"dead_zone_slope[1,2]": -1.0}, {"play_threshold[2,3]": 10.0}, {"face_maximum[2]": 300.0}],
)
PROFILES["BeamClosedLoop"] = Profile(
    steps=(2e-4, 1e-3, 0.01),
    starts={f"plant.{n}": v for n, v in PROFILES["BeamPlant"].starts.items() if "rest" not in n}
    | {"feedforward.transition_time": uniform(0.02, 0.05)},
    values={
        "y_target": lambda rng: 1e-3 * target(rng),
        "force": normal(0.05, 3),
        "controller.feedback": switch,
        "controller.integral_gain": uniform(0.0, 1e-3),
        "controller.voltage_max": lambda rng: rng.uniform(0.0, 300.0, 4),
        "feedforward.voltage_limit": uniform(700.0, 1100.0),
        "feedforward.voltage_min[1]": uniform(-1100.0, -500.0),
    },
    refused=[("force[1]", np.nan), ("controller.integral_gain", 1.5), ("feedforward.transition_time", 1e-4)],
    impossible=[{"feedforward.voltage_limit": 12.5, "y_target": -2e-3}],
    burst="y_target",
    moving="moving",
)


@dataclass
class Life:
    """An instance, its random history, and the story that should explain what it shows."""

    unit: Loaded
    profile: Profile
    rng: np.random.Generator
    story: Story = field(default_factory=list)
    saved: list[tuple[bytes, float, Story]] = field(default_factory=list)
    open: list[Case] = field(default_factory=list)  # saved states, and what has happened since
    copies: list[tuple[Case, Real]] = field(default_factory=list)  # the same, and every value at the end

    def act(self, action: str, value: Any) -> None:
        replay(self.unit, [(action, value)])
        self.story.append((action, value))
        for _, _, since in self.open:
            since.append((action, value))

    def end_copies(self) -> None:
        """Before what a copy of the instance does not go through."""
        if self.open:
            self.copies += [(case, self.unit.everything()) for case in self.open]
            self.open = []

    def drawn(self, some: dict[str, Callable[[np.random.Generator], Any]]) -> dict[str, Any]:
        return {name: draw(self.rng) for name, draw in some.items() if self.rng.uniform() < 0.5}

    def begin(self) -> None:
        """From a reset instance; at 0 or at another start time."""
        self.story, self.open = [], []
        self.act("begin", (self.one_of(STARTS), self.drawn(self.profile.starts)))

    def one_of(self, values: Sequence[float]) -> float:
        return values[self.rng.integers(len(values))]

    def step(self) -> None:
        self.act("step", self.one_of(self.profile.steps))

    def change(self) -> None:
        for name, value in self.drawn(self.profile.values).items():
            self.act(name, value)

    def burst(self) -> None:
        """More transitions than the unit holds."""
        for _ in range(10 if self.profile.burst else 0):
            self.act(self.profile.burst, self.profile.values[self.profile.burst](self.rng))
            self.step()

    def save(self) -> None:
        self.saved.append((self.unit.saved(), self.unit.now, list(self.story)))
        self.open.append((*self.saved[-1][:2], []))

    def restore(self) -> None:
        """A state from any time, read before the next step."""
        if not self.saved:
            self.save()
            self.step()
        content, now, story = self.saved[self.rng.integers(len(self.saved))]
        self.end_copies()
        self.unit.restore(content).now = now  # the host's sum of steps
        self.story = list(story)

    def restore_after_reset(self) -> None:
        self.save()
        self.end_copies()
        self.unit.call("reset")
        self.restore()

    def restore_into_initialisation(self) -> None:
        """A state from before the end of the initialisation, after some steps."""
        values = self.drawn(self.profile.starts)
        self.end_copies()
        self.unit.call("reset")
        early = self.unit.prepare(**values).saved()
        self.unit.call("exitInitializationMode")
        self.change()
        self.step()
        self.unit.restore(early).call("exitInitializationMode")
        self.story = [("begin", (0.0, values))]

    def reset(self) -> None:
        self.end_copies()
        self.unit.call("reset")
        self.begin()

    def refuse(self) -> None:
        """A value that no call may take, which does no harm; half of the time a new set-up."""
        name, value = self.profile.refused[self.rng.integers(len(self.profile.refused))]
        with pytest.raises(UnitFailure):
            self.unit.put(name, value)
        if self.rng.uniform() < 0.5:
            self.reset()

    def refuse_step(self) -> None:
        """One that is skipped, repeated or longer than any; then another state."""
        length = self.one_of(self.profile.steps)
        shift, factor = [(5.0, 1.0), (-1.0, 1.0), (0.0, 1e9)][self.rng.integers(3)]
        self.end_copies()
        with pytest.raises(UnitFailure, match=r"communicationStepSize|currentCommunicationPoint"):
            self.unit.step(self.unit.now + shift * length, factor * length)
        self.restore() if self.saved else self.reset()

    def look(self) -> None:
        """Getters that are refused, and derivatives: these change nothing."""
        with pytest.raises(UnitFailure):
            self.unit.call("getReal", [10**6])
        if self.unit.description.coSimulation.providesDirectionalDerivative:
            real = [v for v in self.unit.variables.values() if v.type == "Real"]
            unknowns = [v.valueReference for v in real if v.causality == "output"]
            knowns = [v.valueReference for v in real if v.causality == "input"]
            assert not any(self.unit.call("getDirectionalDerivative", unknowns, knowns, [1.0] * len(knowns)))

    def refuse_start(self) -> None:
        """Values that only the end of the initialisation can refuse; then the set-up from before."""
        if self.profile.impossible:
            values = self.profile.impossible[self.rng.integers(len(self.profile.impossible))]
            self.end_copies()
            self.unit.call("reset")
            self.unit.prepare(**{**self.drawn(self.profile.starts), **values})
            with pytest.raises(UnitFailure), np.errstate(all="ignore"):
                self.unit.call("exitInitializationMode")
            self.unit.call("reset")
            begin, self.story, self.open = self.story[0], [], []
            self.act(*begin)

    def terminate(self) -> None:
        """Read before, or only from a state that was saved after."""
        self.end_copies()
        before = self.unit.everything() if self.rng.uniform() < 0.5 else None
        self.unit.call("terminate")
        content = self.unit.saved()
        after = self.unit.everything()
        np.testing.assert_array_equal(after if before is None else before, after)
        np.testing.assert_array_equal(self.unit.restore(content).everything(), after)
        self.reset()

    ACTIONS = ("step", "change", "burst", "save", "restore", "restore_after_reset", "restore_into_initialisation")
    ACTIONS += ("reset", "refuse", "refuse_step", "refuse_start", "look", "terminate")
    WEIGHTS = (0.34, 0.34, 0.03, 0.08, 0.05, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02)
    BOUNDS = tuple(accumulate(WEIGHTS[:-1]))

    def act_at_random(self) -> str:
        """Does one of the actions and returns its name."""
        action = self.ACTIONS[bisect(self.BOUNDS, self.rng.uniform())]
        getattr(self, action)()
        return action


def part_times(unit: Loaded) -> list[int]:
    """Positions of the times of a loop's parts, which it computes in two ways."""
    numbers = [n for n, v in unit.variables.items() if v.type != "String"]
    return [k for k, name in enumerate(numbers) if name.endswith(".time")]


def assert_same(found: Real, expected: Real, times: Sequence[int], where: str) -> None:
    """Bit for bit, but for the last digits of the times of a loop's parts."""
    if found.tobytes() == expected.tobytes():
        return
    found, expected = found.copy(), expected.copy()
    np.testing.assert_allclose(found[times], expected[times], rtol=4e-16, atol=1e-12, err_msg=where)
    found[times] = expected[times] = 0.0
    np.testing.assert_array_equal(found.view(np.uint64), expected.view(np.uint64), err_msg=where)


@dataclass(frozen=True)
class History:
    """What happened, every value after each action, and what became of copies; `calls` of FMI functions."""

    actions: list[str]
    rows: Real
    copies: list[tuple[Case, Real]]
    times: list[int]
    calls: int


def folder_of(backend: str, unit: str) -> Path:
    return native_folder(unit) if backend == "native" else Workshop().folder(unit)


def live(instance: Loaded, fresh: Loaded, unit: str, seed: int) -> History:
    """A history of an instance; compared on the way with one that is made anew and goes through the story alone."""
    rows, names = [], []
    calls = instance.call_count + fresh.call_count
    life, times = Life(instance.renew(), PROFILES[unit], np.random.default_rng(seed)), part_times(instance)
    life.begin()
    for k in range(LENGTH):
        action = life.act_at_random()
        rows.append(instance.everything())
        names.append(action)
        if action not in ("step", "change", "save") or k == LENGTH - 1:
            replay(fresh.renew(), life.story)
            assert_same(fresh.everything(), rows[-1], times, f"seed {seed}, after action {k}, {action}")
    life.end_copies()
    return History(names, np.array(rows), life.copies, times, instance.call_count + fresh.call_count - calls)


@cache
def history(backend: str, unit: str, seed: int) -> History:
    folder = folder_of(backend, unit)
    with loaded(folder) as instance, loaded(folder) as fresh:
        return live(instance, fresh, unit, seed)


BACKENDS = [pytest.param("native", marks=needs_zig), "python"]
CASES = [
    *(pytest.param("native", unit, marks=needs_zig) for unit in PROFILES),
    *(("python", unit) for unit in PROFILES if unit != "BeamClosedLoop"),
]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("backend", "unit"), CASES)
def test_a_fresh_instance_with_the_same_story_agrees_bit_for_bit(backend: str, unit: str, seed: int) -> None:
    lived = history(backend, unit, seed)
    assert set(lived.actions) >= {"step", "change"}
    assert np.all(np.isfinite(lived.rows))


def check_copies(backend: str, unit: str, histories: Sequence[History]) -> int:
    """All saved states of some histories go on in another process; returns the number of FMI calls there."""
    copies = [copy for lived in histories for copy in lived.copies]
    times = histories[0].times
    results, calls = in_second_process(folder_of(backend, unit), [case for case, _ in copies])
    for (case, expected), found in zip(copies, results, strict=True):
        assert_same(found, expected, times, f"a copy at {case[1]} s")
    return calls


@pytest.mark.parametrize(("backend", "unit"), CASES)
def test_a_copy_in_another_process_agrees_bit_for_bit(backend: str, unit: str) -> None:
    histories = [history(backend, unit, seed) for seed in SEEDS]
    assert check_copies(backend, unit, histories) > 50
    assert any(since for lived in histories for (_, _, since), _ in lived.copies)


def difference(native: History, python: History) -> float:
    """The largest of any value between the kernels, relative to the variable's largest."""
    assert native.actions == python.actions
    scale = np.abs(python.rows).max(axis=0)
    return float((np.abs(native.rows - python.rows).max(axis=0) / np.where(scale > 0, scale, 1.0)).max())


@needs_zig
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("unit", [unit for unit in PROFILES if unit != "BeamClosedLoop"])
def test_both_kernels_agree_over_a_history(unit: str, seed: int) -> None:
    assert difference(history("native", unit, seed), history("python", unit, seed)) < PROFILES[unit].kernels


@needs_zig
@pytest.mark.timeout(0)
@pytest.mark.skipif(CALLS == 0, reason="FLEXBEAMS_CALLS is not set")
@pytest.mark.parametrize("unit", PROFILES)
def test_as_many_calls_as_wanted(unit: str) -> None:
    """On instances, fresh ones and copies in another process; one history of a hundred also with the other kernel."""
    first, calls, worst = max(SEEDS) + 1, 0, 0.0
    folder = folder_of("native", unit)
    with loaded(folder) as instance, loaded(folder) as fresh:
        while calls < CALLS:
            batch = [live(instance, fresh, unit, first + k) for k in range(100)]
            calls += sum(lived.calls for lived in batch) + check_copies("native", unit, batch)
            if unit != "BeamClosedLoop":
                other = history("python", unit, first)
                calls += other.calls
                worst = max(worst, difference(batch[0], other))
            first += 100
            count = first - max(SEEDS) - 1
            print(f"\r{unit}: {count} histories, {calls} calls, kernels differ by {worst:.1e}", end="", flush=True)
    print()
    assert worst < PROFILES[unit].kernels


@pytest.mark.parametrize(("backend", "unit"), CASES)
def test_the_histories_hold_every_action(backend: str, unit: str) -> None:
    """One that never restores would show nothing about it, nor one in which no motion ends."""
    histories = [history(backend, unit, seed) for seed in SEEDS]
    assert {name for lived in histories for name in lived.actions} == set(Life.ACTIONS)
    if PROFILES[unit].burst:
        variables = read_model_description(folder_of(backend, unit)).modelVariables
        numbers = [v.name for v in variables if v.type != "String"]
        moving = np.concatenate([lived.rows[:, numbers.index(PROFILES[unit].moving)] for lived in histories])
        assert np.diff(moving).min() < 0 < np.diff(moving).max()
