"""Tables of `flexbeams design` on the terminal."""

import io

import numpy as np
import pytest
from rich.console import Console

from flexbeams.scenarios.cli.design_tables import static_gains

GAIN = np.random.default_rng(1).uniform(-20e-6, 20e-6, (13, 13))


@pytest.mark.parametrize(("pairs", "width", "tables"), [(13, 80, 5), (13, 120, 3), (4, 100, 1), (4, 30, 2)])
def test_static_gains_are_whole_in_any_width(pairs: int, width: int, tables: int) -> None:
    summary = {"inputs": pairs, "static_gain_pi": GAIN[:, :pairs], "static_gain_reduced_pi": 0.9 * GAIN[:, :pairs]}
    made = static_gains(summary, width)
    assert len(made) == tables
    out = io.StringIO()
    console = Console(file=out, width=max(width, 60))
    for table in made:
        console.print(table)
    text = out.getvalue()
    for value in GAIN[:, :pairs].ravel():
        assert f"{1e6 * value:.3f} ({0.9e6 * value:.3f})" in text
