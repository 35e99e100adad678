"""`flexbeams identify hysteresis`: what it writes and prints, and its refusals."""

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.plant.structure import read_structure
from flexbeams.scenarios.cli.main import main
from tests.oracles.bouc_wen import FILE


def test_structure_page_and_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those of the command, and the same of the function."""
    out = tmp_path / "rig.toml"
    assert main(["identify", "hysteresis", str(FILE), "--pair", "1", "--out", str(out), "--plays", "4"]) == 0
    shown = capsys.readouterr()
    [fitted] = tomllib.loads(shown.out)["actuator"]["pair"]
    structure = read_structure(out)
    assert structure.actuator is not None
    assert structure.actuator.pair[0].play_weights == fitted["play_weights"]
    assert "y_pi[1]: 5.16 % of the stroke off a straight line, the model leaves 1.1" in shown.err
    assert "a compensator made of it leaves 1.2" in shown.err
    page = (tmp_path / "hysteresis.html").read_text(encoding="utf-8")
    assert page.count('<svg class="loop"') == 3
    for text in ("Hysteresis of mfc_loops", "Largest residual", "Variance explained", "predicted remaining error"):
        assert text in page
    again, notes = tmp_path / "again.toml", []
    fit = fb.identify_hysteresis(FILE, pair=1, plays=4, out=again, report=tmp_path / "again.html", notify=notes.append)
    assert notes == []  # no number of operators is tried
    assert again.read_bytes() == out.read_bytes()
    assert (tmp_path / "again.html").read_text(encoding="utf-8") == page
    assert f"leaves {100 * fit.largest_remaining:.3g} % ({100 * fit.rms_remaining:.3g} % rms)" in shown.err


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "hysteresis", str(FILE), "--plays", "4", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert 0.0 < table["largest_residual"] < 0.015
    assert table["pair"]["linear_weight"] > 0.5
    assert table["stroke"] > 0.01


def test_a_structure_without_actuators_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "rig.toml"
    arguments = ["identify", "hysteresis", str(FILE), "--plays", "2", "--out", str(out)]
    bare = tmp_path / "bare.toml"
    text = (Path(__file__).parents[2] / "plant/structures/single_beam.toml").read_text(encoding="utf-8")
    bare.write_text(text.partition("[actuator]")[0], encoding="utf-8")
    assert main([*arguments, "--structure", str(bare)]) == 2
    assert f"{bare}: actuator is missing: the section needs the amplifier" in capsys.readouterr().err
    assert not out.exists()
    assert main([*arguments, "--structure", "single_beam"]) == 0
    assert read_structure(out).actuator is not None


def test_bad_data_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "flat.csv"
    path.write_text("time,u[1],y_pi[1]\n" + "".join(f"{k},0,0\n" for k in range(60)), encoding="utf-8")
    assert main(["identify", "hysteresis", str(path)]) == 2
    assert capsys.readouterr().err == f"flexbeams: {path}: column 'u[1]' must change\n"


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"plays": 13}, "plays must be an integer from 1 to 12, got 13"),
        ({"plays": 2.5}, "plays must be an integer from 1 to 12, got 2.5"),
        ({"plays": True}, "plays must be an integer from 1 to 12, got True"),
        ({"pair": np.int64(1), "plays": np.int64(4), "sensor": "y_pi[9]"}, r"column 'y_pi\[9\]' is missing"),
        ({"pair": 0}, "pair must be an integer >= 1, got 0"),
        ({"sensor": "y_pi[9]"}, r"column 'y_pi\[9\]' is missing"),
        ({"columns": {"y_pi[1]": "laser"}}, "column 'laser' is missing"),
    ],
)
def test_wrong_arguments_of_the_function(options: dict[str, Any], rule: str) -> None:
    with pytest.raises(fb.FlexbeamsError, match=f"^[^\n]*{rule}[^\n]*$"):
        fb.identify_hysteresis(FILE, **options)
