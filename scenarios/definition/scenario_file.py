"""Scenario files: found by name, read once."""

import os
from dataclasses import dataclass
from os.path import isfile
from pathlib import Path

from flexbeams.plant.errors import InputError, missing_file_hint, suggestion
from flexbeams.plant.structure import STRUCTURES_FOLDER
from flexbeams.plant.text import quoted
from flexbeams.plant.validation import parse_toml, read_text, validate
from flexbeams.scenarios.definition.schema import Scenario

LIBRARY = Path(__file__).parents[1] / "library"
TOUR = (  # order of the shipped scenarios in a list; others follow by name
    "step_response",
    "feedforward",
    "tracking",
    "disturbance_open_loop",
    "disturbance",
    "disturbance_tuned",
    "retarget",
    "high_fidelity",
    "high_fidelity_exact_statics",
    "mismatch",
    "offset_free",
    "offset_free_high_fidelity",
    "identification_steps",
    "identified",
    "identified_offset_free",
    "hysteresis",
    "hysteresis_compensated",
    "hysteresis_imperfect",
    "hysteresis_offset_free",
    "creep_uncompensated",
    "creep",
    "single_beam",
    "five_beams",
)


@dataclass(frozen=True, kw_only=True)
class ScenarioFile:
    """A scenario as read from its file."""

    path: Path  # files that the scenario names are relative to its folder
    scenario: Scenario
    description: str  # the first comment: what the scenario shows
    open_loop: "ScenarioFile | None" = None  # the one that its key open_loop names

    @property
    def name(self) -> str:
        """The scenario's name, which is that of its results."""
        return os.fsencode(self.path.stem).decode("utf-8", "replace")

    @property
    def folder_name(self) -> str:
        """Name of the default folder for results."""
        return self.name


def scenario_files() -> dict[str, Path]:
    """Paths of the shipped scenarios by name, in the order of TOUR."""
    files = {path.stem: path for path in sorted(LIBRARY.glob("*.toml"))}
    names = [*(name for name in TOUR if name in files), *(name for name in files if name not in TOUR)]
    return {name: files[name] for name in names}


def structure_files() -> dict[str, Path]:
    """Paths of the shipped structures by name."""
    return {path.stem: path for path in sorted(STRUCTURES_FOLDER.glob("*.toml"))}


def find_scenario(name: str) -> Path:
    """Path of a scenario given as a shipped name or as a file; InputError where there is none."""
    shipped = scenario_files()
    if name in shipped:
        return shipped[name]
    if Path(name).suffix.lower() == ".fmu":
        raise InputError("scenario", "must be a scenario or an SSP package, which name FMUs", name)
    if Path(name).suffix.lower() == ".ssd" or isfile(f"{name}/SystemStructure.ssd"):
        raise InputError("scenario", "is part of an unpacked SSP package; give the package, NAME.ssp", name)
    if isfile(name):  # False also for a name that no file can have
        return Path(name)
    hint = missing_file_hint(name) or suggestion(name, shipped)
    raise InputError("scenario", f"{quoted(name)} is neither a file nor a shipped scenario{hint}")


def load_scenario(name: str | Path) -> ScenarioFile:
    """A scenario given as a shipped name or as a file, with the one that its key open_loop names.

    Raises InputError with one line that names file, key, rule and value.
    """
    path = find_scenario(str(name))
    loaded = _read(path)
    compared = loaded.scenario.open_loop
    if compared is None:
        return loaded
    neighbour = path.parent / compared
    try:
        open_loop = _read(neighbour if isfile(neighbour) else find_scenario(compared))
    except InputError as error:
        raise error if error.source else InputError("open_loop", error.rule, source=str(path)) from None
    if open_loop.scenario.open_loop is not None:
        raise InputError("open_loop", "must be a scenario without an open_loop of its own", compared, source=str(path))
    return ScenarioFile(path=path, scenario=loaded.scenario, description=loaded.description, open_loop=open_loop)


def read_scenario(path: Path) -> Scenario:
    """A scenario file, checked; InputError in one line otherwise."""
    return _read(path).scenario


def _read(path: Path) -> ScenarioFile:
    text = read_text(path)
    scenario = validate(Scenario, parse_toml(text, str(path)), str(path))
    for name in scenario.instance:
        if not name.isidentifier():
            rule = "must be a name of letters, digits and underscores"
            raise InputError(f"instance.{name}", rule, source=str(path))
    return ScenarioFile(path=path, scenario=scenario, description=first_comment(text))


def first_comment(text: str) -> str:
    """The first comment of a scenario file's text, on one line."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return " ".join(lines)
