"""Galerkin approximation (14), (15): M q'' + D q' + K q = L u + F force, affine in the physical parameters.

Every parameter enters one matrix only, as (parameter) x (constant matrix of the geometry). The constant
matrices are integrated once; a changed parameter costs a weighted sum. The factor 2 of (5), (8) and of the
damping, front and back patch, is in these matrices; the Appendix of the paper omits it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import ceil

import numpy as np

from flexbeams.plant.assembly import MatrixName, SecondOrderSystem, Term, assemble
from flexbeams.plant.basis import Array, Basis
from flexbeams.plant.choices import BASES, BasisName
from flexbeams.plant.clamped_free import ClampedFreeBasis
from flexbeams.plant.errors import InputError
from flexbeams.plant.segment import SegmentBasis, split_at
from flexbeams.plant.structure import Structure

DEFAULT_ORDER = {"clamped_free": 10, "segment": 9}  # modes N of a beam; polynomial degree p
FEWEST_PIECES = 3  # beams of fewer uniform pieces get as many unknowns as one of so many
STATIONS = 21  # points along each beam whose deflection is an output


@dataclass(frozen=True, kw_only=True)
class BeamModel:
    """A structure on a basis: its terms and its output maps."""

    structure: Structure
    basis: BasisName
    order: int
    size: int  # generalised coordinates n
    terms: tuple[Term, ...]
    deflection: Array  # (n_pi, n): y_pi = deflection q, m (18)
    strain: Array  # (n_pm, n): y_pm = strain q, 1 (20)
    tips: Array  # (r, n): deflection of each tip, m; its transpose is F
    stations: Array  # (r, STATIONS, n): deflection at equal distances from the clamp to the tip, m

    def assemble(self, parameters: dict[str, float] | None = None) -> SecondOrderSystem:
        """The matrices for the structure's parameters, with the values in `parameters` in place of its own."""
        values = {**self.structure.parameters(), **(parameters or {})}
        return assemble(self.terms, values, self.tips, len(self.structure.patch))


def beam_bases(structure: Structure, basis: BasisName, order: int) -> list[Basis]:
    """The shape functions on each beam: N = order eigenfunctions, or polynomials of degree p = order."""
    if basis == "clamped_free":
        return [ClampedFreeBasis(beam.length, order) for beam in structure.beam]
    bases: list[Basis] = []
    for j, beam in enumerate(structure.beam, 1):
        cuts = [z for p in structure.patch if p.beam == j for z in (p.position, p.end)]
        edges = split_at(beam.length, cuts)
        pieces = len(edges) - 1
        fewest = FEWEST_PIECES * (order - 1)  # unknowns
        bases.append(SegmentBasis(edges, max(order, 1 + ceil(fewest / pieces))))
    return bases


def beam_model(structure: Structure, basis: BasisName = "clamped_free", order: int | None = None) -> BeamModel:
    """The Galerkin model of a structure.

    `order` is the number of modes of a beam for `clamped_free` (default 10, the paper) and the polynomial
    degree for `segment` (default 9). Raises InputError for an unknown basis or an order below 1 (3 for segment).
    """
    if basis not in BASES:
        raise InputError("basis", f"must be one of {', '.join(BASES)}", basis)
    order = DEFAULT_ORDER[basis] if order is None else order
    if order < (lowest := 3 if basis == "segment" else 1):
        raise InputError("order", f"must be >= {lowest} for the basis {basis}", order)
    bases = beam_bases(structure, basis, order)
    starts = np.concatenate([[0], np.cumsum([b.size for b in bases])]).astype(int)
    n = int(starts[-1])

    def rows(beam: int, positions: list[float], derivative: int = 0) -> Array:
        wide = np.zeros((len(positions), n))
        wide[:, starts[beam] : starts[beam + 1]] = bases[beam].evaluate(np.asarray(positions), derivative)
        return wide

    tips = np.vstack([rows(j, [beam.length]) for j, beam in enumerate(structure.beam)])
    terms = [
        *_beam_terms(structure, bases, starts, tips),
        *_patch_terms(structure, bases, starts),
        *_spring_terms(structure, starts, tips),
    ]
    strain = np.vstack(
        [
            _strain_row(g.position, g.length, structure.beam[g.beam - 1].thickness, partial(rows, g.beam - 1))
            for g in structure.strain_gauge
        ]
    )
    return BeamModel(
        structure=structure,
        basis=basis,
        order=order,
        size=n,
        terms=tuple(terms),
        tips=tips,
        strain=strain,
        deflection=np.vstack([rows(p.beam - 1, [p.position]) for p in structure.point_of_interest]),
        stations=np.stack(
            [rows(j, list(np.linspace(0, beam.length, STATIONS))) for j, beam in enumerate(structure.beam)]
        ),
    )


def _strain_row(position: float, length: float, thickness: float, rows: Callable[[list[float], int], Array]) -> Array:
    """h/2 w'' averaged over the gauge, which is a difference of slopes; the value at its centre for length 0."""
    if length == 0:
        at_point: Array = thickness / 2 * rows([position], 2)
        return at_point
    slopes = rows([position - length / 2, position + length / 2], 1)
    mean: Array = thickness / 2 * (slopes[1:] - slopes[:1]) / length
    return mean


def _beam_terms(structure: Structure, bases: list[Basis], starts: Array, tips: Array) -> list[Term]:
    terms = []
    for j, (beam, basis) in enumerate(zip(structure.beam, bases, strict=True)):
        gram = [basis.gram(0.0, beam.length, d) for d in range(3)]
        tip = tips[j, starts[j] : starts[j + 1]]
        blocks: tuple[tuple[str, MatrixName, Array], ...] = (
            ("density", "M", beam.area * gram[0]),
            ("youngs_modulus", "K", beam.second_moment * gram[2]),
            ("tip_mass", "M", np.outer(tip, tip)),
            ("viscous_damping", "D", gram[0]),
            ("structural_damping", "D", gram[1]),
        )
        terms += [
            Term(parameter=f"beam[{j + 1}].{name}", matrix=matrix, start=int(starts[j]), column=0, block=block)
            for name, matrix, block in blocks
        ]
    return terms


def _patch_terms(structure: Structure, bases: list[Basis], starts: Array) -> list[Term]:
    terms = []
    for k, patch in enumerate(structure.patch):
        beam, basis = structure.beam[patch.beam - 1], bases[patch.beam - 1]
        gram = [basis.gram(patch.position, patch.end, d) for d in range(3)]
        slopes = basis.evaluate(np.array([patch.position, patch.end]), 1)
        # l of the Appendix: -Gamma times the integral of phi'' over the pair
        lever = -patch.moment_per_volt(beam) / patch.piezo_ratio * (slopes[1] - slopes[0])
        blocks: tuple[tuple[str, MatrixName, Array], ...] = (
            ("density", "M", 2 * patch.area * gram[0]),
            ("youngs_modulus", "K", 2 * patch.second_moment(beam) * gram[2]),
            ("viscous_damping", "D", 2 * gram[0]),
            ("structural_damping", "D", 2 * gram[1]),
            ("piezo_ratio", "L", lever[:, None]),
        )
        terms += [
            Term(
                parameter=f"patch[{k + 1}].{name}",
                matrix=matrix,
                start=int(starts[patch.beam - 1]),
                column=k if matrix == "L" else 0,
                block=block,
            )
            for name, matrix, block in blocks
        ]
    return terms


def _spring_terms(structure: Structure, starts: Array, tips: Array) -> list[Term]:
    terms = []
    for k, spring in enumerate(structure.spring, 1):
        i, j = sorted(b - 1 for b in spring.between)
        stretch = (tips[i] - tips[j])[starts[i] : starts[j + 1]]
        terms.append(
            Term(
                parameter=f"spring[{k}].stiffness",
                matrix="K",
                start=int(starts[i]),
                column=0,
                block=np.outer(stretch, stretch),
            )
        )
    return terms
