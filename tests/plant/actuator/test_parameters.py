"""The section `actuator` of a structure: its rules, and that no design depends on it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.design_record import identify
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.actuator.operators import hysteresis, move_plays, superposition
from flexbeams.plant.actuator.parameters import PatchPairActuator, histories, operators
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import STRUCTURES_FOLDER, read_structure

KIEL = STRUCTURES_FOLDER / "kiel.toml"


def test_no_design_depends_on_it() -> None:
    structure = read_structure(KIEL)
    assert structure.actuator is not None
    bare = replace(structure, actuator=None)
    assert identify(structure, DesignOptions(), {}) == identify(bare, DesignOptions(), {})


def test_the_shipped_loop_is_as_wide_as_a_tenth_of_its_stroke() -> None:
    """Between -1000 and 1000 V, without dead zones; its ends lie on the slope 1 a second after the voltage."""
    structure = read_structure(KIEL)
    assert structure.actuator is not None
    numbers = operators(structure.actuator.pair[:1])
    plays = np.zeros_like(numbers.play_weight)
    rows = []
    for voltage in np.concatenate([[1000.0, -1000.0], np.linspace(-1000, 1000, 401), np.linspace(1000, -1000, 401)]):
        move_plays(numbers, plays, np.array([voltage]))
        rows.append(float(superposition(numbers, plays)[0]))
    rising, falling = np.array(rows[2:403]), np.array(rows[403:])[::-1]
    assert abs(np.max(falling - rising) / np.ptp(rising) - 0.1) < 5e-4
    crept = 1.0 + 0.01 * float(np.sum(1.0 - np.exp(-1.0 / numbers.creep_time)))
    assert abs(crept * np.ptp(rising) / 2000.0 - 1.0) < 2e-3
    assert hysteresis(numbers, plays)[0] > -1000.0


def test_shorter_lists_are_filled_with_operators_that_do_nothing() -> None:
    long = PatchPairActuator(linear_weight=0.5, play_thresholds=[1.0, 2.0], play_weights=[0.1, 0.2], history=[3.0])
    short = PatchPairActuator(linear_weight=0.7)
    numbers = operators([long, short])
    np.testing.assert_array_equal(numbers.play_weight, [[0.5, 0.1, 0.2], [0.7, 0.0, 0.0]])
    np.testing.assert_array_equal(histories([long, short]), [[3.0, 3.0, 3.0, 3.0], [0.0, 0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "supply = 500.0",
            "supply = 1500.0",
            "actuator.supply must be between face_minimum and face_maximum, got 1500.0",
        ),
        (
            "[50.0, 100.0,",
            "[100.0, 50.0,",
            "actuator.pair[1].play_thresholds[2] must be >= 100.0, the threshold before",
        ),
        (
            "[0.071, 0.09,",
            "[0.09,",
            "actuator.pair[1].play_weights must have as many entries as play_thresholds, 7, got 6",
        ),
        (
            "linear_weight = 0.652",
            "linear_weight = 0.0",
            "actuator.pair[1].linear_weight must be finite and > 0, got 0.0",
        ),
        ("[-0.05, 0.05]", "[-1.05, 0.05]", "actuator.pair[1].dead_zone_slopes[1] must leave the sum of slopes 1 + ..."),
        ("lag = 0.0", "lagg = 0.0", "actuator.lagg is not a known key; did you mean 'lag'?"),
    ],
)
def test_rules(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(KIEL.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        read_structure(path)
    assert str(refusal.value).startswith(f"{path}: {message}")


def test_each_pair_has_an_entry(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(KIEL.read_text(encoding="utf-8").rpartition("[[actuator.pair]]")[0], encoding="utf-8")
    with pytest.raises(InputError, match=r"actuator.pair must have an entry for each patch pair, 4, got 3"):
        read_structure(path)
