"""Deflections that voltages reach: rank, nearest targets, points that no pair moves."""

from dataclasses import replace

import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reach import reach_of
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
