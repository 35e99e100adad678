"""FlatnessFeedforward of the planner multi_input: exact, smooth, within the limits, the same in C and in Python."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.design import Design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.flatness_feedforward import FLATNESS_FEEDFORWARD
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import computed_once, extracted_once, made_once
from tests.native.workshop import needs_zig
from tests.units.loaded import Loaded, Real, loaded

SAMPLE = 2e-4
TARGET = np.array([-8e-3, 1e-3, 4e-3, -6e-3])
OUTPUTS = ("u_ff", "x_ref", "y_ref", "moving", "planned_time", "planned_peak", "target_refused")
BACKENDS = [pytest.param("native", marks=[pytest.mark.native, needs_zig]), "python"]


@cache
def design() -> Design:
    return computed_once(read_structure(find_structure("kiel")), DesignOptions(planner="multi_input"))


def unit(backend: str) -> Path:
    def make(folder: Path) -> None:
        build_units([FLATNESS_FEEDFORWARD], design(), design().model(), folder, backend=backend)  # type: ignore[arg-type]

    return extracted_once(made_once(f"splines/{backend}", make) / backend / "FlatnessFeedforward.fmu")


def goals(count: int) -> Real:
    """Random targets that take up to 950 V at rest."""
    voltages = np.random.default_rng(5).uniform(-950, 950, (count, 4))
    return np.asarray(voltages @ np.linalg.pinv(design().arrays["static_inverse"]).T)


def motion(feedforward: Loaded, steps: int, step: float, targets: Real, every: int) -> Real:
    """All outputs after each step, with the next target in every so many of them."""
    rows = []
    for k in range(steps):
        if k % every == 0:
            feedforward.put("y_target", targets[k // every % len(targets)])
        rows.append(feedforward.advance(step).take(*OUTPUTS))
    return np.array(rows)


@pytest.mark.parametrize("backend", BACKENDS)
def test_from_rest_to_rest(backend: str) -> None:
    """At the target after a tabulated time, without any later change; a request between two takes the longer."""
    with loaded(unit(backend)) as feedforward:
        feedforward.begin(transition_time=0.5)
        feedforward.advance(0.1, y_target=TARGET)
        time = feedforward.take("planned_time")[0]
        times = design().arrays["spline_times"]
        assert time == times[np.searchsorted(times, 0.5)]
        assert feedforward.notes[0].endswith("takes 0.567 s, the next longer time of the design to 0.5 s")
        feedforward.advance(time - 0.1 - 1e-6)
        assert feedforward.take("moving")[0] == 1
        feedforward.advance(2e-6)
        end = feedforward.take("u_ff", "x_ref", "y_ref", "moving")
        np.testing.assert_allclose(end[:4], design().arrays["static_inverse"] @ TARGET, rtol=1e-12)
        np.testing.assert_allclose(end[34:38], TARGET, rtol=1e-9)
        np.testing.assert_array_equal(feedforward.advance(3.0).take("u_ff", "x_ref", "y_ref", "moving"), end)
        feedforward.advance(9.0, y_target=-TARGET, transition_time=0.3, voltage_limit=820.0)
        assert "is stretched from 0.3 s" in feedforward.notes[-1]
        feedforward.advance(0.1, y_target=TARGET / 2, transition_time=0.5, voltage_limit=1e3)
        assert feedforward.notes[-1].endswith("takes 0.567 s, the next longer time of the design to 0.5 s")


@pytest.mark.parametrize("backend", BACKENDS)
def test_reference_state_follows_the_reduced_model(backend: str) -> None:
    """x' = A x + B u by Simpson's rule over pairs of small steps, in transitions that overlap."""
    A, B = design().arrays["A"], design().arrays["B"]
    with loaded(unit(backend)) as feedforward:
        feedforward.begin()
        feedforward.advance(0.3, y_target=TARGET).advance(0.2, y_target=-0.3 * TARGET)
        for _ in range(6):
            rows = [feedforward.take("u_ff", "x_ref")]
            rows += [feedforward.advance(2e-5).take("u_ff", "x_ref") for _ in range(2)]
            slopes = [A @ row[4:] + B @ row[:4] for row in rows]
            rule = 2e-5 / 3 * (slopes[0] + 4 * slopes[1] + slopes[2])
            change = rows[2][4:] - rows[0][4:]
            assert np.abs(change - rule).max() < 1e-6 * np.abs(change).max()
            feedforward.advance(0.11)


@pytest.mark.native
@needs_zig
def test_kernels_agree() -> None:
    """Random targets near the limit, each while others are under way: the same plans, the same outputs to 1e-12."""
    found = []
    for backend in ("native", "python"):
        with loaded(unit(backend)) as feedforward:
            feedforward.begin(transition_time=0.3, preview=SAMPLE, voltage_limit=950.0)
            found.append(motion(feedforward, 1200, 1e-3, goals(12), every=70))
            assert any("stretched" in note for note in feedforward.notes)
    native, python = found
    np.testing.assert_array_equal(native[:, 38:40], python[:, 38:40])  # moving, planned_time
    for part in (slice(0, 4), slice(4, 34), slice(34, 38), slice(40, 41)):
        assert np.abs(native[:, part] - python[:, part]).max() <= 1e-12 * np.abs(python[:, part]).max()


@pytest.mark.parametrize("backend", BACKENDS)
def test_limits_hold_and_voltages_are_smooth(backend: str) -> None:
    """Within 0.1 % of the limit; the third differences around new targets are no larger than elsewhere."""
    with loaded(unit(backend)) as feedforward:
        feedforward.begin(transition_time=0.3)
        u = motion(feedforward, 3000, SAMPLE, goals(6), every=500)[:, :4]
    assert np.abs(u).max() <= 1001.0
    jerk = np.abs(np.diff(u, 3, axis=0)).max(axis=1)
    starts = 500 * np.arange(1, 6) + PLANNING_TICKS
    around = np.max([jerk[start - 5 : start + 5].max() for start in starts])
    assert around <= 1.001 * np.max(np.delete(jerk, np.add.outer(starts, np.arange(-5, 5)).ravel()))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_preview_may_become_shorter(backend: str) -> None:
    """Within a transition: the outputs go back to those of an earlier time."""
    with loaded(unit(backend)) as ahead, loaded(unit(backend), "other") as plain:
        for one, preview in ((ahead, 0.2), (plain, 0.0)):
            one.begin(preview=preview, transition_time=0.5).advance(0.1, y_target=TARGET).advance(0.1)
        assert np.abs(ahead.take("u_ff") - plain.take("u_ff")).max() > 1.0
        ahead.put("preview", 0.0)
        for one in (ahead, plain):
            one.advance(SAMPLE)
        np.testing.assert_array_equal(ahead.take(*OUTPUTS), plain.take(*OUTPUTS))


@pytest.mark.parametrize("backend", BACKENDS)
def test_limits_of_a_pair(backend: str) -> None:
    """One pair's lowest voltage stretches a transition; narrowed below rest, it refuses the target."""
    u = design().arrays["static_inverse"] @ TARGET
    lowest = float(u[1]) * 1.0005
    with loaded(unit(backend)) as feedforward:
        feedforward.begin(transition_time=0.357, **{"voltage_min[2]": lowest})
        moved = motion(feedforward, 1200, 1e-3, TARGET[None], every=1200)[:, :4]
        assert moved[:, 1].min() >= lowest * 1.0015
        feedforward.advance(0.1, y_target=0.0).advance(2.0)
        feedforward.advance(0.1, **{"voltage_min[2]": 0.9 * float(u[1])}, y_target=TARGET)
        assert feedforward.take("target_refused")[0] == 1
        np.testing.assert_array_equal(feedforward.take("u_ff"), 0.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_saved_states_go_on_bit_for_bit(backend: str) -> None:
    """In a motion, while a target is being planned, and after a step back in time."""
    with loaded(unit(backend)) as feedforward:
        feedforward.begin(transition_time=0.3)
        motion(feedforward, 410, 1e-3, goals(8), every=100)
        for _ in range(2):
            saved = feedforward.saved()
            later = motion(feedforward, 300, SAMPLE, goals(8)[5:6], every=300)
            with loaded(unit(backend), "other") as other:
                other.begin()
                np.testing.assert_array_equal(
                    motion(other.restore(saved), 300, SAMPLE, goals(8)[5:6], every=300), later
                )
            np.testing.assert_array_equal(
                motion(feedforward.restore(saved), 300, SAMPLE, goals(8)[5:6], every=300), later
            )


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_search_goes_on_from_any_tick(backend: str) -> None:
    """Its plan is the same in an instance whose last search was another one; most are done after a few ticks."""
    states = []
    with loaded(unit(backend)) as one, loaded(unit(backend), "other") as other:
        one.begin(transition_time=0.3, voltage_limit=950.0, y_target=goals(5)[0]).advance(0.01)
        for goal in goals(5)[1:]:
            one.put("y_target", goal)
            searching = [one.advance(SAMPLE).saved() for _ in range(10)]
            expected = one.advance(PLANNING_TICKS * SAMPLE).take(*OUTPUTS)
            states.append([(state, expected) for state in searching])
        assert any("stretched" in note for note in one.notes)
        for k, searches in enumerate(zip(*states, strict=True)):
            for state, expected in searches:
                other.restore(state)
                for _ in range(9 - k):
                    other.advance(SAMPLE)
                np.testing.assert_array_equal(other.advance(PLANNING_TICKS * SAMPLE).take(*OUTPUTS), expected)
