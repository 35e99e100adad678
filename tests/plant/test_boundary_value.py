"""The exact solutions themselves: closed forms, weak form, reciprocity, static limit."""

import cmath

import numpy as np
import pytest

from flexbeams.plant.structure import Structure
from tests.oracles.boundary_value import LaplaceSolution, StaticSolution, beam_pieces
from tests.oracles.examples import five_beams, single_beam, three_beams

STRUCTURES = [single_beam(), three_beams(), five_beams()]
COMPLEX_RATE = -3.0 + 170.0j  # s of no symmetry, 1/s


def bare_cantilever(damping: float = 0.0) -> Structure:
    """One uniform beam without tip mass, whose patch pair weighs and holds nothing, seen at its tip."""
    structure = single_beam(tip_mass=0.0, viscous_damping=damping, structural_damping=0.0)
    vanishing = {
        f"patch[1].{name}": value
        for name, value in (
            ("density", 1e-200),
            ("youngs_modulus", 1e-200),
            ("viscous_damping", 0.0),
            ("structural_damping", 0.0),
        )
    }
    return structure.with_parameters(vanishing)


def test_static_cantilever_under_tip_force() -> None:
    structure = bare_cantilever()
    beam, z = structure.beam[0], 0.2
    exact = z**2 * (3 * beam.length - z) / (6 * beam.youngs_modulus * beam.second_moment)
    assert StaticSolution(structure).deflection()[0, 1] == pytest.approx(exact, rel=1e-12)


def test_static_cantilever_bent_by_a_patch_pair() -> None:
    """Under a patch the curvature is -Gamma U / E I, elsewhere nothing bends."""
    structure = bare_cantilever()
    beam, patch = structure.beam[0], structure.patch[0]
    curvature = -patch.moment_per_volt(beam) / (beam.youngs_modulus * beam.second_moment)
    exact = curvature * patch.length * (0.2 - patch.position - patch.length / 2)
    solution = StaticSolution(structure)
    assert solution.deflection()[0, 0] == pytest.approx(exact, rel=1e-12)
    assert solution.strain()[0, 0] == pytest.approx(beam.thickness / 2 * curvature, rel=1e-12)


@pytest.mark.parametrize("frequency", [3.0, 40.0, 600.0, 8000.0])
def test_receptance_of_a_damped_cantilever(frequency: float) -> None:
    """w(l)/f = l^3 (sin b cosh b - cos b sinh b) / (E I b^3 (1 + cos b cosh b)) with complex b."""
    structure, s = bare_cantilever(damping=0.4), 1j * frequency
    beam = structure.beam[0]
    stiffness = beam.youngs_modulus * beam.second_moment
    b = (-(s**2 * beam.density * beam.area + s * 0.4) / stiffness) ** 0.25 * beam.length
    exact = (
        beam.length**3
        / stiffness
        * (cmath.sin(b) * cmath.cosh(b) - cmath.cos(b) * cmath.sinh(b))
        / (b**3 * (1 + cmath.cos(b) * cmath.cosh(b)))
    )
    found = LaplaceSolution(structure, s).deflection()[1, 1]
    assert abs(found - exact) <= 1e-11 * abs(exact)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_static_limit(structure: Structure) -> None:
    static, limit = StaticSolution(structure), LaplaceSolution(structure, 0.0)
    for exact, found in ((static.deflection(), limit.deflection()), (static.strain(), limit.strain())):
        np.testing.assert_allclose(found, exact, rtol=1e-11, atol=1e-13 * np.abs(exact).max())


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("s", [0.0, COMPLEX_RATE, 2000.0j])
def test_weak_form(structure: Structure, s: complex) -> None:
    """(13) holds for test functions z^2 ... z^6 on every beam, for every voltage and tip force."""
    solution = LaplaceSolution(structure, s)
    nodes, weights = np.polynomial.legendre.leggauss(18)
    powers = np.arange(2, 7)[:, None]
    for j, beam in enumerate(structure.beam, 1):
        tip = solution.state(j, beam.length)[0]
        force = s**2 * beam.tip_mass * tip
        for spring in structure.spring:
            if j in spring.between:
                other = sum(spring.between) - j
                force = force + spring.stiffness * (tip - solution.state(other, structure.beam[other - 1].length)[0])
        force[len(structure.patch) + j - 1] -= 1
        residual = np.tile(force, (powers.size, 1))  # the test functions (z / l)^power are 1 at the tip
        largest = np.abs(residual).max()
        for piece in beam_pieces(structure, j, 0.15):
            half = (piece.end - piece.start) / 2
            for z, weight in zip(piece.start + half * (nodes + 1), half * weights, strict=True):
                w, slope, moment, _ = solution.state(j, z)
                for part in (
                    (s * piece.viscous + s**2 * piece.mass) * w,
                    s * piece.structural * slope * powers / z,
                    moment * powers * (powers - 1) / z**2,
                ):
                    part = weight * (z / beam.length) ** powers * part
                    residual = residual + part
                    largest = max(largest, np.abs(part).max())
        assert np.abs(residual).max() <= 1e-11 * largest


@pytest.mark.parametrize("structure", STRUCTURES)
def test_slope_and_curvature_are_derivatives(structure: Structure) -> None:
    solution = LaplaceSolution(structure, COMPLEX_RATE)
    nodes, weights = np.polynomial.legendre.leggauss(18)
    for j in range(1, len(structure.beam) + 1):
        for piece in beam_pieces(structure, j):
            half = (piece.end - piece.start) / 2
            places = piece.start + half * (nodes + 1)
            ends = solution.state(j, piece.end) - solution.state(j, piece.start)
            slopes = half * weights @ np.array([solution.state(j, z)[1] for z in places])
            bends = half * weights @ np.array([solution.curvature(j, z) for z in places])
            np.testing.assert_allclose(ends[0], slopes, rtol=0, atol=1e-12 * np.abs(slopes).max())
            np.testing.assert_allclose(ends[1], bends, rtol=0, atol=1e-11 * np.abs(bends).max())


@pytest.mark.parametrize("s", [0.0, COMPLEX_RATE])
def test_reciprocity(s: complex) -> None:
    """Maxwell and Betti: forces at tips i and j exchange; a voltage works on the change of slope of its pair."""
    structure = five_beams()
    solution, patches = LaplaceSolution(structure, s), len(structure.patch)
    tips = np.stack([solution.state(j, beam.length)[0] for j, beam in enumerate(structure.beam, 1)])
    work = np.stack(
        [
            -patch.moment_per_volt(structure.beam[patch.beam - 1])
            * (solution.state(patch.beam, patch.end)[1] - solution.state(patch.beam, patch.position)[1])
            for patch in structure.patch
        ]
    )
    collocated = np.vstack([work, tips])
    assert collocated.shape == (patches + 5, patches + 5)
    scale = np.sqrt(np.abs(np.diag(collocated)))
    scaled = collocated / np.outer(scale, scale)
    np.testing.assert_allclose(scaled, scaled.T, rtol=0, atol=1e-11)


def test_a_gauge_of_no_length_sees_the_curvature_on_its_right() -> None:
    structure = single_beam()
    edge = structure.patch[0].position
    at_edge = StaticSolution(structure).derivative(1, edge, 2)
    after = StaticSolution(structure).derivative(1, edge + 1e-9, 2)
    before = StaticSolution(structure).derivative(1, edge - 1e-9, 2)
    np.testing.assert_allclose(at_edge, after, rtol=1e-6)
    assert abs(before[0]) < 1e-9 * abs(at_edge[0])
