"""Decimation: few rows, and no peak lost."""

import numpy as np
import pytest

from flexbeams.scenarios.results.decimation import decimated, plotted_rows


def noise(rows: int, curves: int) -> np.ndarray:
    return np.random.default_rng(7).standard_normal((rows, curves))


def test_short_curves_keep_every_row():
    assert plotted_rows(noise(100, 3), 100).tolist() == list(range(100))


@pytest.mark.parametrize("rows", [1001, 20_000, 99_991])
@pytest.mark.parametrize("curves", [1, 4])
def test_limit_holds_and_the_ends_stay(rows, curves):
    kept = plotted_rows(noise(rows, curves), 1000)
    assert len(kept) <= 1000
    assert kept[0] == 0
    assert kept[-1] == rows - 1
    assert np.all(np.diff(kept) > 0)


@pytest.mark.parametrize("row", [0, 1, 31_007, 49_998, 49_999])
@pytest.mark.parametrize("peak", [-50.0, 50.0])
def test_a_peak_of_one_row_stays_in_any_of_the_curves(row, peak):
    values = noise(50_000, 3)
    values[row, 2] = peak
    assert row in plotted_rows(values, 800)


def test_every_stretch_keeps_the_extremes_of_a_smooth_curve():
    time = np.arange(40_000) * 1e-4
    values = np.sin(300 * time) * np.exp(-time)
    t, y = decimated(time, values, 2000)
    stretch = 40
    blocks = values.reshape(-1, stretch)
    for k, block in enumerate(blocks):
        inside = (t >= time[k * stretch]) & (t <= time[(k + 1) * stretch - 1])
        assert y[inside].max() == block.max()
        assert y[inside].min() == block.min()


def test_missing_values_hide_no_extreme():
    values = noise(30_000, 2)
    values[:15_000, 0] = np.nan
    values[20_000, 0] = 30.0
    values[4_000, 1] = -30.0
    kept = plotted_rows(values, 500)
    assert {20_000, 4_000} <= set(kept.tolist())


def test_rows_with_nothing_but_missing_values_are_no_obstacle():
    assert len(plotted_rows(np.full((5_000, 2), np.nan), 100)) <= 100
