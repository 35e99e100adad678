"""The file of static gains: what is written is read back, and every fault names its row or column."""

from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.static_maps import StaticMaps, read_static_maps, write_static_maps

PAIRS, POINTS, GAUGES = 4, 2, 3
HEADER = "pair,y_pi[1] [mm/V],y_pi[2] [m/V],y_pm[1] [um/m/V],y_pm[2] [1/V],y_pm[3] [1/kV]"
ROWS = [f"{pair},{pair},2e-6,3,4e-8,5e-5" for pair in range(1, PAIRS + 1)]


def read(path: Path) -> StaticMaps:
    return read_static_maps(path, pairs=PAIRS, points=POINTS, gauges=GAUGES)


def maps_of(path: Path, *lines: str) -> StaticMaps:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read(path)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "maps.csv"


@pytest.mark.parametrize("intervals", [False, True])
def test_written_maps_read_back_to_the_bit(path: Path, intervals: bool) -> None:
    rng = np.random.default_rng(3)
    deflection, strain = rng.normal(size=(POINTS, PAIRS)), rng.normal(size=(GAUGES, PAIRS)) / 3e7
    halves = {"deflection_interval": abs(deflection) / 7, "strain_interval": abs(strain) / 9} if intervals else {}
    write_static_maps(StaticMaps(deflection=deflection, strain=strain, **halves), path, "measured\non the rig")
    assert path.read_text(encoding="utf-8").startswith("# measured\n# on the rig\npair,y_pi[1] [m/V],")
    back = read(path)
    assert np.array_equal(back.deflection, deflection)
    assert np.array_equal(back.strain, strain)
    if intervals:
        assert back.deflection_interval is not None
        assert np.array_equal(back.deflection_interval, halves["deflection_interval"])
        assert back.strain_interval is not None
        assert np.array_equal(back.strain_interval, halves["strain_interval"])
    else:
        assert back.deflection_interval is None
        assert back.strain_interval is None


def test_units_rows_and_columns_in_any_order(path: Path) -> None:
    maps = maps_of(path, "# note", HEADER, *reversed(ROWS))
    assert np.allclose(maps.deflection, [[1e-3, 2e-3, 3e-3, 4e-3], [2e-6] * 4], rtol=1e-15)
    assert np.allclose(maps.strain, [[3e-6] * 4, [4e-8] * 4, [5e-8] * 4], rtol=1e-15)


@pytest.mark.parametrize(
    ("lines", "match"),
    [
        ([], "has no header line"),
        (["pairs,y_pi[1] [m/V]"], "must start with the column 'pair', got 'pairs'"),
        ([HEADER.replace("y_pi[2] [m/V]", "y_pi[2]"), *ROWS], r"column 'y_pi\[2\]' must read like"),
        ([HEADER.replace("y_pi[2]", "y_pi[5]"), *ROWS], r"y_pi\[5\].* is not an output of the structure"),
        ([HEADER.replace("[m/V]", "[furlong/V]"), *ROWS], "must have one of the units m/V.*'furlong/V'"),
        ([HEADER.replace("y_pi[2] [m/V]", "y_pi[1] [m/V]"), *ROWS], "must not repeat an earlier one"),
        ([HEADER.rsplit(",", 1)[0], *ROWS], r"column y_pm\[3\] is missing"),
        ([HEADER + ",+-y_pi[1] [m/V]", *ROWS], r"column \+-y_pi\[2\] is missing"),
        ([HEADER, *ROWS[:3]], "pair 4 has no row; the structure has 4 patch pairs"),
        ([HEADER, *ROWS, ROWS[1]], "row 6, column pair must not repeat an earlier row, got 2"),
        ([HEADER, *ROWS[:3], "5,1,1,1,1,1"], "row 5, column pair must be a patch pair from 1 to 4, got '5'"),
        ([HEADER, *ROWS[:3], "4,1,1,nan,1,1"], r"row 5, column y_pm\[1\] must be a finite number, got 'nan'"),
        ([HEADER, *ROWS[:3], "4,1,1,1"], r"row 5, column y_pm\[2\] must be a finite number, got ''"),
    ],
)
def test_faults_name_row_and_column(path: Path, lines: list[str], match: str) -> None:
    with pytest.raises(InputError, match=r"maps\.csv: .*" + match):
        maps_of(path, *lines)


def test_a_missing_file_and_one_that_is_not_text_are_refused(path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read(path)
    path.write_bytes(b"\xff\xfe\x00pair")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read(path)
