"""Bounds of each unit's variables: a bound itself is taken; what is just beyond is refused and leaves nothing."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description

from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import UNITS, BuiltUnits
from tests.units.loaded import Loaded, Real, loaded

STEP = 2e-4


def beyond(kind: str, bound: float, side: float) -> float:
    return bound + side if kind == "Integer" else float(np.nextafter(bound, side * np.inf))


def bounds(variables: dict[str, Any]) -> list[tuple[str, float, float, str]]:
    """Name, bound, the nearest value beyond and the rule, for every bound of what can be set."""
    found = []
    for v, (side, rule) in product(variables.values(), ((-1.0, ">="), (1.0, "<="))):
        text = v.min if side < 0 else v.max
        if text is not None and v.causality in ("input", "parameter") and v.type in ("Real", "Integer"):
            bound = float(text)
            found.append((v.name, bound, beyond(v.type, bound, side), rule))
    return found


def used(unit: Loaded) -> Real:
    """Every value after a plain initialisation and a step."""
    return unit.begin().advance(STEP).everything()


@pytest.mark.parametrize("unit", UNITS)
def test_a_bound_is_taken_and_what_is_beyond_is_refused(units: BuiltUnits, unit: str) -> None:
    folder = units(unit)
    rules = bounds({v.name: v for v in read_model_description(folder).modelVariables})
    assert rules
    with loaded(folder) as one:
        expected = used(one)
        for name, bound, more, rule in rules:
            one.call("reset")
            one.prepare()
            one.set_start(name, bound)
            with pytest.raises(UnitFailure) as refusal:
                one.set_start(name, more)
            assert f"{name} must be {rule} " in str(refusal.value)
            one.call("reset")
            np.testing.assert_array_equal(used(one), expected, err_msg=name)
