"""The order of test files: those that take longest come first, so that in the end no process works alone on one."""

from pathlib import Path

TESTS = Path(__file__).parent
LONGEST = (
    "fmus/test_native_build.py",
    "test_distribution.py",
    "fmus/test_foreign_platforms.py",
    "scenarios/test_scenarios.py",
    "fmus/test_native_harnesses.py",
    "fmus/test_plant_unit.py",
    "fmus/test_native_readme.py",
    "scenarios/test_masters.py",
    "scenarios/test_studies.py",
    "scenarios/test_container.py",
    "fmus/test_modal.py",
    "scenarios/test_tuning.py",
    "scenarios/test_tutorial.py",
    "scenarios/test_bench.py",
    "controller/test_robustness.py",
    "scenarios/test_report_browser.py",
    "scenarios/test_validation.py",
    "fmus/test_new_kind.py",
)


def place_of(file: Path) -> int:
    """Where a test file stands in the order; those that are not listed have one place together."""
    name = file.relative_to(TESTS).as_posix() if file.is_relative_to(TESTS) else ""
    return LONGEST.index(name) if name in LONGEST else len(LONGEST)
