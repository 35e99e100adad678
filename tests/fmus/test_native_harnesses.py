"""The C harnesses of tests/native: a whole life under sanitizers and valgrind, allocations, fuzzing, other machines."""

import json
import os
import shutil
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest

from flexbeams.fmus.packaging.native import HEADERS
from flexbeams.fmus.units.native_kernel import NATIVE
from tests.helpers import UNITS, design_of
from tests.native.workshop import (
    FUNCTIONS,
    HARNESSES,
    INCLUDES,
    NATIVE_UNITS,
    STRICT,
    UNIT,
    compiled,
    guid_of,
    native_folder,
    needs,
    run,
    source_file,
    workspace,
)

pytestmark = pytest.mark.native

UNDEFINED = "undefined,float-cast-overflow"
# Without optimisation, which removes some of the checks and takes five times as long to compile
CHECKED = ("-O0", "-gline-tables-only", "-fno-sanitize-recover=all")
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="the harness is for Linux")


@needs("clang")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_life_cycle_under_sanitizers(unit: str) -> None:
    """AddressSanitizer with its leak check and UndefinedBehaviorSanitizer, misuse included."""
    program = compiled("life_cycle", unit, "clang", *CHECKED, f"-fsanitize=address,{UNDEFINED}")
    assert "lines logged" in run([str(program)])


@needs("gcc", "valgrind")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_life_cycle_under_valgrind(unit: str) -> None:
    program = compiled("life_cycle", unit, "gcc", "-O0", "-g")
    run(["valgrind", "-q", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=all", str(program)])


@on_linux
@needs("clang")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_instances_in_threads_share_nothing(unit: str) -> None:
    """Under ThreadSanitizer, with equal values; a race is reported only while both accesses are in its history."""
    program = compiled("threads", unit, "clang", *CHECKED, "-fsanitize=thread", "-pthread", small=True)
    assert run([str(program)], env=os.environ | {"TSAN_OPTIONS": "history_size=7"}) == "equal\n"


@on_linux
@needs("gcc")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_nothing_is_allocated_between_instantiation_and_free(unit: str) -> None:
    run([str(compiled("allocations", unit, "gcc", "-O0"))])


@needs("gcc")
def test_a_host_that_adds_up_its_steps_gets_the_same_bits() -> None:
    """For 100,000 steps; FLEXBEAMS_STEPS=20000000 for the full measurement, which prints the mean times."""
    steps = os.environ.get("FLEXBEAMS_STEPS", "100000")
    program = compiled("adding_host", UNIT, "gcc", "-O2")
    description = fmpy.read_model_description(native_folder(UNIT))
    references = {v.name: str(v.valueReference) for v in description.modelVariables}
    text = run([str(program), steps, references["y_target[1]"], references["y_pi[1]"]])
    print(text)
    assert text.startswith("equal")


@needs("clang")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_random_calls(unit: str) -> None:
    """A short, seeded run; tests/native/fuzz.sh runs for as long as wanted."""
    program = compiled("fuzz", unit, "clang", *CHECKED, f"-fsanitize=fuzzer,address,{UNDEFINED}", small=True)
    run([str(program), "-seed=1", "-runs=4000", "-max_len=300", "-verbosity=0", f"-artifact_prefix={workspace()}/"])


@on_linux
@needs("gcc")
@pytest.mark.parametrize("place", ["C", "de_DE.UTF-8"])
def test_numbers_in_the_log_are_written_as_by_python(place: str) -> None:
    """With all digits, in any locale."""
    environment = dict(os.environ)
    if place != "C":
        if shutil.which("localedef") is None or not Path("/usr/share/i18n/locales/de_DE").exists():
            pytest.skip("not installed: locales")
        environment["LOCPATH"] = str(workspace() / "locales")
        Path(environment["LOCPATH"]).mkdir()
        run(["localedef", "-i", "de_DE", "-f", "UTF-8", str(workspace() / "locales" / place)])
    rng = np.random.default_rng(3)
    special = [
        0.5,
        -0.0,
        1e5,
        1e-5,
        1e-4,
        3.0,
        1e15,
        1e16,
        1.234e22,
        123456789012345680.0,
        9007199254740993.0,
        5e-324,
        1.7976931348623157e308,
        0.1 + 0.2,
    ]
    numbers = (rng.normal(size=200) * 10.0 ** rng.integers(-12, 14, 200)).tolist() + special
    program = workspace() / "texts"
    files = [HARNESSES / "texts.c", NATIVE / "units" / "format_line.c"]
    run(["gcc", "-O1", *STRICT, *INCLUDES, *map(str, files), "-o", str(program), "-lm"])
    lines = run([str(program), place, *map(repr, numbers)], env=environment).splitlines()
    for number, line in zip(numbers, lines, strict=False):
        whole, general, rounded = line.split()
        assert (whole, general) == (repr(number), f"{number:.6g}")
        assert rounded == f"{number:.1f}" or abs(number) >= 1e15
    assert lines[len(numbers) :] == ["'100 ?s?' -3 7"]


@on_linux
@needs("gcc", "nm")
def test_units_link_into_one_program_under_their_prefixes() -> None:
    """Without a flag; and the loop over the FMI functions equals the bare arithmetic to the last bit."""
    folder = workspace() / "prefixed"
    folder.mkdir()
    flags = ("-O2", "-std=c99", "-ffp-contract=off")
    for unit in NATIVE_UNITS:
        run(["gcc", *flags, f"-I{HEADERS}", "-c", str(source_file(unit))], cwd=folder)
        assert external_names(folder / f"{unit}.o") == [f"{unit}_{name}" for name in FUNCTIONS]
    program = folder / "closed_loop"
    objects = sorted(map(str, folder.glob("*.o")))
    run(["gcc", *flags, *INCLUDES, str(HARNESSES / "closed_loop.c"), *objects, "-o", str(program), "-lm"])
    target = np.linalg.pinv(design_of().arrays["static_inverse"]) @ [300.0, -100.0, 200.0, 150.0]
    guids = [guid_of(unit) for unit in UNITS]
    result = json.loads(run([str(program), "3000", *guids, *map(str, target)]))
    assert result["fmi_result"] == result["bare_result"]
    assert abs(result["fmi_result"]) > 1e-7


@needs("gcc", "nm")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
@pytest.mark.parametrize(
    ("headers", "flag", "prefix"),
    [
        (HEADERS, "-DFMI2_OVERRIDE_FUNCTION_PREFIX", ""),
        (HEADERS, "-DFMI2_FUNCTION_PREFIX=rig_", "rig_"),
        (Path(fmpy.__file__).parent / "c-code", "-DNDEBUG", ""),
    ],
    ids=["override", "other_prefix", "fmpy_headers"],
)
def test_names_of_the_functions(unit: str, headers: Path, flag: str, prefix: str, tmp_path: Path) -> None:
    """Plain ones for a shared library, those of another prefix where the host chooses it."""
    run(["gcc", "-std=c99", flag, f"-I{headers}", "-c", str(source_file(unit))], cwd=tmp_path)
    assert external_names(tmp_path / f"{unit}.o") == [f"{prefix}{name}" for name in FUNCTIONS]


def external_names(file: Path) -> list[str]:
    """What an object file defines for others."""
    return sorted(line.split()[-1] for line in run(["nm", "-g", "--defined-only", str(file)]).splitlines() if line)
