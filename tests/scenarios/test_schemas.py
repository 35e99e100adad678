"""Schemas, pages of keys, skeletons and shipped files."""

import json
import tomllib
from pathlib import Path

import pytest

from flexbeams.plant.parameters import PARAMETERS
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.key_texts import KEYS
from flexbeams.scenarios.definition.scenario_file import scenario_files, structure_files
from flexbeams.scenarios.definition.schemas import FILES, json_schema, key_page, tables
from flexbeams.scenarios.definition.study_file import study_files
from tests.helpers import ROOT

PAGES = {
    "structure": ROOT / "plant/structure_keys.md",
    "scenario": ROOT / "scenarios/scenario_keys.md",
    "study": ROOT / "scenarios/study_keys.md",
}
SHIPPED = {"structure": structure_files(), "scenario": scenario_files(), "study": study_files()}


def test_every_key_has_its_text_and_every_text_its_key() -> None:
    described = {}
    for kind, file in FILES.items():
        for name, table in tables(json_schema(kind), file.__name__).items():
            described[name] = set(table["properties"])
    assert described == {name: set(texts) for name, texts in KEYS.items()}
    for parameter in PARAMETERS:
        assert KEYS[parameter.part.capitalize()][parameter.name][0] == parameter.unit


@pytest.mark.parametrize("kind", list(FILES))
def test_the_page_is_that_of_the_schema(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Written by `flexbeams schema KIND --page`."""
    assert main(["schema", kind, "--page"]) == 0
    assert capsys.readouterr().out == key_page(kind) + "\n" == PAGES[kind].read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", list(FILES))
def test_shipped_files_follow_the_schema(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    assert main(["schema", kind]) == 0
    schema = json.loads(capsys.readouterr().out)
    validator = jsonschema.Draft202012Validator(schema)
    validator.check_schema(schema)
    for path in SHIPPED[kind].values():
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        validator.validate(table)
        assert not validator.is_valid({**table, "unknown": 1})


@pytest.mark.native
def test_skeletons_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Scenario and structure as they are written, together; nothing is replaced."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "structure", "rig"]) == 0
    assert main(["new", "scenario", "mine.toml"]) == 0
    assert capsys.readouterr().out == "rig.toml\nmine.toml\n"
    assert main(["run", "mine.toml", "--structure", "rig.toml", "--no-report", "--no-figures"]) == 0
    shown = capsys.readouterr()
    assert "unusual" not in shown.err
    assert "error at the end" in shown.out
    (tmp_path / "rig.toml").write_text("mine")
    for arguments, message in (
        (["rig"], "NAME must be a new file, got 'rig.toml'"),
        (["none/rig"], "NAME must be in a folder that exists"),
        (['a"b'], "NAME must be a name of printable characters"),
        *(([name], "NAME must end with the name of a file") for name in ("/", ".", "..", "...", "", ".toml")),
    ):
        assert main(["new", "structure", *arguments]) == 2
        assert message in capsys.readouterr().err
    assert (tmp_path / "rig.toml").read_text() == "mine"


def test_shipped_files_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    for name, path in (
        ("tracking", scenario_files()["tracking"]),
        ("kiel", structure_files()["kiel"]),
        ("single_beam", scenario_files()["single_beam"]),
        ("structure/single_beam", structure_files()["single_beam"]),
    ):
        assert main(["show", name]) == 0
        assert capsys.readouterr().out == path.read_text(encoding="utf-8")
    assert main(["show", "keil"]) == 2
    assert "NAME is not a shipped scenario, study or structure; did you mean 'kiel'?" in capsys.readouterr().err


def test_structures_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    _, structures = capsys.readouterr().out.split("\nStructures:\n")
    assert [line.split()[0] for line in structures.splitlines()] == list(structure_files())
