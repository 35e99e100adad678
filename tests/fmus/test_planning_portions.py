"""Planning in portions: any plan is done in time, and what a tick does is bounded."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.native import HEADERS, compiled_file, unit_sources
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import BuiltUnits, computed_once
from tests.native.workshop import HARNESSES, ZIG, native_unit, needs_zig, run
from tests.units.loaded import Real, loaded

SAMPLE = 2e-4
OUTPUTS = ("u_ff", "x_ref", "y_ref", "moving", "planned_time", "planned_peak")


@pytest.mark.native
@needs_zig
@pytest.mark.parametrize("planner", ["paper", "multi_input"])
def test_portions_suffice_and_are_bounded(planner: Any, tmp_path: Path) -> None:
    """300 random motions near the limit: each plan is done after its ticks, and is that of a search at one go."""
    design = computed_once(read_structure(find_structure("kiel")), DesignOptions(planner=planner))
    unit = native_unit("FlatnessFeedforward", design, tmp_path)
    for name, content in unit_sources(unit)[0].items():
        (tmp_path / name).write_bytes(content)
    assert (tmp_path / compiled_file("FlatnessFeedforward")).is_file()
    flags = ("-std=c99", "-O2", "-ffp-contract=off", '-DUNIT_GUID=""', f"-I{tmp_path}", f"-I{HEADERS}")
    program = tmp_path / "planning"
    run([*ZIG, *flags, str(HARNESSES / "planning.c"), "-o", str(program), "-lm"])
    plans, stretched, unfinished, different, fullest = map(float, run([str(program)]).split())
    assert plans > 150
    assert stretched > 50
    assert unfinished == different == 0
    assert 0.5 < fullest < 1.1


def course(units: BuiltUnits, steps: list[float], targets: dict[int, Real]) -> Real:
    """Outputs at every 50 ms, with new targets there, between them steps of these sizes, which add up to 50 ms."""
    rows = []
    with loaded(units("FlatnessFeedforward")) as unit:
        unit.begin(transition_time=0.4)
        for k in range(30):
            if k in targets:
                unit.put("y_target", targets[k])
            for step in steps:
                unit.advance(step)
            rows.append(unit.take(*OUTPUTS))
    return np.array(rows)


def test_plans_do_not_depend_on_the_steps(units: BuiltUnits) -> None:
    """Steps of the sample time, of parts and multiples of it, uneven ones, and leaps of 50 ms: bit for bit."""
    inverse = computed_once(read_structure(find_structure("kiel"))).arrays["static_inverse"]
    voltages = np.random.default_rng(3).uniform(-950, 950, (6, 4))
    goals = voltages @ np.linalg.pinv(inverse).T
    targets = dict(zip((0, 4, 7, 8, 12, 25), goals, strict=True))
    even = course(units, [SAMPLE] * 250, targets)
    assert len(set(even[:, -1])) > 4
    for steps in ([5e-2], [0.7e-3, 4.3e-3] * 10, [1e-4, 3e-4] * 125):
        found = course(units, steps, targets)
        np.testing.assert_array_equal(found[:, -3:], even[:, -3:])
        assert np.abs(found - even).max() <= 1e-9 * np.abs(even).max()


def test_a_search_goes_on_from_every_tick(units: BuiltUnits) -> None:
    """A state that is saved at any tick of a search is accepted, and leads to the same plan."""
    inverse = computed_once(read_structure(find_structure("kiel"))).arrays["static_inverse"]
    goals = np.random.default_rng(5).uniform(-950, 950, (8, 4)) @ np.linalg.pinv(inverse).T
    with loaded(units("FlatnessFeedforward")) as unit, loaded(units("FlatnessFeedforward")) as copy:
        unit.begin(transition_time=0.4, y_target=goals[0]).advance(0.1)
        for goal in goals[1:]:
            unit.put("y_target", goal)
            states = [unit.advance(SAMPLE).saved() for _ in range(130)]
            expected = unit.take(*OUTPUTS)[-3:]
            for k, state in enumerate(states[:-1], 2):
                found = copy.restore(state).advance((len(states) + 1 - k) * SAMPLE)
                np.testing.assert_array_equal(found.take(*OUTPUTS)[-3:], expected)


def test_a_plan_keeps_the_limits_of_the_tick_that_saw_its_target(units: BuiltUnits) -> None:
    """A limit that is narrowed meanwhile holds for the next target; the transition under way goes on too."""
    inverse = computed_once(read_structure(find_structure("kiel"))).arrays["static_inverse"]
    first, second, third = np.array([[800.0, -700.0, 600.0, 500.0], [-600.0, 700.0, 300.0, -500.0], [30.0] * 4]) @ (
        np.linalg.pinv(inverse).T
    )

    def planned(narrowed_after: int) -> tuple[Real, Real, Real]:
        """The plan of the second target, the motion after it, and the plan of the third."""
        with loaded(units("FlatnessFeedforward")) as unit:
            unit.begin(transition_time=0.5)
            unit.advance(0.2, y_target=first)
            unit.put("y_target", second)
            for tick in range(200):
                if tick == narrowed_after:
                    unit.put("voltage_limit", 450.0)
                unit.advance(SAMPLE)
            unit.put("voltage_limit", 450.0)
            plan, motion = unit.take("planned_time", "planned_peak"), unit.advance(0.3).take("u_ff", "x_ref")
            unit.advance(2.0).advance(0.1, y_target=third)
            return plan, motion, unit.take("planned_time", "target_refused")

    late, narrowed = planned(200), planned(10)
    for one, other in zip(late, narrowed, strict=True):
        np.testing.assert_array_equal(one, other)
    assert late[0][1] > 450.0
    assert late[2][1] == 0.0
    assert planned(0)[0].tolist() != late[0].tolist()
