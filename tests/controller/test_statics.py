"""Statics that a design assumes: of the exact plant, or measured on a rig and read from a CSV file."""

from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.static_error import StaticLoop
from flexbeams.plant.errors import DesignError
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.static_maps import StaticMaps, write_static_maps
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import design_of

KIEL = read_structure(find_structure("kiel"))
TARGET = np.array([-6e-3, 1e-3, 3e-3, -4e-3])


def test_gains_measured_on_the_exact_plant_are_its_statics(tmp_path: Path) -> None:
    """The same arrays as static_maps = "segment"; on target at rest with the offset-free observer on that plant."""
    model = design_of().model("segment")
    G, H = static_gains(model, model.assemble())
    file = tmp_path / "rig.csv"
    write_static_maps(StaticMaps(deflection=G, strain=H), file)
    made = compute_design(KIEL, DesignOptions(static_maps=str(file), observer="offset_free"))
    exact = compute_design(KIEL, DesignOptions(static_maps="segment", observer="offset_free"))
    for name in ("D_pi", "D_pm", "static_inverse", "offset_map"):
        np.testing.assert_allclose(
            made.arrays[name], exact.arrays[name], rtol=0, atol=1e-9 * np.abs(exact.arrays[name]).max()
        )
    u = StaticLoop.of(made).voltages(H, (made.arrays["static_inverse"] @ TARGET)[None])[0]
    np.testing.assert_allclose(G @ u, TARGET, rtol=0, atol=1e-9)
    other = compute_design(KIEL, DesignOptions(observer="offset_free", verify="design"))
    assert np.abs(made.arrays["static_inverse"] - other.arrays["static_inverse"]).max() > 1.0


def test_the_id_is_that_of_the_file_s_contents(tmp_path: Path) -> None:
    model = design_of().model()
    G, H = static_gains(model, model.assemble())
    ids = []
    for name, factor in (("one.csv", 1.0), ("same.csv", 1.0), ("other.csv", 1.01)):
        write_static_maps(StaticMaps(deflection=factor * G, strain=H), tmp_path / name)
        ids.append(compute_design(KIEL, DesignOptions(static_maps=str(tmp_path / name))).design_id)
    assert ids[0] == ids[1] != ids[2]


def test_a_file_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("pair\n", encoding="utf-8")
    with pytest.raises(DesignError, match=r"static_maps: .*empty\.csv: column y_pi\[1\] is missing"):
        compute_design(KIEL, DesignOptions(static_maps=str(tmp_path / "empty.csv")))
