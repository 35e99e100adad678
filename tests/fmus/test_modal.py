"""The modal form in C against the dense exponential: structures, coinciding eigenvalues, critical damping, any step."""

import subprocess
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.structure import find_structure, read_structure
from tests.native.processors import ARM64
from tests.native.workshop import HARNESSES, STRICT, needs, needs_zig, run, workspace

pytestmark = pytest.mark.native

NUMERICS = HARNESSES.parents[1] / "fmus" / "native" / "numerics"
SOURCES = (
    "block_modes.c",
    "cluster_vectors.c",
    "coupled_modes.c",
    "eigenvectors.c",
    "exact_hold.c",
    "linear_algebra.c",
    "modal.c",
    "modal_build.c",
    "mode_clusters.c",
    "modes.c",
    "schur.c",
)
# Stops at the first access out of bounds or arithmetic that C leaves open; unoptimised, no check is removed
SANITIZED = (
    *("clang", "-O0", "-gline-tables-only"),
    *("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"),
)
CRITICAL_CONDITION = 100.0  # above it the plant takes the dense form

Array = NDArray[np.float64]


@cache
def harness(*command: str) -> Path:
    """The harness compiled by a command."""
    program = workspace() / f"modal-{abs(hash(command))}"
    files = [*(NUMERICS / name for name in SOURCES), HARNESSES / "modal.c"]
    includes = (f"-I{NUMERICS}", f"-I{NUMERICS.parent}")
    run([*command, *STRICT, "-Wshadow", *includes, *map(str, files), "-o", str(program), "-lm"])
    return program


@dataclass(frozen=True, kw_only=True)
class System:
    """x' = A x + B v, y = C x; the last `rare` inputs are often 0."""

    A: Array
    B: Array
    C: Array
    rare: int = 0
    blocks: Array | None = None  # number of each state's block, of a form that is built by them


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the harness gives; NaN and empty where the condition is too large."""

    condition: float
    complex_pairs: float
    in_range: bool
    x: Array
    y: Array


def run_modal(
    system: System,
    step: float,
    steps: int,
    v: ArrayLike,
    growth: ArrayLike = 0.0,
    start: ArrayLike = 0.0,
    command: tuple[str, ...] = ("gcc", "-O2"),
    through: tuple[str, ...] = (),
) -> Outcome:
    """The system after so many steps from `start`, inputs v at first and greater by `growth` after each step."""
    states, inputs, outputs = len(system.A), system.B.shape[1], len(system.C)
    blocks = np.zeros(states) if system.blocks is None else system.blocks
    sizes = (states, inputs - system.rare, system.rare, outputs, step, steps, system.blocks is not None)
    vectors = [np.broadcast_to(a, size) for a, size in ((start, states), (v, inputs), (growth, inputs))]
    arrays = [np.array(sizes), system.A, blocks, system.B, system.C, *vectors]
    data = b"".join(np.ascontiguousarray(a, dtype=float).tobytes() for a in arrays)
    done = subprocess.run([*through, harness(*command)], input=data, capture_output=True, timeout=300, check=True)
    numbers = np.frombuffer(done.stdout)
    if len(numbers) == 1:
        return Outcome(condition=numbers[0], complex_pairs=np.nan, in_range=False, x=np.array([]), y=np.array([]))
    x, y = np.split(numbers[3:], [states])
    return Outcome(condition=numbers[0], complex_pairs=numbers[1], in_range=bool(numbers[2]), x=x, y=y)


def run_dense(
    system: System, step: float, steps: int, v: ArrayLike, growth: ArrayLike = 0.0, start: ArrayLike = 0.0
) -> Array:
    """The same x by the exponential of [A, B, 0; 0, 0, I / h; 0, 0, 0]."""
    n, m = system.B.shape
    wide = np.zeros((n + 2 * m, n + 2 * m))
    wide[:n, : n + m] = np.hstack([system.A, system.B])
    wide[n : n + m, n + m :] = np.eye(m) / step
    transition = discretise(wide, np.zeros((n + 2 * m, 1)), step)[0]
    state = np.concatenate([np.broadcast_to(a, size) for a, size in ((start, n), (v, m), (growth, m))])
    for _ in range(steps):
        state = transition @ state
    return state[:n]


def difference(x: Array, reference: Array) -> float:
    """Largest difference over the largest value."""
    return float(np.max(np.abs(x - reference)) / np.max(np.abs(reference)))


@cache
def structure_system(structure: str, basis: BasisName, order: int, damping: float = 1.0) -> System:
    """A structure's plant in energy coordinates, its structural damping multiplied."""
    beams = read_structure(find_structure(structure))
    model = beam_model(beams, basis, order)
    damped = {name: damping * value for name, value in beams.parameters().items() if "structural_damping" in name}
    matrices = model.assemble(damped)
    form = energy_form(matrices.M, matrices.D, matrices.K, np.hstack([matrices.L, matrices.F]))
    return System(
        A=form.A,
        B=form.B,
        C=form.outputs(np.vstack([model.deflection, model.strain])),
        rare=matrices.F.shape[1],
    )


def oscillators(*modes: tuple[float, float]) -> Array:
    """A of oscillators with frequency (rad/s) and damping ratio, in energy coordinates."""
    return block_diag(*[[[0.0, w], [-w, -2 * ratio * w]] for w, ratio in modes])


def mixed(A: Array, seed: int = 4) -> System:
    """A in other orthonormal coordinates, with three inputs and two outputs."""
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.standard_normal(A.shape))[0]
    return System(
        A=rotation @ A @ rotation.T,
        B=rng.standard_normal((len(A), 3)),
        C=rng.standard_normal((2, len(A))),
        rare=1,
    )


STRUCTURES = [
    ("kiel", "clamped_free", 10),
    ("kiel", "clamped_free", 40),
    ("kiel", "segment", 5),
    ("kiel", "segment", 9),
    ("five_beams", "clamped_free", 10),
    ("single_beam", "clamped_free", 2),
]


@needs("gcc")
@pytest.mark.parametrize(("structure", "basis", "order"), STRUCTURES)
@pytest.mark.parametrize("step", [1e-6, 2e-4, 1e-2])
def test_a_structure_steps_as_by_its_exponential(structure: str, basis: BasisName, order: int, step: float) -> None:
    system = structure_system(structure, basis, order)
    v = 1.0 + 0.3 * np.arange(system.B.shape[1])
    steps = 2000 if step > 1e-6 else 200
    outcome = run_modal(system, step, steps, v)
    reference = run_dense(system, step, steps, v)
    assert outcome.condition < 1.01
    assert outcome.complex_pairs == len(system.A) / 2
    assert outcome.in_range
    assert difference(outcome.x, reference) < 2e-12
    assert np.all(np.abs(outcome.y - system.C @ reference) <= 5e-12 * np.abs(system.C) @ np.abs(reference))


@needs("gcc")
@pytest.mark.parametrize("step", [2e-4, 3e-2])
def test_inputs_that_grow_over_a_step(step: float) -> None:
    system = structure_system("kiel", "clamped_free", 10)
    inputs = system.B.shape[1]
    v, growth = 2.0 - np.arange(inputs), 0.5 + 0.1 * np.arange(inputs) ** 2
    start = np.sin(np.arange(len(system.A)))
    outcome = run_modal(system, step, 50, v, growth, start)
    assert difference(outcome.x, run_dense(system, step, 50, v, growth, start)) < 1e-13


@needs("gcc")
def test_rare_inputs_count_where_they_are_not_0() -> None:
    system = structure_system("kiel", "clamped_free", 10)
    common = System(A=system.A, B=system.B, C=system.C)
    still = np.array([1.0, -2.0, 0.5, 3.0, 0.0, 0.0, 0.0])
    pushed = still + [0, 0, 0, 0, 0.0, 0.1, 0.0]
    assert np.array_equal(run_modal(system, 1e-3, 40, still).x, run_modal(common, 1e-3, 40, still).x)
    assert np.array_equal(run_modal(system, 1e-3, 40, pushed).x, run_modal(common, 1e-3, 40, pushed).x)
    assert difference(run_modal(system, 1e-3, 40, pushed).x, run_dense(system, 1e-3, 40, pushed)) < 1e-13
    growing = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0])
    outcome = run_modal(system, 1e-3, 1, still, growing)
    assert difference(outcome.x, run_dense(system, 1e-3, 1, still, growing)) < 1e-13


@needs("gcc")
@pytest.mark.parametrize("count", [2, 3, 5])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_eigenvalues_that_coincide(count: int, seed: int) -> None:
    """Identical beams that nothing couples, in coordinates that mix them."""
    one = structure_system("single_beam", "clamped_free", 6).A
    system = mixed(block_diag(*[one] * count), seed)
    outcome = run_modal(system, 1e-3, 500, [1.0, -2.0, 0.5])
    assert outcome.condition < 30
    assert difference(outcome.x, run_dense(system, 1e-3, 500, [1.0, -2.0, 0.5])) < 1e-11


@needs("gcc")
@pytest.mark.parametrize("damping", [5.0, 24.0, 30.0, 80.0, 400.0])
def test_strong_damping(damping: float) -> None:
    """From the first overdamped mode (24.6 times the structure's own damping) to most of them."""
    system = structure_system("kiel", "clamped_free", 10, damping)
    outcome = run_modal(system, 2e-4, 1000, 1.0)
    assert outcome.condition < CRITICAL_CONDITION
    assert (outcome.complex_pairs < 30) == (damping > 24.5)
    assert difference(outcome.x, run_dense(system, 2e-4, 1000, 1.0)) < 1e-11


@needs("gcc")
@pytest.mark.parametrize("distance", [1e-1, 1e-2, 1e-3, 1e-5, 1e-9, 0.0, -1e-9, -1e-3])
def test_the_condition_tells_how_near_critical_damping_is(distance: float) -> None:
    """1 / sqrt(2 |distance|) for a damping ratio of 1 - distance, beyond all bounds at 0."""
    system = mixed(oscillators((20.0, 1.0 - distance), (50.0, 0.01), (300.0, 0.02)))
    outcome = run_modal(system, 1e-3, 300, 1.0)
    if abs(distance) >= 1e-3:
        assert outcome.condition == pytest.approx(1 / np.sqrt(2 * abs(distance)), rel=0.1)
        assert outcome.condition < CRITICAL_CONDITION
        assert difference(outcome.x, run_dense(system, 1e-3, 300, 1.0)) < 1e-12
    else:
        assert outcome.condition > CRITICAL_CONDITION


@needs("gcc")
@pytest.mark.parametrize("size", [2, 4, 6, 10, 30, 100])
def test_random_systems(size: int) -> None:
    """Not symmetric at all, with real and complex eigenvalues in every number."""
    rng = np.random.default_rng(size)
    for _ in range(20):
        A = rng.standard_normal((size, size)) - 1.5 * np.sqrt(size) * np.eye(size)
        system = System(A=A, B=rng.standard_normal((size, 2)), C=rng.standard_normal((3, size)), rare=1)
        start = rng.standard_normal(size)
        outcome = run_modal(system, 0.03, 20, [1.0, 2.0], [0.1, 0.0], start)
        eigenvalues, vectors = np.linalg.eig(A)
        inverse = np.linalg.inv(vectors)
        condition = np.max(np.linalg.norm(vectors, axis=0) * np.linalg.norm(inverse, axis=1))
        reference = run_dense(system, 0.03, 20, [1.0, 2.0], [0.1, 0.0], start)
        assert outcome.complex_pairs == np.sum(eigenvalues.imag > 0)
        assert outcome.condition == pytest.approx(condition, rel=1e-6)
        assert difference(outcome.x, reference) < 1e-14 * condition * size
        assert difference(outcome.y, system.C @ outcome.x) < 1e-14 * condition * size


@needs("gcc")
def test_eigenvalues_that_are_0() -> None:
    """A body that drifts, a constant and a decay: inputs integrate exactly. A double integrator has no modal form."""
    A = np.zeros((4, 4))
    A[1, 1], A[3, 2] = -5.0, 2.0
    drifting = mixed(A)
    outcome = run_modal(drifting, 0.5, 10, [1.0, 2.0, 3.0], [0.0, 0.1, 0.0])
    assert outcome.condition > CRITICAL_CONDITION
    A[3, 2] = 0.0
    constant = mixed(A)
    outcome = run_modal(constant, 0.5, 10, [1.0, 2.0, 3.0], [0.0, 0.1, 0.0])
    assert outcome.condition < 2
    assert difference(outcome.x, run_dense(constant, 0.5, 10, [1.0, 2.0, 3.0], [0.0, 0.1, 0.0])) < 1e-14


@needs("gcc")
def test_steps_of_any_length() -> None:
    """Up to where everything has decayed, or turned so often that its angle is lost."""
    system = structure_system("kiel", "clamped_free", 10)
    v = np.array([1.0, 2.0, -1.0, 0.5, 0.0, 0.0, 0.1])
    rest = -np.linalg.solve(system.A, system.B @ v)
    for step in (1e3, 1e8, 1e300):
        outcome = run_modal(system, step, 2, v)
        assert outcome.in_range
        assert difference(outcome.x, rest) < 1e-13
    still = run_modal(system, 1e-300, 3, v, start=rest)
    assert difference(still.x, rest) < 1e-13
    undamped = mixed(oscillators((20.0, 0.0), (300.0, 0.0)))
    turned = run_modal(undamped, 1e8, 1, 0.0, start=1.0)
    assert np.linalg.norm(turned.x) == pytest.approx(2.0, rel=1e-4)  # damping ratios are 0 to rounding only
    growing = mixed(oscillators((20.0, -0.5)))
    assert run_modal(growing, 60.0, 1, 1.0).in_range
    assert not run_modal(growing, 80.0, 1, 1.0).in_range


@needs("gcc")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_matrix_that_is_not_finite_has_no_modal_form(value: float) -> None:
    A = oscillators((20.0, 0.1), (30.0, 0.1))
    A[2, 1] = value
    system = System(A=A, B=np.ones((4, 1)), C=np.ones((1, 4)))
    assert run_modal(system, 1e-3, 1, 1.0).condition == np.inf


@needs("gcc")
@pytest.mark.parametrize("scale", [1e-150, 1e150])
def test_matrices_of_any_size(scale: float) -> None:
    """Nothing overflows on the way: time is in other units only."""
    system = structure_system("kiel", "clamped_free", 10)
    scaled = System(A=system.A * scale, B=system.B * scale, C=system.C, rare=system.rare)
    reference = run_modal(system, 1e-3, 100, 1.0)
    outcome = run_modal(scaled, 1e-3 / scale, 100, 1.0)
    assert outcome.condition == pytest.approx(reference.condition, rel=1e-9)
    assert difference(outcome.x, reference.x) < 1e-12


@needs("gcc")
def test_functions_of_a_step() -> None:
    """exp(l) - 1, h phi1(l) and h phi2(l) to rounding, for eigenvalues of any size, against more digits."""
    rng = np.random.default_rng(5)
    sizes = 10.0 ** rng.uniform(-12, 4, 600)
    angles = rng.uniform(0, np.pi / 2, 600) + np.pi / 2
    steps = 10.0 ** rng.uniform(-6, 2, 600)
    real, imaginary = sizes * np.cos(angles) / steps, sizes * np.sin(angles) / steps
    edges = [
        (0.0, 0.0, 1.0),
        (-0.5, 0.0, 1.0),
        (-0.35, 0.36, 1.0),
        (0.0, 0.5, 1.0),
        (0.0, np.pi, 3.0),
        (-1e4, 1.0, 1.0),
    ]
    arguments = np.vstack([np.column_stack([real, imaginary, steps]), edges])
    done = subprocess.run([harness("gcc", "-O2"), "hold"], input=arguments.tobytes(), capture_output=True, check=True)
    results = np.frombuffer(done.stdout).reshape(-1, 3, 2)
    for (re, im, h), result in zip(arguments, results, strict=True):
        exponent = np.clongdouble(complex(re * h, im * h))
        phi1, phi2 = exact_phi(exponent)
        angle_error = 1.2e-16 * abs(exponent) if exponent.real > -40 else 0.0
        for (value_re, value_im), expected in zip(result, (exponent * phi1, h * phi1, h * phi2), strict=True):
            error = abs(complex(value_re, value_im) - complex(expected))
            assert error <= (8e-16 + angle_error) * abs(complex(expected))


def exact_phi(exponent: np.clongdouble) -> tuple[np.clongdouble, np.clongdouble]:
    """phi1 and phi2 in extended precision: by series where the exponent is small."""
    if abs(exponent) > 1:
        phi1 = (np.exp(exponent) - 1) / exponent
        return phi1, (phi1 - 1) / exponent
    phi2, term = np.clongdouble(0), np.clongdouble(0.5)
    for k in range(3, 30):
        phi2, term = phi2 + term, term * exponent / k
    return 1 + exponent * phi2, phi2


def bits(command: tuple[str, ...], through: tuple[str, ...] = ()) -> list[bytes]:
    """States of four systems after steps that take every branch."""
    rng = np.random.default_rng(0)
    full = rng.standard_normal((20, 20)) - 4 * np.eye(20)
    systems = (
        System(A=full, B=rng.standard_normal((20, 2)), C=rng.standard_normal((2, 20))),
        structure_system("kiel", "clamped_free", 10),
        structure_system("kiel", "clamped_free", 10, 30.0),
        mixed(block_diag(*[oscillators((20.0, 0.01), (400.0, 1.3))] * 3)),
    )
    return [
        run_modal(s, step, 30, 1.0 + np.arange(s.B.shape[1]), 0.1, 0.5, command, through).x.tobytes()
        for s in systems
        for step in (3e-5, 2e-3, 5.0)
    ]


@needs("gcc", "clang")
@pytest.mark.parametrize(
    "command",
    [
        ("gcc", "-O0"),
        ("gcc", "-O3"),
        ("gcc", "-O2", "-march=x86-64-v3"),  # fuses some products, allowed or not
        ("gcc", "-O3", "-march=x86-64-v3"),
        ("gcc", "-O2", "-U__SSE2__"),  # no vector types
        ("clang", "-O2"),
        ("clang", "-O3"),
    ],
    ids=" ".join,
)
def test_every_compiler_gives_the_same_bits(command: tuple[str, ...]) -> None:
    assert bits(command) == bits(("gcc", "-O2"))


@needs_zig
@needs("gcc")
@ARM64.needed
def test_other_processors_give_the_same_bits() -> None:
    assert bits((*ARM64.compiler, "-O2"), ARM64.through) == bits(("gcc", "-O2"))


@needs("clang")
def test_no_undefined_behaviour() -> None:
    assert bits(SANITIZED) == bits(("gcc", "-O2"))
    for size in (2, 4, 6, 8, 10):
        system = mixed(-np.eye(size) + np.tri(size), size)
        run_modal(system, 0.1, 3, 1.0, 0.2, command=SANITIZED)
