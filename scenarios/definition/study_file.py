"""Study files: found by name, read once."""

from dataclasses import dataclass
from os.path import isfile
from pathlib import Path

from flexbeams.plant.errors import InputError, missing_file_hint, suggestion
from flexbeams.plant.text import quoted
from flexbeams.plant.validation import parse_toml, read_text, validate
from flexbeams.scenarios.definition.scenario_file import LIBRARY, ScenarioFile, first_comment, load_scenario
from flexbeams.scenarios.definition.study import Study

STUDIES = LIBRARY / "studies"


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """A study as read from its file, with its scenario."""

    path: Path
    study: Study
    description: str  # the first comment: what the study asks
    scenario: ScenarioFile

    @property
    def name(self) -> str:
        """The study's name, which is that of its folder of results."""
        return self.path.stem


def study_files() -> dict[str, Path]:
    """Paths of the shipped studies by name."""
    return {path.stem: path for path in sorted(STUDIES.glob("*.toml"))}


def load_study(name: str | Path) -> StudyFile:
    """A study given as a shipped name or as a file, with its scenario.

    Raises InputError with one line that names file, key, rule and value.
    """
    path = _find_study(str(name))
    text = read_text(path)
    study = validate(Study, parse_toml(text, str(path)), str(path))
    neighbour = path.parent / study.scenario
    try:
        scenario = load_scenario(neighbour if isfile(neighbour) else study.scenario)
    except InputError as error:
        raise error if error.source else InputError("scenario", error.rule, source=str(path)) from None
    return StudyFile(path=path, study=study, description=first_comment(text), scenario=scenario)


def _find_study(name: str) -> Path:
    shipped = study_files()
    if name in shipped:
        return shipped[name]
    if isfile(name):
        return Path(name)
    hint = missing_file_hint(name) or suggestion(name, shipped)
    raise InputError("study", f"{quoted(name)} is neither a file nor a shipped study{hint}")
