"""Exact solutions of the coupled beams: no shape functions, only the equations of motion piece by piece.

On a piece of constant section, in the Laplace domain with the inputs' voltages U and tip forces f,

    M'' - (s g_sv w')' + (s g_v + s^2 mu) w = 0,    M = Lambda w'' + sum of Gamma U over the pairs on the piece,

with w = w' = 0 at the clamp; w, w', M and the shear force M' - s g_sv w' continuous where pieces meet; M = 0 and
M' - s g_sv w' = s^2 m w + sum of k (w - w_neighbour) - f at the tip. These are the Euler-Lagrange equations of
the weak form (13); mu, Lambda, g_v and g_sv of a piece with a patch pair contain both patches of the pair.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from flexbeams.plant.structure import Patch, Structure

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Piece:
    """A part of a beam of constant section."""

    start: float
    end: float
    bending_stiffness: float  # Lambda, N m^2
    mass: float  # mu, kg/m
    viscous: float  # g_v, N s/m^2
    structural: float  # g_sv, N s
    moment: Real  # Gamma of each input, N m/V, 0 where the input acts elsewhere; (n_u + r,)


def layer_moment(structure: Structure, patch: Patch, power: int) -> float:
    """Integral of z^power over the section of one patch by Gauss-Legendre quadrature, m^(power + 2)."""
    beam = structure.beam[patch.beam - 1]
    nodes, weights = np.polynomial.legendre.leggauss(4)
    z = beam.thickness / 2 + patch.thickness * (nodes + 1) / 2
    return float(patch.width * patch.thickness / 2 * np.sum(weights * z**power))


def beam_pieces(structure: Structure, number: int, most: float = np.inf) -> list[Piece]:
    """The pieces of beam `number` (from 1), none longer than `most`."""
    beam = structure.beam[number - 1]
    pairs = [(k, p) for k, p in enumerate(structure.patch) if p.beam == number]
    cuts = sorted({0.0, beam.length, *(round(z, 12) for _, p in pairs for z in (p.position, p.end))})
    parts: list[Piece] = []
    for a, b in pairwise(cuts):
        count = max(1, int(np.ceil((b - a) / most)))
        covering = [(k, p) for k, p in pairs if p.position < (a + b) / 2 < p.end]
        moment = np.zeros(len(structure.patch) + len(structure.beam))
        for k, p in covering:
            # Two layers under the field U/e_s; a11/beta is twice the stress per field of one layer.
            moment[k] = 2 * layer_moment(structure, p, 1) * p.piezo_ratio / 2 / p.electrode_distance
        stiffness = beam.youngs_modulus * beam.width * beam.thickness**3 / 12 + sum(
            2 * p.youngs_modulus * layer_moment(structure, p, 2) for _, p in covering
        )
        mass = beam.density * beam.width * beam.thickness + sum(
            2 * p.density * p.width * p.thickness for _, p in covering
        )
        viscous = beam.viscous_damping + sum(2 * p.viscous_damping for _, p in covering)
        structural = beam.structural_damping + sum(2 * p.structural_damping for _, p in covering)
        parts += [
            Piece(start, end, stiffness, mass, viscous, structural, moment)
            for start, end in pairwise(np.linspace(a, b, count + 1))
        ]
    return parts


class LaplaceSolution:
    """The exact transfer functions from voltages and tip forces at one complex frequency s.

    On a piece the state (w, w', M, shear) is propagated by the exponential of a (4, 4) matrix. One linear system
    joins the states at all piece ends, which stays well conditioned from s = 0 on, where the four exponential
    solutions of the equation would coincide, to high frequencies, since pieces are cut below the wavelength.
    Columns of every answer: n_u voltages, then r tip forces.
    """

    def __init__(self, structure: Structure, s: complex) -> None:
        self.structure, self.s = structure, complex(s)
        self._beams: list[tuple[list[Piece], Complex]] = []
        length = structure.beam[0].length
        # a scale for each of w, w', M, shear, so that the linear system is balanced
        moment = structure.beam[0].youngs_modulus * structure.beam[0].second_moment / length**2
        self._scale = np.array([1, 1 / length, moment, moment / length])
        parts = [beam_pieces(structure, j, self._longest(j)) for j in range(1, len(structure.beam) + 1)]
        first = np.cumsum([0, *(4 * (len(p) + 1) for p in parts)])
        inputs = len(structure.patch) + len(structure.beam)
        rows, right = np.zeros((first[-1], first[-1]), complex), np.zeros((first[-1], inputs), complex)
        tips = first[1:] - 4
        for j, beam in enumerate(structure.beam):
            at = first[j]
            rows[at, at] = rows[at + 1, at + 1] = 1
            for e, piece in enumerate(parts[j]):
                here, there = at + 4 * e, at + 4 * e + 4
                transition, forced = self._propagate(piece, piece.end - piece.start)
                rows[here + 2 : here + 6, here:there] = transition
                rows[here + 2 : here + 6, there : there + 4] = -np.eye(4)
                right[here + 2 : here + 6] = -forced
            tip, unit = tips[j], self._scale[3]
            rows[tip + 2, tip + 2] = 1
            rows[tip + 3, tip + 3] = -1
            rows[tip + 3, tip] = self.s**2 * beam.tip_mass / unit
            right[tip + 3, len(structure.patch) + j] = 1 / unit
        for spring in structure.spring:
            i, j = (tips[b - 1] for b in spring.between)
            for a, b in ((i, j), (j, i)):
                rows[a + 3, a] += spring.stiffness / self._scale[3]
                rows[a + 3, b] -= spring.stiffness / self._scale[3]
        states: Complex = np.asarray(np.linalg.solve(rows, right), dtype=complex)
        self._beams = [(parts[j], states[first[j] : first[j + 1]].reshape(-1, 4, inputs)) for j in range(len(parts))]

    def _longest(self, number: int) -> float:
        wave = max(
            abs((self.s * p.viscous + self.s**2 * p.mass) / p.bending_stiffness) ** 0.25
            + abs(self.s * p.structural / p.bending_stiffness) ** 0.5
            for p in beam_pieces(self.structure, number)
        )
        return 2 / wave if wave > 0 else np.inf

    def _propagate(self, piece: Piece, distance: float) -> tuple[Complex, Complex]:
        """Scaled state after `distance`: transition (4, 4) of the state at the start and part of the inputs."""
        s = self.s
        inputs = piece.moment.size
        rates = np.zeros((4 + inputs, 4 + inputs), complex)
        rates[0, 1] = 1
        rates[1, 2] = 1 / piece.bending_stiffness
        rates[1, 4:] = -piece.moment / piece.bending_stiffness
        rates[2, 1], rates[2, 3] = s * piece.structural, 1
        rates[3, 0] = -(s * piece.viscous + s**2 * piece.mass)
        scale = np.concatenate([self._scale, np.ones(inputs)])
        result = expm(distance * rates * scale / scale[:, None])
        return result[:4, :4], result[:4, 4:]

    def state(self, beam: int, z: float) -> Complex:
        """w, w', M and shear at z on beam `beam` (from 1), for each input; (4, n_u + r)."""
        parts, states = self._beams[beam - 1]
        e = next((e for e, p in enumerate(parts) if z < p.end), len(parts) - 1)
        transition, forced = self._propagate(parts[e], z - parts[e].start)
        state: Complex = self._scale[:, None] * (transition @ states[e] + forced)
        return state

    def curvature(self, beam: int, z: float) -> Complex:
        """w'' at z, that of the piece on the right where two meet; (n_u + r,)."""
        parts, _ = self._beams[beam - 1]
        piece = next((p for p in parts if z < p.end), parts[-1])
        bent: Complex = (self.state(beam, z)[2] - piece.moment) / piece.bending_stiffness
        return bent

    def deflection(self) -> Complex:
        """Deflection at the points of interest; (n_pi, n_u + r)."""
        return np.stack([self.state(p.beam, p.position)[0] for p in self.structure.point_of_interest])

    def strain(self) -> Complex:
        """Strain at the gauges, mean over their length; (n_pm, n_u + r)."""
        rows = []
        for g in self.structure.strain_gauge:
            half = self.structure.beam[g.beam - 1].thickness / 2
            if g.length == 0:
                rows.append(half * self.curvature(g.beam, g.position))
            else:
                a, b = (self.state(g.beam, g.position + side * g.length / 2)[1] for side in (-1, 1))
                rows.append(half * (b - a) / g.length)
        return np.stack(rows)


class StaticSolution:
    """The structure at rest under voltages and tip forces: a cubic on each piece, found from one real system.

    Written apart from LaplaceSolution: the unknowns are the polynomials' coefficients c in
    w = c_0 + c_1 x + c_2 x^2 + c_3 x^3, x = (z - start) / (end - start).
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self._pieces = [beam_pieces(structure, j) for j in range(1, len(structure.beam) + 1)]
        first = np.cumsum([0, *(4 * len(p) for p in self._pieces)])
        inputs = len(structure.patch) + len(structure.beam)
        rows, right = [], []

        def equation(*parts: tuple[int, Real, float], forcing: Real | None = None) -> None:
            row = np.zeros(first[-1])
            for column, coefficients, factor in parts:
                row[column : column + 4] += factor * coefficients
            norm = np.linalg.norm(row)
            rows.append(row / norm)
            right.append((np.zeros(inputs) if forcing is None else forcing) / norm)

        def last(j: int) -> tuple[int, Piece]:
            return int(first[j + 1]) - 4, self._pieces[j][-1]

        for j, pieces in enumerate(self._pieces):
            start = int(first[j])
            equation((start, _cubic(pieces[0], 0, 0), 1.0))
            equation((start, _cubic(pieces[0], 0, 1), 1.0))
            for e, (p, n) in enumerate(pairwise(pieces)):
                a, b = start + 4 * e, start + 4 * e + 4
                for d in (0, 1):
                    equation((a, _cubic(p, 1, d), 1.0), (b, _cubic(n, 0, d), -1.0))
                equation(
                    (a, _cubic(p, 1, 2), p.bending_stiffness),
                    (b, _cubic(n, 0, 2), -n.bending_stiffness),
                    forcing=n.moment - p.moment,
                )
                equation((a, _cubic(p, 1, 3), p.bending_stiffness), (b, _cubic(n, 0, 3), -n.bending_stiffness))
            at, end = last(j)
            equation((at, _cubic(end, 1, 2), end.bending_stiffness), forcing=-end.moment)
            shear: list[tuple[int, Real, float]] = [(at, _cubic(end, 1, 3), -end.bending_stiffness)]
            for spring in structure.spring:
                if j + 1 in spring.between:
                    there, other = last(sum(spring.between) - j - 2)
                    shear += [
                        (at, _cubic(end, 1, 0), spring.stiffness),
                        (there, _cubic(other, 1, 0), -spring.stiffness),
                    ]
            equation(*shear, forcing=np.eye(inputs)[len(structure.patch) + j])
        solution = np.linalg.solve(np.array(rows), np.array(right))
        self._coefficients = [
            solution[first[j] : first[j + 1]].reshape(-1, 4, inputs) for j in range(len(structure.beam))
        ]

    def derivative(self, beam: int, z: float, order: int) -> Real:
        """Derivative of the deflection of beam `beam` (from 1) at z, for each input; (n_u + r,)."""
        pieces = self._pieces[beam - 1]
        e = next((e for e, p in enumerate(pieces) if z < p.end), len(pieces) - 1)
        x = (z - pieces[e].start) / (pieces[e].end - pieces[e].start)
        value: Real = _cubic(pieces[e], x, order) @ self._coefficients[beam - 1][e]
        return value

    def deflection(self) -> Real:
        """Deflection at the points of interest; (n_pi, n_u + r)."""
        return np.stack([self.derivative(p.beam, p.position, 0) for p in self.structure.point_of_interest])

    def strain(self) -> Real:
        """Strain at the gauges, mean over their length; (n_pm, n_u + r)."""
        rows = []
        for g in self.structure.strain_gauge:
            half = self.structure.beam[g.beam - 1].thickness / 2
            if g.length == 0:
                rows.append(half * self.derivative(g.beam, g.position, 2))
            else:
                a, b = (self.derivative(g.beam, g.position + side * g.length / 2, 1) for side in (-1, 1))
                rows.append(half * (b - a) / g.length)
        return np.stack(rows)


def _cubic(piece: Piece, x: float, order: int) -> Real:
    """Derivative with respect to z of (1, x, x^2, x^3)."""
    values = [[1, x, x**2, x**3], [0, 1, 2 * x, 3 * x**2], [0, 0, 2, 6 * x], [0, 0, 0, 6]][order]
    return np.array(values, float) / (piece.end - piece.start) ** order
