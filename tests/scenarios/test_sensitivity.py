"""Sensitivities: closed forms, SALib as an independent implementation, intervals that hold, failed runs left out."""

from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from flexbeams.plant.basis import Array
from flexbeams.scenarios.studies.sensitivity import rank_indices, saltelli_indices

A, B = 7.0, 0.1


def ishigami(x: Array) -> Array:
    """sin x1 + a sin^2 x2 + b x3^4 sin x1 of inputs uniform in -pi ... pi."""
    y: Array = np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])
    return y


# Closed form of Ishigami and Homma, 1990
V1, V2, V13 = (1 + B * np.pi**4 / 5) ** 2 / 2, A**2 / 8, B**2 * np.pi**8 * 8 / 225
FIRST = np.array([V1, V2, 0.0]) / (V1 + V2 + V13)
TOTAL = np.array([V1 + V13, V2, V13]) / (V1 + V2 + V13)


def saltelli_blocks(n: int, groups: list[list[int]]) -> Array:
    numbers = 2 * np.pi * qmc.Sobol(6, seed=np.random.default_rng(1)).random(n) - np.pi
    blocks = np.empty((n, len(groups) + 2))
    first, second = numbers[:, :3], numbers[:, 3:]
    blocks[:, 0], blocks[:, 1] = ishigami(first), ishigami(second)
    for k, columns in enumerate(groups):
        mixed = first.copy()
        mixed[:, columns] = second[:, columns]
        blocks[:, 2 + k] = ishigami(mixed)
    return blocks


def test_saltelli_indices_are_those_in_closed_form() -> None:
    found = saltelli_indices(saltelli_blocks(4096, [[0], [1], [2]]))
    np.testing.assert_allclose([i.first for i in found], FIRST, atol=0.02)
    np.testing.assert_allclose([i.total for i in found], TOTAL, atol=0.02)
    for index, first, total in zip(found, FIRST, TOTAL, strict=True):
        assert index.first_low - 0.01 < first < index.first_high + 0.01
        assert index.total_low is not None
        assert index.total_high is not None
        assert index.total_low - 0.01 < total < index.total_high + 0.01


def test_a_group_is_one_input() -> None:
    """x1 and x3 together explain all that x2 does not."""
    pair, other = saltelli_indices(saltelli_blocks(4096, [[0, 2], [1]]))
    assert pair.first == pytest.approx(1 - FIRST[1], abs=0.02)
    assert pair.total == pytest.approx(1 - FIRST[1], abs=0.02)
    assert other.total == pytest.approx(FIRST[1], abs=0.02)


def test_salib_finds_the_same_indices() -> None:
    """Its estimators are the same; it scales by the standard deviation."""
    sobol: Any = pytest.importorskip("SALib.analyze.sobol")
    blocks = saltelli_blocks(512, [[0], [1], [2]])
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": [[-np.pi, np.pi]] * 3}
    order = np.column_stack([blocks[:, 0], blocks[:, 2:], blocks[:, 1]]).ravel()
    theirs = sobol.analyze(problem, order, calc_second_order=False, num_resamples=400, seed=1)
    ours = saltelli_indices(blocks)
    np.testing.assert_allclose([i.first for i in ours], theirs["S1"], atol=5e-3)
    np.testing.assert_allclose([i.total for i in ours], theirs["ST"], atol=5e-3)
    widths = [(i.first_high - i.first_low) / 2 for i in ours]
    np.testing.assert_allclose(widths, theirs["S1_conf"], rtol=0.35)


def test_rank_indices_are_those_in_closed_form() -> None:
    x = 2 * np.pi * qmc.LatinHypercube(3, seed=np.random.default_rng(2)).random(4096) - np.pi
    found = rank_indices(x, ishigami(x)[:, None], [[0], [1], [2], [0, 2]])[0]
    expected = [*FIRST, 1 - FIRST[1]]
    for index, value in zip(found, expected, strict=True):
        assert index.first == pytest.approx(value, abs=0.08)
        assert index.first_low - 0.03 < value < index.first_high + 0.03


def test_intervals_of_ranks_hold_as_often_as_they_say() -> None:
    """Of a sum, 200 times: 95 % intervals contain the index in 90 to 99 % of them."""
    weights = np.array([2.0, 1.0, 1.0])
    exact = weights**2 / np.sum(weights**2)
    generator, inside = np.random.default_rng(3), 0
    for _ in range(200):
        x = generator.random((256, 3))
        index = rank_indices(x, (x @ weights)[:, None], [[0]])[0][0]
        inside += index.first_low <= exact[0] <= index.first_high
    assert 180 <= inside <= 199


def test_nothing_is_estimated_where_nothing_varies() -> None:
    assert saltelli_indices(np.ones((64, 4))) == []
    x = np.random.default_rng(1).random((64, 2))
    constant, alone = rank_indices(x, np.column_stack([np.ones(64), x[:, 0]]), [[0], [1]])
    assert constant == []
    expected = rank_indices(x, x[:, :1], [[0], [1]])[0]
    assert [i.first for i in alone] == pytest.approx([i.first for i in expected])
    assert rank_indices(x[:8], np.arange(8.0)[:, None], [[0]]) == [[]]
