"""Targets that no voltages reach are refused by the unit, with the nearest reachable one, in both kernels."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.choices import Backend
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.flatness_feedforward import FLATNESS_FEEDFORWARD
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import PointOfInterest, find_structure, read_structure
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.prepare import prepare_scenario
from flexbeams.scenarios.simulation.failure import UnitFailure
from tests.helpers import PUSHED_SCENARIO, Write, made_once
from tests.native.workshop import needs_zig
from tests.units.loaded import loaded

OFF = np.array([5e-3, 5e-3])  # two points of one beam cannot move alike


@cache
def two_points() -> Design:
    """The single beam with a second point of interest and one pair."""
    single = read_structure(find_structure("single_beam"))
    points = (*single.point_of_interest, PointOfInterest(beam=1, position=0.25))
    return compute_design(replace(single, point_of_interest=points), DesignOptions(reduced_modes=3))


def folder_of(backend: Backend) -> Path:
    def make(folder: Path) -> None:
        [file] = build_units([FLATNESS_FEEDFORWARD], two_points(), two_points().model(), folder, backend=backend)
        fmpy.extract(str(file), unzipdir=str(folder / "unit"))

    return made_once(f"two_points/{backend}", make) / "unit"


@pytest.mark.parametrize("backend", [pytest.param("native", marks=[pytest.mark.native, needs_zig]), "python"])
def test_the_previous_target_is_held_with_one_warning(backend: Backend) -> None:
    """A target that the printed one comes close to is taken."""
    reached = OFF - two_points().arrays["unreachable"] @ OFF
    furthest = int(np.argmax(np.abs(OFF - reached)))
    line = (
        f"no voltages reach it, the nearest reachable target has y_target[{furthest + 1}] = {reached[furthest]:.6g} m "
        "in place of 0.005 m"
    )
    with loaded(folder_of(backend)) as unit:
        unit.begin(transition_time=0.5)
        unit.advance(0.1, y_target=OFF)
        assert unit.notes == [f"unit: y_target at 0 s is refused: {line}; the target before is held"]
        assert unit.take("target_refused", "moving").tolist() == [1.0, 0.0]
        unit.advance(0.1, y_target=np.array([float(f"{y:.4g}") for y in reached]))
        assert unit.take("target_refused", "moving").tolist() == [0.0, 1.0]
        unit.advance(1.0)
        np.testing.assert_allclose(unit.take("y_ref"), reached, rtol=1e-3)
        unit.call("reset")
        with pytest.raises(UnitFailure, match=re.escape(f"y_target is out of reach: {line}")):
            unit.begin(y_target=OFF)


def test_a_scenario_with_such_a_target_is_refused_before_it_runs(write_scenario: Write, tmp_path: Path) -> None:
    """With the whole nearest target; targets = "nearest" takes it."""
    source = find_structure("single_beam").read_text(encoding="utf-8")
    source += "\n[[point_of_interest]]\nbeam = 1\nposition = 0.25\n"
    (tmp_path / "two.toml").write_text(source, encoding="utf-8")
    text = PUSHED_SCENARIO.format(stop=0.1).replace('"single_beam"', '"two.toml"').replace("[1e-3]", "[5e-3, 5e-3]")
    with pytest.raises(
        InputError, match=r"value is out of reach: no voltages reach it, the nearest reachable target is"
    ):
        prepare_scenario(load_scenario(write_scenario("off", text)), Settings())
    nearest = text.replace("[instance.feedforward]", '[design]\ntargets = "nearest"\n[instance.feedforward]')
    prepare_scenario(load_scenario(write_scenario("nearest", nearest)), Settings())
