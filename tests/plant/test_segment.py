"""The piecewise polynomials: what they span, nodal exactness in statics, convergence to the exact response."""

from itertools import pairwise

import numpy as np
import pytest

from flexbeams.plant.galerkin import DEFAULT_ORDER, beam_bases, beam_model
from flexbeams.plant.segment import SegmentBasis, split_at
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.oracles.accuracy import FREQUENCIES, errors, response
from tests.oracles.boundary_value import StaticSolution
from tests.oracles.examples import five_beams, single_beam, three_beams

EDGES = (0.0, 0.02, 0.105, 0.19, 0.4)
STRUCTURES = [single_beam(), three_beams(), five_beams()]


def quadrature(start: float, end: float, points: int = 20) -> tuple[np.ndarray, np.ndarray]:
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return start + (end - start) / 2 * (nodes + 1), (end - start) / 2 * weights


def test_pieces_are_sorted_and_distinct() -> None:
    assert split_at(0.4, [0.3, 0.1, 0.1 + 1e-13, 0.2]) == (0.0, 0.1, 0.2, 0.3, 0.4)


def test_cuts_at_the_ends_make_no_piece() -> None:
    assert split_at(0.4, [0.0, 0.4, 0.4 - 1e-14, 1e-14]) == (0.0, 0.4)


def test_touching_pairs_share_a_cut() -> None:
    edges = [basis.edges for basis in beam_bases(five_beams(), "segment", 3) if isinstance(basis, SegmentBasis)]
    assert [len(e) - 1 for e in edges] == [4, 2, 1, 5, 2]


@pytest.mark.parametrize("degree", [3, 4, 5, 9, 14])
def test_size(degree: int) -> None:
    basis = SegmentBasis(EDGES, degree)
    assert basis.size == 4 * (degree - 1)
    assert basis.evaluate(np.linspace(0, 0.4, 7), 1).shape == (7, basis.size)


@pytest.mark.parametrize("degree", [3, 4, 9])
def test_each_derivative_integrates_to_the_one_before(degree: int) -> None:
    basis = SegmentBasis(EDGES, degree)
    for start, end in pairwise(EDGES):
        z, weights = quadrature(start, end)
        inside = np.array([start, end]) + np.array([1, -1]) * 1e-15
        for derivative in (1, 2):
            first, last = basis.evaluate(inside, derivative - 1)
            exact = weights @ basis.evaluate(z, derivative)
            np.testing.assert_allclose(last - first, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize("degree", [3, 6, 9])
def test_deflection_and_slope_are_continuous_and_clamped(degree: int) -> None:
    basis = SegmentBasis(EDGES, degree)
    inner = np.array(EDGES[1:-1])
    for derivative in (0, 1):
        left = basis.evaluate(np.nextafter(inner, 0), derivative)
        np.testing.assert_allclose(left, basis.evaluate(inner, derivative), rtol=0, atol=1e-12)
        np.testing.assert_array_equal(basis.evaluate(np.zeros(1), derivative), np.zeros((1, basis.size)))


def test_curvature_at_a_node_is_that_of_the_piece_on_its_right() -> None:
    basis, inner = SegmentBasis(EDGES, 6), np.array(EDGES[1:-1])
    before, at, after = (basis.evaluate(z, 2) for z in (np.nextafter(inner, 0), inner, np.nextafter(inner, 1)))
    np.testing.assert_allclose(at, after, rtol=1e-9, atol=1e-9)
    assert np.all(np.abs(at - before).max(axis=1) > 1)


def test_unknowns_of_a_node_are_its_deflection_and_slope() -> None:
    """The first two unknowns of each node but the clamp: deflection, and length times slope."""
    basis = SegmentBasis(EDGES, 7)
    nodes = np.array(EDGES[1:])
    expected = np.zeros((2, 4, basis.size))
    expected[0, np.arange(4), 2 * np.arange(4)] = 1
    expected[1, np.arange(4), 2 * np.arange(4) + 1] = 1
    np.testing.assert_allclose(basis.evaluate(nodes, 0), expected[0], atol=1e-14)
    np.testing.assert_allclose(basis.length * basis.evaluate(nodes, 1), expected[1], atol=1e-13)


@pytest.mark.parametrize("degree", [3, 5, 9])
def test_one_piece_spans_the_clamped_polynomials(degree: int) -> None:
    basis = SegmentBasis((0.0, 0.4), degree)
    z = np.linspace(0, 0.4, 50)
    values = basis.evaluate(z)
    for power in range(2, degree + 1):
        target = (z / 0.4) ** power
        found = values @ np.linalg.lstsq(values, target, rcond=None)[0]
        np.testing.assert_allclose(found, target, atol=1e-12)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("degree", [3, 5, 9])
def test_gram_is_symmetric_and_definite(derivative: int, degree: int) -> None:
    basis = SegmentBasis(EDGES, degree)
    whole = basis.gram(0.0, 0.4, derivative)
    np.testing.assert_array_equal(whole, whole.T)
    scale = np.sqrt(np.diag(whole))
    assert np.linalg.eigvalsh(whole / np.outer(scale, scale))[0] > 1e-7
    part = basis.gram(0.02, 0.105, derivative)
    np.testing.assert_array_equal(part, part.T)
    assert np.linalg.eigvalsh(part / np.outer(scale, scale))[0] > -1e-14


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize(("start", "end"), [(0.0, 0.4), (0.02, 0.105), (0.05, 0.33)])
def test_gram_is_the_integral(start: float, end: float, derivative: int) -> None:
    basis = SegmentBasis(EDGES, 8)
    exact = np.zeros((basis.size, basis.size))
    cuts = [start, *(e for e in EDGES if start < e < end), end]
    for a, b in pairwise(cuts):
        z, weights = quadrature(a, b)
        values = basis.evaluate(z, derivative)
        exact += values.T @ (weights[:, None] * values)
    np.testing.assert_allclose(basis.gram(start, end, derivative), exact, rtol=0, atol=1e-13 * np.abs(exact).max())


def test_gram_is_additive() -> None:
    basis = SegmentBasis(EDGES, 6)
    whole = basis.gram(0.0, 0.07, 2) + basis.gram(0.07, 0.4, 2)
    np.testing.assert_allclose(whole, basis.gram(0.0, 0.4, 2), rtol=0, atol=1e-13 * np.abs(whole).max())


def test_bubbles_do_no_work_on_the_nodes() -> None:
    """Hermite functions and bubbles are orthogonal in the energy of each piece: hence nodal exactness."""
    basis, nodal = SegmentBasis(EDGES, 9), 2 * (len(EDGES) - 1)
    for start, end in pairwise(EDGES):
        gram = basis.gram(start, end, 2)
        scale = np.sqrt(np.diag(basis.gram(0.0, 0.4, 2)))
        np.testing.assert_allclose((gram / np.outer(scale, scale))[:nodal, nodal:], 0, atol=1e-14)


def test_derivative_beyond_the_second_is_refused() -> None:
    with pytest.raises(ValueError, match="derivative must be 0, 1 or 2, got 3"):
        SegmentBasis(EDGES, 5).evaluate(np.array([0.1]), 3)


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("degree", [3, 5, 9])
def test_static_solution_is_exact(structure: Structure, degree: int) -> None:
    """At rest the beams are cubics on each piece, under voltages as under tip forces: every degree has them."""
    exact = StaticSolution(structure)
    model = beam_model(structure, "segment", degree)
    deflection, strain = response(model, 0.0)
    for found, expected in ((deflection, exact.deflection()), (strain, exact.strain())):
        assert found.shape == expected.shape
        row = np.abs(expected).max(axis=1, keepdims=True)
        np.testing.assert_allclose(found / row, expected / row, rtol=1e-9, atol=1e-12)


def test_static_solution_is_exact_all_along_the_beams() -> None:
    structure = five_beams()
    exact, model = StaticSolution(structure), beam_model(structure, "segment", 5)
    system = model.assemble()
    rest = np.linalg.solve(system.K, np.hstack([system.L, system.F]))
    for j, beam in enumerate(structure.beam, 1):
        shape = np.stack([exact.derivative(j, z, 0) for z in np.linspace(0, beam.length, 21)])
        np.testing.assert_allclose(model.stations[j - 1] @ rest, shape, rtol=0, atol=1e-9 * np.abs(shape).max())


@pytest.mark.parametrize("structure", [three_beams(), read_structure(find_structure("kiel"))], ids=["three", "kiel"])
def test_frequency_response(structure: Structure) -> None:
    """Default degree, 88 unknowns: each deflection within 1e-4, each strain within 1e-3 of its largest response."""
    found = errors(structure, "segment", DEFAULT_ORDER["segment"])
    assert found.unknowns <= 90
    assert np.all(found.deflection < 1e-4), dict(zip(FREQUENCIES, found.deflection, strict=True))
    assert np.all(found.strain < 1e-3), dict(zip(FREQUENCIES, found.strain, strict=True))


@pytest.mark.parametrize("frequency", [200.0, 600.0])
def test_exponential_convergence(frequency: float) -> None:
    """log10 of the error falls on a line in the degree, by more than a decade a degree."""
    degrees = np.arange(4, 10)
    found = [errors(three_beams(), "segment", int(p), (frequency,)) for p in degrees]
    for error in (np.log10([e.deflection[0] for e in found]), np.log10([e.strain[0] for e in found])):
        slope, _ = line = np.polyfit(degrees, error, 1)
        assert slope < -1.0, error
        assert np.abs(error - np.polyval(line, degrees)).max() < 1.0, error


def test_long_pieces_get_more_bubbles() -> None:
    basis = SegmentBasis(EDGES, 9)
    assert sum(basis.bubbles) == 4 * 6
    order = np.argsort(np.diff(EDGES), kind="stable")
    assert np.all(np.diff(np.array(basis.bubbles)[order]) >= -1)  # equal pieces may differ by one
    assert basis.bubbles[3] > basis.bubbles[1] > basis.bubbles[0]


@pytest.mark.parametrize("frequency", [200.0, 600.0])
def test_sharing_bubbles_by_length_pays(frequency: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """With as many unknowns it is at least a hundred times as exact as the same degree on every piece."""
    shared = errors(three_beams(), "segment", 9, (frequency,))
    monkeypatch.setattr("flexbeams.plant.segment._distribute_bubbles", lambda widths, mean: (mean,) * widths.size)
    equal = errors(three_beams(), "segment", 9, (frequency,))
    assert equal.unknowns == shared.unknowns
    assert shared.deflection[0] < 0.01 * equal.deflection[0]
    assert shared.strain[0] < 0.01 * equal.strain[0]
