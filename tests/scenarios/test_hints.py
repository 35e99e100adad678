"""Hints in messages: ranges of indices, what the design fixes, files that were probably meant."""

from collections.abc import Callable
from pathlib import Path

import pytest

from flexbeams.scenarios.cli.main import main

Write = Callable[[str, str], Path]
PLANT = 'title = "t"\nstructure = "{}"\nstop_time = 0.1\n[instance.plant]\nunit = "BeamPlant"\n'


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("plant.beam[9].tip_mass=0.01", "must have an index from 1 to 3"),
        ("plant.beam[0].tip_mass=0.01", "must have an index from 1 to 3"),
        ("plant.u[5]=1", "must have an index from 1 to 4"),
        ("plant.beam[1].length=0.5", "is geometry, which the design fixes: change it in the structure file"),
        ("plant.patch[].position=0.1", "is geometry, which the design fixes"),
        ("plant.strain_gauge[1].position=0.1", "is geometry, which the design fixes"),
        ("plant.beam[1].tip_mas=0.01", "is not a variable; did you mean 'beam[].tip_mass'"),
    ],
)
def test_names_of_variables(value: str, said: str, at_run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "step_response", "--set", value]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert f"--set {value.partition('=')[0]} {said}" in line


def test_a_name_that_is_a_file_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(PLANT.format("rig"))
    (tmp_path / "rig.toml").write_text("")
    for arguments, name in ((["run", "mine"], "mine"), (["design", "--structure", "rig"], "rig")):
        assert main(arguments) == 2
        assert f"did you mean '{name}.toml'?" in capsys.readouterr().err
    assert main(["run", "mine.toml"]) == 2
    assert "structure 'rig' is neither a file nor a shipped structure; did you mean 'rig.toml'?" in (
        capsys.readouterr().err
    )


def test_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A file beside the target of a link is not beside the link: the folder that was searched is named."""
    monkeypatch.chdir(tmp_path)
    real, links = tmp_path / "real", tmp_path / "links"
    real.mkdir()
    links.mkdir()
    (real / "mine.toml").write_text(PLANT.format("rig.toml"))
    (real / "rig.toml").write_text("")
    (links / "mine.toml").symlink_to(real / "mine.toml")
    (links / "lost.toml").symlink_to(real / "nothing.toml")
    assert main(["run", "links/mine.toml"]) == 2
    assert f"there is none in '{links}'" in capsys.readouterr().err
    assert main(["run", "links/lost.toml"]) == 2
    assert f"it is a link to '{real / 'nothing.toml'}', which does not exist" in capsys.readouterr().err
