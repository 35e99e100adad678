"""A kind of unit from outside the project: a record and two kernels of the tests, with no change to any module."""

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract

from flexbeams import export, run
from flexbeams.fmus.choices import Backend
from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.errors import BuildError, InterfaceError
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.validation.package import package_problems, unit_problems
from flexbeams.scenarios.validation.references import reference_checks
from tests.helpers import design_of
from tests.native.workshop import needs_zig
from tests.units.gain.kind import GAIN, weights
from tests.units.loaded import loaded

ZIG = pytest.param("native", marks=needs_zig)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("gain")


def built(folder: Path, backend: Backend) -> Path:
    """The FMU of the test's kind, for a structure with three beams and four patch pairs."""
    file = folder / backend / "Gain.fmu"
    if not file.exists():
        design = design_of()
        assert build_units([GAIN], design, design.model(), folder, backend=backend) == [file]
    return file


@pytest.mark.parametrize("backend", [ZIG, "python"])
def test_it_is_built_and_computes(folder: Path, backend: Backend) -> None:
    file = built(folder, backend)
    assert unit_problems(file) == []
    inputs = np.array([3.0, -1.0, 0.5, 100.0])
    with loaded(Path(extract(str(file), unzipdir=str(file.with_suffix(""))))) as unit:
        unit.begin(gain=1.5)
        assert unit.take("y").tolist() == [0.0] * 4
        unit.advance(2e-4, u=inputs)
        np.testing.assert_array_equal(unit.take("y"), 1.5 * (weights(4) * inputs))
        unit.put("gain", 4.0)
        state = unit.saved()
        expected = unit.advance(2e-4).take("y").tolist()
        assert expected == (4.0 * (weights(4) * inputs)).tolist()
        assert unit.restore(state).advance(2e-4).take("y").tolist() == expected


@needs_zig
def test_it_is_documented(folder: Path) -> None:
    with zipfile.ZipFile(built(folder, "native")) as archive:
        page = archive.read("documentation/index.html").decode()
        assert archive.read("model.png").startswith(b"\x89PNG")
        code, tables = (archive.read(f"sources/Gain{end}").decode() for end in (".c", "_tables.h"))
    assert "Each output is a multiple of its input:" in page
    assert "<msub><mi>y</mi><mi>k</mi></msub><mo>=</mo>" in page
    assert "Outputs follow at once." in page
    assert "Kater" not in page
    assert "/* ---- gain.c" in code
    assert "/* weight of each element, 1 */" in tables
    assert f"Design id: {design_of().design_id}" in tables


@needs_zig
def test_it_agrees_with_its_reference_results(folder: Path) -> None:
    [check] = reference_checks(built(folder, "native"))
    assert (check.passed, check.message) == (True, "reference jump: agrees exactly")


@pytest.mark.parametrize(
    ("backend", "kind", "name"),
    [("native", replace(GAIN, native=None), "native"), ("python", replace(GAIN, python=None), "Python")],
)
def test_a_kernel_that_a_kind_does_not_have_is_missed(
    tmp_path: Path, backend: Backend, kind: UnitKind, name: str
) -> None:
    design = design_of()
    with pytest.raises(BuildError, match=f"Gain: there is no {name} unit of this kind"):
        build_units([kind], design, design.model(), tmp_path, backend=backend)


def test_records_that_cannot_be_are_refused() -> None:
    with pytest.raises(InterfaceError, match="Gain: a unit must have a native kernel, a Python kernel or both"):
        replace(GAIN, native=None, python=None)
    with pytest.raises(InterfaceError, match="name of a unit must be a C identifier, got 'my gain'"):
        replace(GAIN, name="my gain")
    with pytest.raises(InterfaceError, match="Other: unit_name must be that of the kind, got 'Gain'"):
        replace(GAIN, name="Other").declare(design_of(), design_of().model())
    with pytest.raises(InterfaceError, match="Gain: no design makes a unit of this kind"):
        replace(GAIN, interface=None).declare(design_of(), design_of().model())


def test_kinds_have_names_of_their_own() -> None:
    assert len({kind.name for kind in CATALOGUE}) == len(CATALOGUE)


SCENARIO = """# An amplifier drives a plant.
title = "Amplified plant"
structure = "single_beam"
stop_time = 0.02

[instance.amplifier]
unit = "Gain"
start.gain = 3.0

[instance.plant]
unit = "BeamPlant"

[[connection]]
from = "amplifier.y"
to = "plant.u"

[[input]]
to = "amplifier.u"
step = { time = 0.004, value = 50.0 }
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "amplified.toml"
    path.write_text(SCENARIO)
    return path


@pytest.mark.parametrize("backend", [ZIG, "python"])
def test_a_scenario_names_it(scenario: Path, tmp_path: Path, backend: Backend) -> None:
    notes: list[str] = []
    options: dict[str, Any] = {"backend": backend, "build_folder": tmp_path / "fmus", "kinds": [GAIN]}
    recording = run(scenario, notify=notes.append, **options).recording
    assert "building Gain" in notes
    columns = dict(zip(recording.columns, recording.values.T, strict=True))
    u = np.where(recording.time >= 0.004 - 1e-9, 50.0, 0.0)
    np.testing.assert_array_equal(columns["amplifier.u[1]"], u)  # inputs are recorded as the record asks
    np.testing.assert_array_equal(columns["amplifier.y[1]"][1:], 3.0 * u[:-1])
    np.testing.assert_array_equal(columns["plant.u[1]"], columns["amplifier.y[1]"])
    assert np.abs(columns["plant.y_pi[1]"]).max() > 1e-6
    notes.clear()
    again = run(scenario, notify=notes.append, **options).recording
    assert not [note for note in notes if note.startswith("building")]
    np.testing.assert_array_equal(again.values, recording.values)
    changed = replace(GAIN, chapter=Chapter(equations="", timing=""))
    run(scenario, notify=notes.append, **options | {"kinds": [changed]})
    assert "building Gain" in notes


@needs_zig
def test_exports_hold_it(scenario: Path, tmp_path: Path) -> None:
    package = export(scenario, tmp_path / "amplified.ssp", kinds=[GAIN])
    assert package_problems(package) == []
    plain = run(scenario, build_folder=tmp_path / "fmus", kinds=[GAIN]).recording
    packed = run(package).recording
    shared = [name for name in plain.columns if name in packed.columns]
    assert "plant.y_pi[1]" in shared
    for name in shared:
        np.testing.assert_array_equal(
            packed.values[:, packed.columns.index(name)], plain.values[:, plain.columns.index(name)]
        )

    loop = export(scenario, tmp_path / "loop.fmu", format="closed-loop", kinds=[GAIN])
    assert unit_problems(loop) == []
    with zipfile.ZipFile(loop) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "<h3>Gain: amplifier</h3>" in page
    with loaded(Path(extract(str(loop), unzipdir=str(tmp_path / "loop")))) as unit:
        unit.begin()
        assert float(unit.get("amplifier.gain")) == 3.0
        rows = [float(unit.advance(2e-4, **{"u[1]": 50.0 if k >= 20 else 0.0}).get("y_pi[1]")) for k in range(100)]
    np.testing.assert_array_equal(rows, plain.values[1:, plain.columns.index("plant.y_pi[1]")])


def test_a_scenario_needs_the_record(scenario: Path) -> None:
    with pytest.raises(InputError, match=r"amplified.toml: instance.amplifier.unit is not a unit.*\(valid: BeamPlant"):
        run(scenario)
    scenario.write_text(SCENARIO.replace('unit = "Gain"', 'unit = "Gain"\nbasis = "segment"'))
    with pytest.raises(InputError, match=r"instance.amplifier.basis and order belong to a BeamPlant"):
        run(scenario, kinds=[GAIN])
