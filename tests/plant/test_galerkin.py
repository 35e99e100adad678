"""The assembled matrices: affine in the parameters, symmetric, passive, and right against closed forms."""

import re

import numpy as np
import pytest

from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import STATIONS, beam_bases, beam_model
from flexbeams.plant.segment import SegmentBasis
from flexbeams.plant.statespace import undamped_frequencies
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.oracles.accuracy import errors, response
from tests.oracles.boundary_value import StaticSolution
from tests.oracles.examples import five_beams, single_beam, three_beams
from tests.oracles.high_precision import clamped_free_root, tip_mass_roots

BASES: list[BasisName] = ["clamped_free", "segment"]
STRUCTURES = [single_beam(), three_beams(), five_beams()]
WITHOUT_PATCH = {
    f"patch[1].{name}": 0.0 for name in ("density", "youngs_modulus", "viscous_damping", "structural_damping")
}


def uniform_frequencies(structure: Structure, roots: np.ndarray) -> np.ndarray:
    """(b/l)^2 sqrt(E I / (rho A)), rad/s."""
    beam = structure.beam[0]
    frequencies: np.ndarray = (roots / beam.length) ** 2 * np.sqrt(
        beam.youngs_modulus * beam.second_moment / (beam.density * beam.area)
    )
    return frequencies


@pytest.mark.parametrize(("basis", "order", "count"), [("clamped_free", 12, 12), ("segment", 9, 5), ("segment", 13, 8)])
def test_frequencies_of_a_uniform_beam(basis: BasisName, order: int, count: int) -> None:
    structure = single_beam()
    system = beam_model(structure, basis, order).assemble({**WITHOUT_PATCH, "beam[1].tip_mass": 0.0})
    exact = uniform_frequencies(structure, np.array([float(clamped_free_root(k + 1)) for k in range(count)]))
    np.testing.assert_allclose(undamped_frequencies(system)[:count], exact, rtol=1e-9)


@pytest.mark.parametrize("ratio", [0.05, 1.0, 3.0])
def test_frequencies_with_a_tip_mass(ratio: float) -> None:
    structure = single_beam()
    beam = structure.beam[0]
    mass = ratio * beam.density * beam.area * beam.length
    system = beam_model(structure, "segment", 11).assemble({**WITHOUT_PATCH, "beam[1].tip_mass": mass})
    exact = uniform_frequencies(structure, tip_mass_roots(ratio, 5))
    np.testing.assert_allclose(undamped_frequencies(system)[:5], exact, rtol=1e-9)


def test_eigenfunctions_converge_with_a_tip_mass() -> None:
    """From above, as Rayleigh and Ritz promise, and with order 3: a shear force at the tip is not in the basis."""
    structure, ratio = single_beam(), 1.0
    beam = structure.beam[0]
    changed = {**WITHOUT_PATCH, "beam[1].tip_mass": ratio * beam.density * beam.area * beam.length}
    exact = uniform_frequencies(structure, tip_mass_roots(ratio, 3))
    sizes = np.array([10, 20, 40])
    excess = (
        np.array(
            [
                undamped_frequencies(beam_model(structure, "clamped_free", int(n)).assemble(changed))[:3] / exact
                for n in sizes
            ]
        )
        - 1
    )
    assert np.all(excess > -1e-12)
    slopes = [np.polyfit(np.log(sizes), np.log(e), 1)[0] for e in excess.T]
    np.testing.assert_allclose(slopes, -3, atol=0.1)


@pytest.mark.parametrize("structure", [three_beams(), read_structure(find_structure("kiel"))], ids=["three", "kiel"])
def test_eigenfunctions_converge_with_patches(structure: Structure) -> None:
    """Order 1 at rest, since the curvature jumps where a patch pair ends, and towards the same limit in motion."""
    sizes = np.array([10, 14, 20, 28, 40, 56])
    exact = StaticSolution(structure).deflection()
    at_rest = [np.linalg.norm(response(beam_model(structure, "clamped_free", int(n)), 0.0)[0] - exact) for n in sizes]
    assert np.polyfit(np.log(sizes), np.log(at_rest), 1)[0] == pytest.approx(-1, abs=0.1)
    coarse, fine = (errors(structure, "clamped_free", n, (15.0, 200.0)) for n in (10, 64))
    assert np.all(fine.deflection < 0.35 * coarse.deflection)
    assert np.all(fine.strain < 0.6 * coarse.strain)


def test_ten_eigenfunctions_are_a_coarse_model_of_the_patches() -> None:
    """Why the high-fidelity plant has another basis: the paper's is off by several per cent at rest."""
    found = errors(read_structure(find_structure("kiel")), "clamped_free", 10, (60.0,))
    assert found.static_deflection > 0.05
    assert found.static_strain > 0.1


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("basis", BASES)
def test_matrices_are_symmetric_and_definite(structure: Structure, basis: BasisName) -> None:
    model = beam_model(structure, basis, 6)
    system = model.assemble()
    for name in ("M", "D", "K"):
        matrix = getattr(system, name)
        assert matrix.shape == (model.size, model.size)
        np.testing.assert_array_equal(matrix, matrix.T)
        scale = np.sqrt(np.diag(matrix))
        assert np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > 1e-9, name


@pytest.mark.parametrize("basis", BASES)
def test_shapes(basis: BasisName) -> None:
    structure = three_beams()
    model = beam_model(structure, basis, 5)
    n, system = model.size, model.assemble()
    assert n == {"clamped_free": 15, "segment": 44}[basis]
    assert system.L.shape == (n, 4)
    assert system.F.shape == (n, 3)
    assert model.deflection.shape == (5, n)
    assert model.strain.shape == (6, n)
    assert model.tips.shape == (3, n)
    assert model.stations.shape == (3, STATIONS, n)
    np.testing.assert_allclose(model.stations[:, 0], 0, atol=1e-15)
    np.testing.assert_array_equal(model.stations[:, -1], model.tips)
    np.testing.assert_array_equal(system.F, model.tips.T)


@pytest.mark.parametrize("basis", BASES)
def test_damping_of_the_patches_alone_is_passive(basis: BasisName) -> None:
    model = beam_model(three_beams(), basis, 5)
    none = {f"beam[{j}].{kind}_damping": 0.0 for j in (1, 2, 3) for kind in ("viscous", "structural")}
    spectrum = np.linalg.eigvalsh(model.assemble(none).D)
    assert spectrum[0] > -1e-12 * spectrum[-1]
    assert spectrum[-1] > 0


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("structure", STRUCTURES)
def test_reassembly_equals_a_rebuilt_model(structure: Structure, basis: BasisName) -> None:
    model = beam_model(structure, basis, 5)
    generator = np.random.default_rng(1)
    changed = {name: value * generator.uniform(0.5, 2) for name, value in structure.parameters().items()}
    cheap, rebuilt = model.assemble(changed), beam_model(structure.with_parameters(changed), basis, 5).assemble()
    before = model.assemble()
    for name in ("M", "D", "K", "L", "F"):
        found, exact = getattr(cheap, name), getattr(rebuilt, name)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-14 * np.abs(exact).max())
        assert name == "F" or np.abs(found - getattr(before, name)).max() > 1e-3 * np.abs(exact).max()


def test_every_parameter_enters_one_matrix_linearly() -> None:
    structure = three_beams()
    model, parameters = beam_model(structure, "clamped_free", 4), structure.parameters()
    assert len(parameters) == 37
    before, matrices = model.assemble(), ("M", "D", "K", "L", "F")
    belongs = {
        "density": "M",
        "tip_mass": "M",
        "viscous_damping": "D",
        "structural_damping": "D",
        "youngs_modulus": "K",
        "stiffness": "K",
        "piezo_ratio": "L",
    }
    for name, value in parameters.items():
        once, twice = model.assemble({name: 2 * value}), model.assemble({name: 3 * value})
        moved = [m for m in matrices if not np.array_equal(getattr(once, m), getattr(before, m))]
        assert moved == [belongs[name.split(".")[1]]], name
        start, step, two = (getattr(s, moved[0]) for s in (before, once, twice))
        np.testing.assert_allclose(two - start, 2 * (step - start), rtol=0, atol=1e-14 * np.abs(two).max())


@pytest.mark.parametrize(("structure", "count"), [(single_beam(), 10), (three_beams(), 37), (five_beams(), 58)])
def test_matrices_are_the_sum_of_their_terms(structure: Structure, count: int) -> None:
    """Nothing is left where all parameters are zero, and each parameter has one term."""
    model = beam_model(structure, "segment", 4)
    names = [term.parameter for term in model.terms]
    assert sorted(names) == sorted(structure.parameters())
    assert len(set(names)) == count
    nothing = model.assemble(dict.fromkeys(names, 0.0))
    for name in ("M", "D", "K", "L"):
        assert not getattr(nothing, name).any()


@pytest.mark.parametrize("basis", BASES)
def test_beams_meet_only_in_the_springs(basis: BasisName) -> None:
    structure = five_beams()
    model = beam_model(structure, basis, 4)
    sizes = [b.size for b in beam_bases(structure, basis, 4)]
    starts = np.cumsum([0, *sizes])
    system = model.assemble()
    coupled = {tuple(sorted(spring.between)): spring.stiffness for spring in structure.spring}
    for i in range(1, 6):
        for j in range(i + 1, 6):
            block = np.ix_(range(starts[i - 1], starts[i]), range(starts[j - 1], starts[j]))
            assert not system.M[block].any()
            assert not system.D[block].any()
            tip_i, tip_j = (model.tips[b - 1, starts[b - 1] : starts[b]] for b in (i, j))
            expected = -coupled.get((i, j), 0.0) * np.outer(tip_i, tip_j)
            np.testing.assert_allclose(system.K[block], expected, rtol=1e-14)


def test_both_patches_of_a_pair_count() -> None:
    """A rigid-body like motion w = (z/l)^2 meets the mass, stiffness and damping of two patches, not of one."""
    structure = single_beam()
    patch, beam = structure.patch[0], structure.beam[0]
    model = beam_model(structure, "segment", 5)
    basis = beam_bases(structure, "segment", 5)[0]
    z = np.linspace(0, beam.length, 60)
    q = np.linalg.lstsq(basis.evaluate(z), (z / beam.length) ** 2, rcond=None)[0]
    only = dict.fromkeys(structure.parameters(), 0.0)

    def form(matrix: str, name: str) -> float:
        value = structure.parameters()[f"patch[1].{name}"]
        found = getattr(model.assemble({**only, f"patch[1].{name}": value}), matrix)
        return float(q @ found @ q)

    a, b = patch.position / beam.length, patch.end / beam.length
    fifth, third = beam.length * (b**5 - a**5) / 5, 4 / beam.length * (b**3 - a**3) / 3
    half = beam.thickness / 2
    layer = patch.width * ((half + patch.thickness) ** 3 - half**3) / 3
    exact = {
        ("M", "density"): 2 * patch.density * patch.width * patch.thickness * fifth,
        ("K", "youngs_modulus"): 2 * patch.youngs_modulus * layer * 4 / beam.length**4 * patch.length,
        ("D", "viscous_damping"): 2 * patch.viscous_damping * fifth,
        ("D", "structural_damping"): 2 * patch.structural_damping * third,
    }
    for (matrix, name), value in exact.items():
        assert form(matrix, name) == pytest.approx(value, rel=1e-12), name


def test_input_is_the_moment_on_the_curvature() -> None:
    """l = -Gamma times the integral of phi'' over the pair (Appendix): positive voltage bends to the negative."""
    structure = five_beams()
    model = beam_model(structure, "segment", 5)
    bases = beam_bases(structure, "segment", 5)
    starts = np.cumsum([0, *(b.size for b in bases)])
    nodes, weights = np.polynomial.legendre.leggauss(8)
    L = model.assemble().L
    expected = np.zeros_like(L)
    for k, patch in enumerate(structure.patch):
        j = patch.beam - 1
        z = patch.position + patch.length / 2 * (nodes + 1)
        integral = patch.length / 2 * weights @ bases[j].evaluate(z, 2)
        expected[starts[j] : starts[j + 1], k] = -patch.moment_per_volt(structure.beam[j]) * integral
    np.testing.assert_allclose(L, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("basis", BASES)
def test_strain_of_a_gauge_is_the_mean_of_the_curvature(basis: BasisName) -> None:
    structure = three_beams()
    model = beam_model(structure, basis, 6)
    bases = beam_bases(structure, basis, 6)
    starts = np.cumsum([0, *(b.size for b in bases)])
    nodes, weights = np.polynomial.legendre.leggauss(16)
    for row, gauge in zip(model.strain, structure.strain_gauge, strict=True):
        j = gauge.beam - 1
        curvature = bases[j].evaluate(gauge.position + gauge.length / 2 * nodes, 2)
        expected = np.zeros(model.size)
        expected[starts[j] : starts[j + 1]] = structure.beam[j].thickness / 2 * (weights / 2) @ curvature
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_a_gauge_of_no_length_reads_the_point() -> None:
    structure = single_beam()
    z = structure.strain_gauge[2].position
    basis = beam_bases(structure, "clamped_free", 7)[0]
    expected = structure.beam[0].thickness / 2 * basis.evaluate(np.array([z]), 2)[0]
    np.testing.assert_array_equal(beam_model(structure, "clamped_free", 7).strain[2], expected)


def test_default_orders() -> None:
    assert beam_model(three_beams()).size == 30
    assert beam_model(three_beams(), "segment").size == 88
    assert all(isinstance(b, SegmentBasis) for b in beam_bases(three_beams(), "segment", 3))


@pytest.mark.parametrize(
    ("basis", "order", "message"),
    [
        ("hermite", 4, "basis must be one of clamped_free, segment, got 'hermite'"),
        ("clamped_free", 0, "order must be >= 1 for the basis clamped_free, got 0"),
        ("segment", 2, "order must be >= 3 for the basis segment, got 2"),
    ],
)
def test_refusals(basis: BasisName, order: int, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        beam_model(single_beam(), basis, order)
