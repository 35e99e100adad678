"""Values in other units are named with file, key, value and unit; legitimate structures pass silently."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from flexbeams.controller.design import compute_design
from flexbeams.plant.errors import DesignError
from flexbeams.plant.plausibility import implausible_values
from flexbeams.plant.structure import STRUCTURES_FOLDER, Structure, read_structure
from flexbeams.scenarios.cli.main import main

SINGLE = read_structure(STRUCTURES_FOLDER / "single_beam.toml")


def changed(part: str, **values: float) -> Structure:
    """The structure `single_beam` with other values of its beam or patch pair."""
    items = [replace(item, **values) for item in getattr(SINGLE, part)]
    return replace(SINGLE, **{part: items})


@pytest.mark.parametrize("path", sorted(STRUCTURES_FOLDER.glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_structures_pass(path: Path) -> None:
    assert implausible_values(read_structure(path)) == []


@pytest.mark.parametrize(
    ("part", "values"),
    [
        ("beam", {"density": 7850.0, "youngs_modulus": 2.1e11}),  # steel
        ("beam", {"tip_mass": 0.0}),
        ("beam", {"tip_mass": 1.0}),
        ("beam", {"thickness": 0.05}),
        ("beam", {"density": 60.0, "youngs_modulus": 5e7}),  # foam
        ("beam", {"length": 12.0, "thickness": 0.2, "width": 0.5, "tip_mass": 50.0}),
        ("patch", {"piezo_ratio": 0.05}),  # PVDF
        ("patch", {"thickness": 1e-6, "electrode_distance": 1e-6}),  # thin film
    ],
)
def test_legitimate_values_pass(part: str, values: dict[str, float]) -> None:
    assert implausible_values(changed(part, **values)) == []


@pytest.mark.parametrize(
    ("part", "values", "said"),
    [
        ("beam", {"length": 500.0}, r"beam\[1\].length = 500 is unusual: SI: m; looks like mm, 0.5 m"),
        ("beam", {"youngs_modulus": 70.0}, r"youngs_modulus = 70 is unusual: SI: Pa; looks like GPa, 7e\+10 Pa"),
        ("beam", {"youngs_modulus": 70000.0}, r"youngs_modulus = 70000 .* looks like GPa|looks like MPa"),
        ("beam", {"thickness": 1.5}, r"thickness = 1.5 is unusual: SI: m; looks like mm, 0.0015 m"),
        ("beam", {"thickness": 0.4}, r"thickness = 0.4 .* looks like mm, 0.0004 m"),
        ("beam", {"width": 45.0}, r"width = 45 .* looks like mm, 0.045 m"),
        (
            "beam",
            {"tip_mass": 25.0},
            r"tip_mass = 25 is unusual: SI: kg; the beam itself has .* g, 0.025 kg",
        ),
        ("beam", {"density": 7.85}, r"density = 7.85 is unusual: SI: kg/m3; looks like g/cm3, 7850 kg/m3"),
        ("patch", {"piezo_ratio": 4e-10}, r"piezo_ratio = 4e-10 .* SI: C/m2; looks like d33 in m/V, 2 d33 E = "),
        ("patch", {"piezo_ratio": 400.0}, r"piezo_ratio = 400 .* looks like d33 in pm/V, 2 d33 E = "),
        ("patch", {"electrode_distance": 0.5}, r"electrode_distance = 0.5 .* looks like mm, 0.0005 m"),
        ("beam", {"thickness": 2e-6, "tip_mass": 1e-3}, r"beam\[1\] alone has its first frequency at .* Hz"),
    ],
)
def test_other_units_are_named(part: str, values: dict[str, float], said: str) -> None:
    [line] = implausible_values(changed(part, **values))
    assert re.search(said, line), line


def test_one_line_for_all_beams() -> None:
    kiel = read_structure(STRUCTURES_FOLDER / "kiel.toml")
    [line] = implausible_values(replace(kiel, beam=[replace(beam, length=400.0) for beam in kiel.beam]))
    assert line.startswith("beam[1].length = 400 (and 2 more) is unusual")


def test_the_cause_of_a_missing_design_comes_first() -> None:
    """No advice about the reduction where a value is in another unit."""
    with pytest.raises(DesignError, match=r"there is no design, perhaps because .*youngs_modulus = 60 ") as raised:
        compute_design(changed("beam", youngs_modulus=60.0))
    assert "reduced_modes" not in str(raised.value)


def test_overdamped_modes_are_named_before_the_options(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reduced model is made unstable here; the ratios are those of the full model."""
    from flexbeams.controller import reduction
    from flexbeams.plant.galerkin import beam_model

    system = beam_model(changed("beam", structural_damping=1.0), "clamped_free", 10).assemble()
    with pytest.raises(DesignError, match=r"not stable: .* overdamped modes \(damping ratio [\d.]+ at .* rad/s"):
        reduction._require_stable(-system.K * 0 + 1.0, 5, system)
    calm = beam_model(SINGLE, "clamped_free", 10).assemble()
    with pytest.raises(DesignError, match=r"j 1/s; change reduced_modes"):
        reduction._require_stable(-calm.K * 0 + 1.0, 5, calm)


def test_commands_name_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (STRUCTURES_FOLDER / "single_beam.toml").read_text(encoding="utf-8")
    file = tmp_path / "rig.toml"
    file.write_text(re.sub(r"(?m)^youngs_modulus = .*", "youngs_modulus = 70.0", text, count=1), encoding="utf-8")
    assert main(["design", "--structure", str(file)]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first == f"{file}: beam[1].youngs_modulus = 70 is unusual: SI: Pa; looks like GPa, 7e+10 Pa"
    assert "there is no design, perhaps because beam[1].youngs_modulus" in second
