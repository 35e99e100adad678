"""The examples in the README files run as they are printed."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from flexbeams.scenarios.cli.main import main
from tests.helpers import ROOT, python_environment, with_shared_units

pytestmark = [pytest.mark.slow, pytest.mark.native]

PAGES = ["README.md", "plant/README.md", "controller/README.md", "fmus/README.md", "scenarios/README.md"]


def blocks(language: str) -> list[tuple[str, str]]:
    """Fenced blocks of one language as (page and number, text)."""
    found = []
    for page in PAGES:
        pattern = rf"^```{language}\n(.*?)^```"
        for k, match in enumerate(re.finditer(pattern, (ROOT / page).read_text(), re.DOTALL | re.MULTILINE), 1):
            found.append((f"{page}#{k}", match.group(1)))
    return found


def commands() -> list[tuple[str, str]]:
    """Lines of shell blocks that call flexbeams; those of the Quick start set up an environment and are left to CI."""
    texts = [(place, text) for place, text in [*blocks("sh"), *blocks("console")] if "venv" not in text]
    return [(f"{place}:{line}", line) for place, text in texts for line in text.strip().splitlines()]


def place_alone(text: str) -> str:
    """The part of a test's name that says where the example stands."""
    return text[:60] if re.match(r"[\w/]+\.md#\d", text) else ""


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the commands of all pages run one after another."""
    return with_shared_units(tmp_path_factory.mktemp("documentation"))


@pytest.mark.parametrize(("place", "line"), commands(), ids=place_alone)
def test_command_example_runs(place: str, line: str, workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program, *arguments = shlex.split(line)
    assert program == "flexbeams", place
    monkeypatch.chdir(workshop)
    assert main(arguments) == 0


@pytest.mark.parametrize(("place", "text"), blocks("python"), ids=place_alone)
def test_python_example_runs(place: str, text: str, workshop: Path) -> None:
    """In the folder where the commands have left their files."""
    if "libcosim" in text:
        pytest.importorskip("libcosimpy")
    done = subprocess.run(
        [sys.executable, "-c", text],
        cwd=workshop,
        env=python_environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{place}: {done.stderr}"


def test_structure_example_is_a_structure(tmp_path: Path) -> None:
    from flexbeams.plant.structure import read_structure

    text = next(text for place, text in blocks("toml") if place.startswith("plant/"))
    path = tmp_path / "example.toml"
    path.write_text(text)
    assert len(read_structure(path).beam) == 1


def test_design_options_example_has_the_defaults() -> None:
    import tomllib

    from flexbeams.controller.options import DesignOptions
    from flexbeams.plant.validation import validate

    text = next(text for place, text in blocks("toml") if place.startswith("controller/"))
    assert validate(DesignOptions, tomllib.loads(text)["design"], "controller/README.md") == DesignOptions()


def scenario_examples() -> list[tuple[str, str]]:
    """The scenarios of a page; a part of one is added to the last whole one before it."""
    examples: list[tuple[str, str]] = []
    whole = ""
    for place, text in (b for b in blocks("toml") if b[0].startswith("scenarios/") and "[[parameter]]" not in b[1]):
        is_whole = re.search("^title = ", text, re.MULTILINE) is not None
        examples.append((place, text if is_whole else whole + text))
        whole = text if is_whole else whole
    return examples


@pytest.mark.parametrize(("place", "text"), scenario_examples(), ids=place_alone)
def test_scenario_example_runs(place: str, text: str, workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = workshop / "sweep.toml"
    path.write_text(text)
    monkeypatch.chdir(workshop)
    assert main(["run", "sweep.toml", "--no-report"]) == 0
    shutil.rmtree(workshop / "results" / "sweep")


def test_study_example_runs(workshop: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With few runs."""
    text = next(text for place, text in blocks("toml") if "[[parameter]]" in text)
    (workshop / "mine.toml").write_text(text)
    monkeypatch.chdir(workshop)
    assert main(["study", "mine.toml", "--runs", "4", "--jobs", "1", "--no-report"]) == 0


def test_pages_name_only_files_that_exist() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", (ROOT / page).read_text()):
            assert ((ROOT / page).parent / target).exists(), f"{page}: {target}"
