"""How far a basis is from the exact solution: `python -m tests.oracles.accuracy [structure.toml]` prints a table."""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.oracles.boundary_value import LaplaceSolution, StaticSolution

Matrix = NDArray[np.float64] | NDArray[np.complex128]

FREQUENCIES = (10.0, 15.0, 35.0, 60.0, 110.0, 200.0, 350.0, 600.0)  # rad/s


def entrywise(found: Matrix, exact: Matrix) -> float:
    """Largest error of an entry relative to the entry itself."""
    return float(np.max(np.abs(found - exact) / np.abs(exact)))


def rowwise(found: Matrix, exact: Matrix) -> float:
    """Largest error relative to the largest entry of its row: of one output to any of the inputs."""
    return float(np.max(np.abs(found - exact) / np.max(np.abs(exact), axis=1, keepdims=True)))


def response(model: BeamModel, s: complex) -> tuple[Matrix, Matrix]:
    """Transfer functions from voltages and tip forces to y_pi and y_pm at s; (n_pi | n_pm, n_u + r)."""
    system = model.assemble()
    rest = np.linalg.solve(system.K + s * system.D + s**2 * system.M, np.hstack([system.L, system.F]))
    return model.deflection @ rest, model.strain @ rest


@dataclass(frozen=True)
class Errors:
    """Relative errors of the responses to the voltages."""

    unknowns: int
    static_deflection: float  # entry by entry
    static_strain: float  # each gauge relative to its largest
    deflection: NDArray[np.float64]  # as static_deflection, one for each frequency
    strain: NDArray[np.float64]  # as static_strain


def errors(structure: Structure, basis: BasisName, order: int, frequencies: tuple[float, ...] = FREQUENCIES) -> Errors:
    """Errors of a model at rest and at the frequencies (rad/s) against the exact solutions."""
    model, inputs = beam_model(structure, basis, order), len(structure.patch)
    found, exact = response(model, 0.0), StaticSolution(structure)
    static = (
        entrywise(found[0][:, :inputs], exact.deflection()[:, :inputs]),
        rowwise(found[1][:, :inputs], exact.strain()[:, :inputs]),
    )
    moving = []
    for frequency in frequencies:
        found, dynamic = response(model, 1j * frequency), LaplaceSolution(structure, 1j * frequency)
        moving.append(
            (
                entrywise(found[0][:, :inputs], dynamic.deflection()[:, :inputs]),
                rowwise(found[1][:, :inputs], dynamic.strain()[:, :inputs]),
            )
        )
    deflection, strain = np.array(moving).T
    return Errors(model.size, *static, deflection, strain)


def main() -> None:
    """Print the errors of both bases on a structure, kiel unless another is named."""
    structure = read_structure(find_structure(sys.argv[1] if len(sys.argv) > 1 else "kiel"))
    print("relative errors: deflection entry by entry, strain relative to each gauge's largest")
    print(
        f"{'basis':<13}{'order':>6}{'n':>5}{'':>12}{'static':>9}"
        + "".join(f"{w:>9.0f}" for w in FREQUENCIES)
        + "  rad/s"
    )
    cases: list[tuple[BasisName, int]] = [
        ("clamped_free", 10),
        ("clamped_free", 20),
        ("clamped_free", 40),
        ("segment", 5),
        ("segment", 7),
        ("segment", 9),
    ]
    for basis, order in cases:
        e = errors(structure, basis, order)
        for name, static, moving in (
            ("deflection", e.static_deflection, e.deflection),
            ("strain", e.static_strain, e.strain),
        ):
            print(
                f"{basis:<13}{order:>6}{e.unknowns:>5}{name:>12}{static:>9.1e}" + "".join(f"{x:>9.1e}" for x in moving)
            )


if __name__ == "__main__":
    main()
