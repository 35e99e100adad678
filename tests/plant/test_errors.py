"""Errors pass from one process to another."""

import pickle

import pytest

from flexbeams.plant.errors import DesignError, FlexbeamsError, InputError
from flexbeams.scenarios.simulation.failure import UnitEnded, UnitFailure


@pytest.mark.parametrize(
    "error",
    [
        InputError("beam[1].length", "must be positive", -1.0, source="a.toml"),
        DesignError("no design"),
        UnitFailure("plant", 0.1, "doStep", "no reason"),
        UnitEnded("plant", 0.2, completed=True),
    ],
)
def test_an_error_is_the_same_in_another_process(error: FlexbeamsError) -> None:
    other = pickle.loads(pickle.dumps(error))
    assert (type(other), str(other), vars(other)) == (type(error), str(error), vars(error))
