"""The eigenfunctions of the paper's basis against high precision, closed forms and composite quadrature."""

import numpy as np
import pytest

from flexbeams.plant.clamped_free import ClampedFreeBasis, clamped_free_roots
from tests.oracles.high_precision import clamped_free_root, clamped_free_shape

LENGTH = 0.41


def composite_gram(basis: ClampedFreeBasis, start: float, end: float, derivative: int) -> np.ndarray:
    """Gram matrix with 400 panels of eight Gauss points."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(start, end, 401)
    half = np.diff(edges)[:, None] / 2
    values = basis.evaluate((edges[:-1, None] + half * (1 + nodes)).ravel(), derivative)
    return values.T @ ((half * weights).ravel()[:, None] * values)


def test_roots_to_the_hundredth() -> None:
    exact = [float(clamped_free_root(k)) for k in range(1, 101)]
    np.testing.assert_allclose(clamped_free_roots(100), exact, rtol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 1000])
def test_any_number_of_roots(count: int) -> None:
    roots = clamped_free_roots(count)
    assert roots.shape == (count,)
    assert np.all(np.abs(np.cos(roots) + 1 / np.cosh(np.minimum(roots, 700))) < 1e-12)
    assert np.all(np.diff(roots) > 2.8)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_shapes_to_the_hundredth(derivative: int) -> None:
    """1e-10 of the largest value; the textbook formula in doubles is lost from mode 11 on."""
    x = np.array([0.0, 0.003, 0.02, 0.1, 0.25, 0.5, 0.77, 0.9, 0.97, 0.999, 1.0])
    basis = ClampedFreeBasis(LENGTH, 100)
    found = basis.evaluate(x * LENGTH, derivative)
    exact = np.array([[clamped_free_shape(k, at, derivative) for k in range(1, 101)] for at in x])
    exact /= LENGTH**derivative
    assert found.shape == (11, 100)
    assert np.max(np.abs(found - exact) / np.abs(exact).max(axis=0)) < 1e-10


def test_clamp_and_free_end() -> None:
    basis = ClampedFreeBasis(LENGTH, 100)
    scale = 2 * (basis.roots / LENGTH) ** np.arange(3)[:, None]
    ends = np.array([0.0, LENGTH])
    deflection, slope, bend = (basis.evaluate(ends, d) / scale[d] for d in range(3))
    np.testing.assert_allclose(deflection[0], 0, atol=1e-14)
    np.testing.assert_allclose(slope[0], 0, atol=1e-14)
    np.testing.assert_allclose(bend[1], 0, atol=1e-12)
    np.testing.assert_allclose(deflection[1], np.resize([1.0, -1.0], 100), atol=1e-12)


def test_thousand_modes_stay_finite() -> None:
    basis = ClampedFreeBasis(LENGTH, 1000)
    for derivative in range(3):
        values = basis.evaluate(np.linspace(0, LENGTH, 7), derivative) * (LENGTH / basis.roots) ** derivative
        assert np.all(np.abs(values) < 2.1)


@pytest.mark.parametrize("derivative", [0, 2])
def test_orthogonality(derivative: int) -> None:
    """integral phi_i phi_m = l delta_im, integral phi_i'' phi_m'' = l (b_i / l)^4 delta_im."""
    basis = ClampedFreeBasis(LENGTH, 100)
    scale = (basis.roots / LENGTH) ** derivative
    gram = basis.gram(0.0, LENGTH, derivative) / np.outer(scale, scale)
    np.testing.assert_allclose(gram, LENGTH * np.eye(100), rtol=0, atol=1e-11 * LENGTH)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize(("start", "end"), [(0.0, LENGTH), (0.02, 0.105), (0.31, LENGTH), (0.2, 0.2004)])
def test_gram_resolves_the_two_highest_modes(start: float, end: float, derivative: int) -> None:
    basis = ClampedFreeBasis(LENGTH, 100)
    gram, exact = basis.gram(start, end, derivative), composite_gram(basis, start, end, derivative)
    size = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(gram / np.outer(size, size), exact / np.outer(size, size), rtol=0, atol=1e-11)


@pytest.mark.parametrize("derivative", [0, 1, 2])
@pytest.mark.parametrize("size", [1, 10, 40])
def test_gram_is_symmetric_and_definite(derivative: int, size: int) -> None:
    basis = ClampedFreeBasis(LENGTH, size)
    for start, end in ((0.0, LENGTH), (0.02, 0.105)):
        gram = basis.gram(start, end, derivative)
        assert gram.shape == (size, size)
        np.testing.assert_array_equal(gram, gram.T)
        # the diagonal of the whole beam scales the modes, whose curvatures grow as b^2
        scale = np.sqrt(np.diag(basis.gram(0.0, LENGTH, derivative)))
        spectrum = np.linalg.eigvalsh(gram / np.outer(scale, scale))
        assert spectrum[0] > (1e-3 if end == LENGTH else -1e-14)


def test_derivative_beyond_the_second_is_refused() -> None:
    with pytest.raises(ValueError, match="derivative must be 0, 1 or 2, got 3"):
        ClampedFreeBasis(LENGTH, 3).evaluate(np.array([0.1]), 3)
