"""Deflections that voltages reach: rank, nearest targets, points that no pair moves."""

from dataclasses import replace

import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reach import idle_voltages, reach_of, voltages_within
from flexbeams.controller.voltage_limits import VoltageLimits
from flexbeams.plant.structure import PointOfInterest, Structure, find_structure, read_structure
from tests.helpers import design_of

SINGLE = read_structure(find_structure("single_beam"))


def with_points(*positions: float) -> Structure:
    """The single beam with points of interest there."""
    return replace(SINGLE, point_of_interest=tuple(PointOfInterest(beam=1, position=z) for z in positions))


def with_a_second_beam() -> Structure:
    """Another beam beside it that nothing joins, with a point of interest."""
    points = (*SINGLE.point_of_interest, PointOfInterest(beam=2, position=0.39))
    return replace(SINGLE, beam=(*SINGLE.beam, SINGLE.beam[0]), point_of_interest=points)


def test_every_target_is_reachable_with_as_many_pairs_as_points() -> None:
    made = design_of()
    assert made.summary["static_rank"] == 4
    G = np.array(made.summary["static_gain_pi"])
    assert made.summary["static_condition"] == pytest.approx(np.linalg.cond(G), rel=1e-12)
    assert not made.arrays["unreachable"].any()
    np.testing.assert_allclose(G @ made.arrays["static_inverse"], np.eye(4), atol=1e-12)


def test_more_points_than_pairs() -> None:
    """The rest of a target is orthogonal to what the pair reaches, and the voltages are those of the nearest one."""
    made = compute_design(with_points(0.39, 0.25))
    G, target = np.array(made.summary["static_gain_pi"]), np.array([5e-3, 5e-3])
    missed = made.arrays["unreachable"] @ target
    assert made.summary["static_rank"] == 1
    assert np.abs(missed).max() > 1e-3
    np.testing.assert_allclose(G.T @ missed, 0.0, atol=1e-12 * np.abs(G).max())
    np.testing.assert_allclose(G @ made.arrays["static_inverse"] @ target, target - missed, atol=1e-12)
    assert made.summary["warnings"] == [
        "the patch pairs move 2 points of interest in 1 independent way only: other targets are refused"
    ]


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_points_that_no_pair_moves(basis: str) -> None:
    """Before its patch a beam stays straight: no pseudo-inverse of rounding, nor of Galerkin's error there."""
    before = compute_design(with_points(0.01), DesignOptions(basis=basis))  # type: ignore[arg-type]
    assert not before.arrays["static_inverse"].any()
    assert before.arrays["unreachable"] == 1.0
    assert before.summary["static_rank"] == 0
    assert "point_of_interest[1] is moved by no patch pair: targets there are refused" in before.summary["warnings"]
    apart = compute_design(with_a_second_beam(), DesignOptions(basis=basis, sample_time=1e-4))  # type: ignore[arg-type]
    np.testing.assert_array_equal(apart.arrays["unreachable"], np.diag([0.0, 1.0]))
    assert not apart.arrays["static_inverse"][:, 1].any()
    assert "point_of_interest[2] is moved by no patch pair: targets there are refused" in apart.summary["warnings"]


def test_nearest_targets_are_an_option() -> None:
    made: Design = compute_design(with_points(0.39, 0.25), DesignOptions(targets="nearest"))
    assert not made.arrays["unreachable"].any()
    assert made.summary["warnings"][0].endswith("other targets are replaced by the nearest reachable ones")


def test_the_cut_is_relative_to_the_largest_deflection_of_the_beams() -> None:
    gain = np.array([[1.0, 0.0], [0.0, 0.5e-3]])
    assert reach_of(gain, 1.0).rank == 1
    assert reach_of(gain, 0.1).rank == 1
    assert reach_of(np.diag([0.4e-3, 2e-3]), 0.5).rank == 1
    assert reach_of(np.diag([0.4e-3, 2e-3]), 1e-3).rank == 2
    np.testing.assert_allclose(reach_of(gain, 1.0).inverse, np.diag([1.0, 0.0]))


def test_voltages_within_limits_that_hold_the_same() -> None:
    """Two pairs with gains 1 and 2: both d below the limits 400 and 150 V, where (400 - d) + 2 (150 - d) = 500."""
    G = np.array([[1.0, 2.0]])
    inverse = reach_of(G, 2.0).inverse
    idle = idle_voltages(inverse)
    np.testing.assert_allclose(G @ idle, 0.0, atol=1e-15)
    assert idle.shape == (2, 1)
    least = inverse @ [500.0]  # 100 and 200 V
    limits = VoltageLimits(lowest=np.array([-1000.0, -1000.0]), highest=np.array([400.0, 150.0]))
    held = voltages_within(limits, least, idle)
    assert held is not None
    np.testing.assert_allclose(held, [1000.0 / 3, 250.0 / 3])
    tight = VoltageLimits(lowest=limits.lowest, highest=np.array([190.0, 150.0]))
    assert voltages_within(tight, least, idle) is None  # 190 + 2 x 150 = 490 < 500
    assert idle_voltages(reach_of(np.diag([1.0, 2.0]), 2.0).inverse).shape == (2, 0)


def test_voltages_within_limits_beside_a_grid() -> None:
    """Five pairs on three points: within the limits exactly where a fine grid of idle voltages finds some."""
    rng = np.random.default_rng(4)
    G = rng.normal(0.0, 1e-5, (3, 5))
    inverse = reach_of(G, 1e-5).inverse
    idle = idle_voltages(inverse)
    z = np.stack(np.meshgrid(*[np.linspace(-1500.0, 1500.0, 301)] * 2), axis=-1).reshape(-1, 2)
    found = []
    for _ in range(20):
        least = inverse @ G @ rng.uniform(-700.0, 700.0, 5)
        limits = VoltageLimits(lowest=-rng.uniform(100.0, 800.0, 5), highest=rng.uniform(100.0, 800.0, 5))
        candidates = least + z @ idle.T
        distance = np.minimum(limits.highest - candidates, candidates - limits.lowest).min(axis=1).max()
        held = voltages_within(limits, least, idle)
        if held is None:
            assert distance < 0.0
        else:
            np.testing.assert_allclose(G @ held, G @ least, rtol=0.0, atol=1e-12)
            own = np.minimum(limits.highest - held, held - limits.lowest).min()
            assert own >= max(distance - 1e-6, 0.0)
            assert own - distance < 15.0  # the grid is 10 V wide
        found.append(held is not None)
    assert 4 < sum(found) < 16
