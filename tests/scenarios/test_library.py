"""Libraries of units are found by CPU and system: FMI 2.0's folder may hold those of another CPU."""

import io
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.ssp import export_ssp
from flexbeams.scenarios.importing.library import library_file
from flexbeams.scenarios.masters.catalogue import MASTERS, installed_version
from flexbeams.scenarios.masters.isolation import run_master
from flexbeams.scenarios.processes.children import python_command, python_environment
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.validation.references import reference_checks
from tests.helpers import PUSHED_SCENARIO

pytestmark = pytest.mark.native
OTHER_CPU = b"\x7fELF of another CPU"
SUFFIX = fmpy.sharedLibraryExtension


def rewritten(content: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
    """An archive with changed entries."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as archive, zipfile.ZipFile(out, "w") as changed:
        for name in archive.namelist():
            changed.writestr(name, change(name, archive.read(name)))
    return out.getvalue()


def for_another_cpu(name: str, content: bytes) -> bytes:
    """The entry of a unit as it is on ARM: FMI 2.0's folder has the library of x86_64."""
    return OTHER_CPU if name.startswith(f"binaries/{fmpy.platform}/") else content


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One beam with its control, every FMI 2.0 folder of its units with a library that cannot be loaded."""
    folder = tmp_path_factory.mktemp("another_cpu")
    scenario = folder / "pushed.toml"
    scenario.write_text(PUSHED_SCENARIO.format(stop=0.03))
    file = export_ssp(str(scenario), folder / "pushed.ssp", Settings(record_animation=False))

    def change(name: str, content: bytes) -> bytes:
        return rewritten(content, for_another_cpu) if name.endswith(".fmu") else content

    file.write_bytes(rewritten(file.read_bytes(), change))
    return file


def test_the_folder_of_the_cpu_comes_first(tmp_path: Path) -> None:
    """Then FMI 2.0's; without either the error lists what is there."""
    folders = [tmp_path / "binaries" / name for name in (fmpy.platform_tuple, fmpy.platform)]
    for folder in reversed(folders):
        folder.mkdir(parents=True)
        (folder / f"Unit{SUFFIX}").write_bytes(b"")
        assert library_file(tmp_path, "Unit") == folder / f"Unit{SUFFIX}"
    with pytest.raises(
        InputError, match=f"has no Other{SUFFIX} in binaries/.*; its binaries are for .*{fmpy.platform}"
    ):
        library_file(tmp_path, "Other")
    with pytest.raises(InputError, match="its binaries are for no platform"):
        library_file(tmp_path / "binaries", "Unit")


def test_runs_and_validation_load_the_library_of_the_cpu(package: Path, tmp_path: Path) -> None:
    result = run_package(package, Settings(record_animation=False, build_folder=tmp_path))
    assert np.ptp(result.recording.values) > 0
    unit = tmp_path / "BeamPlant.fmu"
    with zipfile.ZipFile(package) as archive:
        unit.write_bytes(archive.read("resources/BeamPlant.fmu"))
    checks = reference_checks(unit)
    assert len(checks) == 2
    assert all(check.passed and "agrees" in check.message for check in checks)


@pytest.mark.masters
@pytest.mark.parametrize("name", ["FMPy", "PathSim", "sofirpy"])
def test_tools_that_load_by_fmpy_get_the_library_of_the_cpu(name: str, package: Path) -> None:
    if installed_version(MASTERS[name]) is None:
        pytest.skip(f"{MASTERS[name].distribution} is not installed")
    trace = run_master(name, package, signals=["plant.y_pi[1]"])
    assert np.ptp(trace.values) > 0


def test_a_unit_for_other_platforms_is_refused_in_one_line(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def elsewhere(content: bytes) -> bytes:
        out = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(content)) as archive, zipfile.ZipFile(out, "w") as changed:
            for name in archive.namelist():
                moved = name.replace(fmpy.platform_tuple, "riscv64-linux").replace(f"/{fmpy.platform}/", "/beos64/")
                changed.writestr(moved, archive.read(name))
        return out.getvalue()

    file = tmp_path / "elsewhere.ssp"
    file.write_bytes(rewritten(package.read_bytes(), lambda n, c: elsewhere(c) if n.endswith(".fmu") else c))
    assert main(["run", str(file), "--out", str(tmp_path / "out")]) == 2
    [error] = [line for line in capsys.readouterr().err.splitlines() if line.startswith("flexbeams: ")]
    assert f"{SUFFIX} in binaries/{fmpy.platform_tuple}" in error
    assert "its binaries are for beos64, riscv64-linux" in error


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a case of ARM Linux")
def test_importing_fmpy_prints_nothing_on_arm() -> None:
    """FMPy's logger library exists for x86_64 only."""
    code = """
import os, sys
os.uname = lambda: os.uname_result(("Linux", "pi", "6", "1", "aarch64"))
import flexbeams.scenarios, fmpy.fmi2
print(fmpy.platform_tuple, hasattr(sys.modules["fmpy.logging"], "__file__"))
"""
    done = subprocess.run(
        python_command("-c", code), capture_output=True, text=True, check=True, env=python_environment()
    )
    assert done.stdout == "aarch64-linux False\n"
