"""Limits of the voltages in scenarios: units with different ones are noted, and those without effect."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.structure import find_structure
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Value
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario
from flexbeams.scenarios.runs.voltage_limits import voltage_limits_of
from tests.helpers import PUSHED_SCENARIO

TEXT = PUSHED_SCENARIO.format(stop=0.1)
CONTROLLER = 'unit = "TrackingController"\n'


@pytest.fixture
def notes(write_scenario: Callable[[str, str], Path]) -> Callable[..., list[str]]:
    """The notes about limits of the scenario with --set options, and with lines for its controller."""

    def prepare(overrides: Mapping[str, Value], controller: str = "", design: str = "") -> list[str]:
        lines: list[str] = []
        text = design + TEXT.replace(CONTROLLER, CONTROLLER + controller)
        prepare_scenario(load_scenario(write_scenario("s", text)), Settings(overrides=overrides), lines.append)
        return [line for line in lines if "voltage_m" in line or "voltage_limit" in line]

    return prepare


@pytest.mark.parametrize(
    ("overrides", "controller", "line"),
    [
        (
            {"feedforward.voltage_limit": 500.0},
            "",
            "feedforward.voltage_limit is 500 V, controller.voltage_limit 1000 V: set one limit for both, or "
            "design.voltage_limit for all units",
        ),
        (
            {},
            "start.voltage_limit = 500.0\n",
            "feedforward.voltage_limit is 1000 V, controller.voltage_limit 500 V: set one limit for both, or "
            "design.voltage_limit for all units",
        ),
        (
            {},
            "start.voltage_limit = 500.0\nstart.voltage_max = [400.0]\n",
            "feedforward.voltage_limit is 1000 V, controller.voltage_limit 500 V (and 1 more): set one limit for both, "
            "or design.voltage_limit for all units",
        ),
        (
            {"feedforward.voltage_min": [-300.0]},
            'start."voltage_min[1]" = -400.0\n',
            "feedforward.voltage_min[1] is -300 V, controller.voltage_min[1] -400 V: set one limit for both, or "
            "design.voltage_min for all units",
        ),
    ],
)
def test_different_limits_are_noted(
    notes: Callable[..., list[str]], overrides: Mapping[str, Value], controller: str, line: str
) -> None:
    assert notes(overrides, controller) == [line]


def test_equal_limits_are_not(notes: Callable[..., list[str]]) -> None:
    """Neither those of the design, of whatever value, nor the same in both units."""
    assert notes({}) == []
    assert notes({"feedforward.voltage_limit": 500.0, "controller.voltage_limit": 500.0}) == []
    assert notes({"feedforward.voltage_max": 500.0}, "start.voltage_max = [500.0]\n") == []
    assert notes({}, design="design.voltage_limit = 700.0\ndesign.voltage_max = [300.0]\n") == []


def test_a_limit_of_a_pair_beyond_that_of_all_has_no_effect(notes: Callable[..., list[str]]) -> None:
    both = {"feedforward.voltage_max": [1500.0], "controller.voltage_max": [1500.0]}
    assert notes(both) == [
        f"{name}.voltage_max[1] = 1500 V has no effect: {name}.voltage_limit is 1000 V"
        for name in ("feedforward", "controller")
    ]
    assert notes({}, design="design.voltage_max = [1500.0]\n") == [
        "design: voltage_max[1] = 1500 V has no effect: voltage_limit is 1000 V"
    ]
    assert notes(both | {"feedforward.voltage_limit": 1500.0, "controller.voltage_limit": 1500.0}) == []


def test_limits_that_a_run_starts_with(write_scenario: Callable[[str, str], Path]) -> None:
    text = TEXT.replace(CONTROLLER, CONTROLLER + "start.voltage_limit = 800.0\nstart.voltage_min = [-200.0]\n")
    prepared = prepare_scenario(load_scenario(write_scenario("s", text)), Settings())
    limits = voltage_limits_of(prepared.declarations["controller"].variables, prepared.starts["controller"])
    np.testing.assert_array_equal([limits.lowest, limits.highest], [[-200.0], [800.0]])
    limits = voltage_limits_of(prepared.declarations["feedforward"].variables, prepared.starts["feedforward"])
    np.testing.assert_array_equal([limits.lowest, limits.highest], [[-1000.0], [1000.0]])


def test_limits_of_the_design(write_scenario: Callable[[str, str], Path]) -> None:
    """Both units start with them, and so does the check of targets; one for each pair, no more."""
    text = "design.voltage_min = [-30.0]\ndesign.voltage_max = [400.0]\n" + TEXT

    def prepared(content: str) -> PreparedScenario:
        return prepare_scenario(load_scenario(write_scenario("s", content)), Settings())

    with pytest.raises(InputError, match=r"patch pair 1 would need -\d\d\.\d V at rest, voltage_min\[1\] is -30 V"):
        prepared(text)
    run = prepared(text.replace("-30.0", "-50.0"))
    for name in ("feedforward", "controller"):
        limits = voltage_limits_of(run.declarations[name].variables, run.starts[name])
        np.testing.assert_array_equal([limits.lowest, limits.highest], [[-50.0], [400.0]])
    with pytest.raises(DesignError, match="voltage_max must have 1 values, one for each patch pair, got 2"):
        prepared(text.replace("[400.0]", "[400.0, 400.0]"))
    with pytest.raises(InputError, match=r"design\.voltage_min\[1\] must be <= 0"):
        prepared(text.replace("-30.0", "30.0"))


def test_redundant_pairs_and_a_target_beyond_the_limits(write_scenario: Callable[[str, str], Path]) -> None:
    """The check is that of the feedforward, which takes the least sum of squares; it says what else would hold it."""
    source = find_structure("single_beam").read_text(encoding="utf-8").partition("[actuator]")[0]
    patch = source[source.index("[[patch]]") : source.index("[[point_of_interest]]")]
    two = source + patch.replace("position = 0.025", "position = 0.13")
    structure = write_scenario("two", two)
    text = TEXT.replace('"single_beam"', f'"{structure.name}"').replace("[1e-3]", "[5e-3]")

    def refusal(maximum: str) -> str:
        path = write_scenario("s", f"design.voltage_min = {maximum}\n{text}")
        try:
            prepare_scenario(load_scenario(path), Settings())
        except InputError as error:
            return str(error)
        return ""

    needed = refusal("[-1.0, -1.0]")
    assert "is out of reach: patch pair 1 would need -" in needed
    assert "; no other voltages within the limits hold it, got [0.005]" in needed
    assert refusal("[-600.0, -600.0]") == ""
    line = refusal("[-100.0, -600.0]")
    assert "\n" not in line
    found = re.search(r"; \[(-?[\d.]+), (-?[\d.]+)\] V would hold it, but the feedforward takes the", line)
    assert found is not None, line
    assert float(found[1]) >= -100.0
    assert float(found[2]) >= -600.0
