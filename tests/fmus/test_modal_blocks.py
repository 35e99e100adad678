"""The modal form built by blocks: chains of beams of any kind step as by their exponential."""

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.sparse.csgraph import connected_components

from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import energy_form
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.fmus.test_modal import (
    CRITICAL_CONDITION,
    SANITIZED,
    Array,
    Outcome,
    System,
    difference,
    harness,
    run_dense,
    run_modal,
)
from tests.native.workshop import needs
from tests.oracles.chains import chain_of_beams

pytestmark = [pytest.mark.native, needs("gcc")]

STEP, STEPS = 2e-4, 300


def repeated(beams: int, kinds: int) -> Structure:
    """A chain of beams of so many kinds in turn, with equal springs."""
    kiel, chain = read_structure(find_structure("kiel")), chain_of_beams(beams)
    numbers = range(1, beams + 1)
    return replace(
        chain,
        beam=[replace(kiel.beam[0], density=kiel.beam[0].density * (1 + 0.1 * (k % kinds))) for k in numbers],
        patch=[replace(kiel.patch[0], beam=k) for k in numbers],
        spring=[replace(kiel.spring[0], between=(k, k + 1)) for k in numbers[:-1]],
    )


def with_springs(structure: Structure, factor: float) -> Structure:
    """The stiffness of the springs multiplied."""
    return replace(structure, spring=[replace(s, stiffness=factor * s.stiffness) for s in structure.spring])


def with_damping(structure: Structure, factor: float) -> Structure:
    """The structural damping of beams and patches multiplied."""

    def damped(parts: list) -> list:
        return [replace(part, structural_damping=factor * part.structural_damping) for part in parts]

    return replace(structure, beam=damped(structure.beam), patch=damped(structure.patch))


BY_BLOCKS = {
    "varied": chain_of_beams(6),
    "alike": repeated(6, 1),
    "two kinds in turn": repeated(7, 2),  # modes that coincide and that only others couple
    "almost free": with_springs(chain_of_beams(5), 1e-3),
    "alike and all but free": with_springs(repeated(6, 1), 1e-9),  # couplings about rounding
    "overdamped": with_damping(chain_of_beams(5), 24.0),  # both kinds of eigenvalues
}
AS_A_WHOLE = {
    "rigid springs": with_springs(chain_of_beams(5), 1e5),
    "near critical damping": with_damping(repeated(5, 2), 60.0),
}


def plant(structure: Structure, basis: BasisName = "segment", order: int = 5) -> System:
    """In energy coordinates; a block is a beam."""
    model = beam_model(structure, basis, order)
    matrices = model.assemble()
    form = energy_form(matrices.M, matrices.D, matrices.K, np.hstack([matrices.L, matrices.F]))
    beams = connected_components(matrices.M)[1]
    assert beams.max() + 1 == len(structure.beam)
    outputs = form.outputs(np.vstack([model.deflection, model.strain]))
    return System(A=form.A, B=form.B, C=outputs, rare=matrices.F.shape[1], blocks=np.tile(beams, 2).astype(float))


def run(system: System) -> Outcome:
    return run_modal(system, STEP, STEPS, inputs(system), start=start(system))


def inputs(system: System) -> Array:
    return np.cos(np.arange(system.B.shape[1]))


def start(system: System) -> Array:
    return np.sin(np.arange(len(system.A)))


def test_blocks_are_those_of_a_lower_triangle() -> None:
    """Blocks of any size, of which a row has an entry beside the diagonal at least."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        sizes = rng.integers(1, 6, 5)
        full = block_diag(*[np.ones((size, size)) for size in sizes])
        chains = np.where(rng.random(full.shape) < 0.3, full, 0.0) + np.diag(np.diag(full, -1), -1)
        L = np.tril(chains, -1) + np.eye(len(full))
        data = np.concatenate([[len(L)], L.ravel()]).tobytes()
        done = subprocess.run([harness("gcc", "-O2"), "blocks"], input=data, capture_output=True, check=True)
        assert np.array_equal(np.frombuffer(done.stdout), np.repeat(np.arange(5.0), sizes))


def check(system: System) -> Outcome:
    """Steps as by the exponential."""
    outcome = run(system)
    reference = run_dense(system, STEP, STEPS, inputs(system), start=start(system))
    assert outcome.condition < CRITICAL_CONDITION
    assert difference(outcome.x, reference) < 1e-12
    assert difference(outcome.y, system.C @ reference) < 1e-12
    return outcome


@pytest.mark.parametrize("name", BY_BLOCKS)
def test_a_chain_steps_as_by_its_exponential(name: str) -> None:
    system = plant(BY_BLOCKS[name])
    outcome, whole = check(system), run(replace(system, blocks=None))
    assert outcome.complex_pairs == whole.complex_pairs
    assert difference(outcome.x, whole.x) > 0.0  # other rounding: it was built by blocks


@pytest.mark.parametrize("name", AS_A_WHOLE)
def test_what_mixes_too_much_is_built_as_a_whole(name: str) -> None:
    system = plant(AS_A_WHOLE[name])
    assert np.array_equal(check(system).x, run(replace(system, blocks=None)).x)


@pytest.mark.parametrize("blocks", [np.zeros(40), np.arange(40.0), np.arange(40.0) % 4])
def test_blocks_that_are_none(blocks: Array) -> None:
    """Couplings of full rank, or blocks of one state."""
    rng = np.random.default_rng(4)
    A = rng.standard_normal((40, 40)) - 10 * np.eye(40)
    system = System(A=A, B=rng.standard_normal((40, 2)), C=rng.standard_normal((3, 40)), blocks=blocks)
    assert np.array_equal(run(system).x, run(replace(system, blocks=None)).x)


def test_blocks_that_nothing_couples() -> None:
    """The same one, three times, and in any order of states."""
    one = plant(repeated(1, 1))
    A, B = np.kron(np.eye(3), one.A), np.tile(one.B, (3, 1))
    C = np.tile(one.C, 3)
    order = np.random.default_rng(3).permutation(len(A))
    system = System(A=A[np.ix_(order, order)], B=B[order], C=C[:, order], blocks=np.repeat(np.arange(3.0), 24)[order])
    assert check(system).condition < 1.01


@pytest.mark.parametrize("scale", [1e-140, 1e140])
def test_matrices_of_any_size(scale: float) -> None:
    system = plant(BY_BLOCKS["varied"])
    scaled = replace(system, A=system.A * scale, B=system.B * scale)
    outcome = run_modal(scaled, STEP / scale, STEPS, inputs(system), start=start(system))
    assert difference(outcome.x, run(system).x) < 1e-12


def bits(command: tuple[str, ...], through: tuple[str, ...] = ()) -> list[bytes]:
    """States of chains that take every branch."""
    systems = [plant(BY_BLOCKS[name]) for name in ("two kinds in turn", "overdamped")]
    return [run_modal(s, STEP, 5, inputs(s), 0.1, start(s), command, through).x.tobytes() for s in systems]


@needs("clang")
@pytest.mark.parametrize(
    "command",
    [("gcc", "-O3", "-march=x86-64-v3"), ("gcc", "-O2", "-U__SSE2__"), ("clang", "-O2")],
    ids=" ".join,
)
def test_every_compiler_gives_the_same_bits(command: tuple[str, ...]) -> None:
    assert bits(command) == bits(("gcc", "-O2"))


@needs("clang")
def test_no_undefined_behaviour() -> None:
    assert bits(SANITIZED) == bits(("gcc", "-O2"))


@needs("clang")
@pytest.mark.parametrize("beams", [2, 3, 4])
def test_few_beams_of_few_modes(beams: int) -> None:
    """The memory that is enough for the whole may not be enough for blocks; springs may be missing."""
    for order in range(1, 14):
        for structure in (repeated(beams, 1), repeated(beams, beams)):
            for springs in ([], *(with_springs(structure, factor).spring for factor in (1.0, 1e-2, 1e-6))):
                system = plant(replace(structure, spring=springs), "clamped_free", order)
                outcome = run_modal(system, STEP, 5, inputs(system), start=start(system), command=SANITIZED)
                reference = run_dense(system, STEP, 5, inputs(system), start=start(system))
                assert difference(outcome.x, reference) < 1e-12, (order, len(springs))
