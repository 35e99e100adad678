"""Canonical coordinates: one choice of signs and rotations on every machine."""

import itertools
import os
import platform
import signal
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.canonical import NEARLY_EQUAL, RELIABLE_GAP, canonical_coordinates
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.flat_output import FlatParameterisation
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BASES
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.helpers import ROOT
from tests.oracles.examples import equal_beams, uncoupled_beams
from tests.oracles.monolithic import largest_difference, simulate

# Kernels of OpenBLAS that round differently, in the order of their age; the last one needs AVX-512
KERNELS = ("Prescott", "Sandybridge", "Haswell", "SkylakeX")
TARGET = [-8e-3, 1e-3, 4e-3, -6e-3]


def random_rotation(size: int, seed: int) -> Array:
    """An orthogonal matrix."""
    return np.asarray(np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))[0])


def test_states_of_distinct_singular_values_only_change_sign() -> None:
    """The first point above 0.55 of the largest is positive, although the largest is negative in the first state."""
    features = np.array([[0.1, 0.0], [0.7, -3.0], [-1.0, 2.0], [0.0, 0.1]])
    found = canonical_coordinates(np.array([5.0, 4.0, 1.0]), features)
    np.testing.assert_array_equal(found.rotation, np.diag([1.0, -1.0]))
    assert found.groups == (1, 1)
    assert found.truncation_gap == pytest.approx(0.75)


@pytest.mark.parametrize("seed", range(5))
def test_a_group_has_one_rotation_whatever_the_singular_vectors(seed: int) -> None:
    """States 2 to 4 arrive in any rotation and all states with any sign; their features leave the same."""
    gap = NEARLY_EQUAL / 2
    sigma = np.array([3.0, 2.0, 2.0 * (1 - gap), 2.0 * (1 - gap) ** 2, 1.0, 0.5])
    features = np.random.default_rng(99).normal(size=(9, 5))
    turn = np.diag(np.random.default_rng(seed).choice([-1.0, 1.0], size=5))
    turn[1:4, 1:4] = random_rotation(3, seed)
    here, there = (canonical_coordinates(sigma, f) for f in (features, features @ turn))
    assert here.groups == there.groups == (1, 3, 1)
    np.testing.assert_allclose(features @ turn @ there.rotation, features @ here.rotation, rtol=0, atol=1e-13)
    np.testing.assert_allclose(there.rotation.T @ there.rotation, np.eye(5), rtol=0, atol=1e-14)


def test_groups_end_at_the_threshold() -> None:
    for gap, groups in ((NEARLY_EQUAL * 1.01, (1, 1)), (NEARLY_EQUAL * 0.99, (2,))):
        assert canonical_coordinates(np.array([1.0, 1 - gap, 0.1]), np.eye(2)).groups == groups


@pytest.mark.parametrize(("gap", "reliable"), [(RELIABLE_GAP * 1.01, True), (RELIABLE_GAP * 0.99, False)])
def test_a_truncation_between_nearly_equal_values_is_not_reliable(gap: float, reliable: bool) -> None:
    assert canonical_coordinates(np.array([2.0, 1.0, 1 - gap]), np.eye(2)).reliable is reliable
    assert canonical_coordinates(np.array([2.0, 1.0]), np.eye(2)).reliable


@pytest.mark.parametrize("basis", BASES)
def test_equal_uncoupled_beams_keep_states_of_their_own(basis: str) -> None:
    """A threefold singular value is one state of each beam, in the order of the beams."""
    made = compute_design(uncoupled_beams(), DesignOptions(basis=basis))  # type: ignore[arg-type]
    deflection = made.arrays["H_w"][:, :15].reshape(3, -1, 5, 3)  # beam, station, group, state of the group
    sizes = np.max(np.abs(deflection), axis=1).transpose(1, 0, 2)  # group, beam, state
    for size in sizes:
        np.testing.assert_allclose(size, size[0, 0] * np.eye(3), rtol=0, atol=1e-9 * size.max())
    assert made.summary["state_groups"] == {"position": [3] * 5, "velocity": [3] * 5}


def test_rotated_states_have_the_same_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights follow the balanced states, so gains from strains to voltages do not depend on the coordinates."""

    def transfer(made: Design) -> Array:
        a = made.arrays
        A = a["A_d"] - a["estimator_gain"] @ a["H_pm"] - a["B_d"] @ a["feedback_gain"]
        return np.asarray(a["feedback_gain"] @ np.linalg.solve(1.02 * np.eye(30) - A, a["estimator_gain"]))

    grouped = compute_design(equal_beams(), DesignOptions())
    assert max(grouped.summary["state_groups"]["velocity"]) > 1
    monkeypatch.setattr("flexbeams.controller.canonical.NEARLY_EQUAL", 0.0)
    single = compute_design(equal_beams(), DesignOptions())
    assert max(single.summary["state_groups"]["velocity"]) == 1
    assert largest_difference(transfer(grouped), transfer(single)) < 1e-9


# --- One design on every machine --------------------------------------------------------------------------------------


@cache
def structures() -> dict[str, Structure]:
    shipped = {name: read_structure(find_structure(name)) for name in ("kiel", "five_beams")}
    return {**shipped, "equal_beams": equal_beams()}


CASES = tuple(itertools.product(("kiel", "five_beams", "equal_beams"), BASES))


def state_series(arrays: dict[str, Array]) -> Array:
    """x_r by each derivative and voltage (m, m, n_u): what all modes together give; modes of equal eigenvalues alone
    are any of many."""
    flat = FlatParameterisation.of(arrays)
    amplitudes = [flat.complex_series[:, i, None] * flat.complex_inputs for i in range(flat.degree)]
    return np.stack([flat.mode_states @ np.vstack([y.real, y.imag]) for y in amplitudes])


def write_designs(path: Path) -> None:
    """All cases' arrays and ids, computed by this process."""
    arrays: dict[str, Array] = {}
    for name, basis in CASES:
        made = compute_design(structures()[name], DesignOptions(basis=basis))
        arrays |= {f"{name} {basis} {key}": value for key, value in made.arrays.items()}
        arrays[f"{name} {basis} id"] = np.array(made.design_id)
    np.savez(path, **arrays)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def designs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Array]]:
    """By kernel of OpenBLAS that this processor has the instructions for: arrays and ids by case and name."""
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("the kernels of OpenBLAS are those of x86-64")
    folder = tmp_path_factory.mktemp("designs")
    found = {}
    for kernel in KERNELS:
        path = folder / f"{kernel}.npz"
        program = f"import pathlib, tests.controller.test_canonical as t; t.write_designs(pathlib.Path({str(path)!r}))"
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run([sys.executable, "-c", program], check=False, cwd=ROOT, env=environment)
        if done.returncode == -signal.SIGILL and kernel == KERNELS[-1]:
            continue
        done.check_returncode()
        with np.load(path) as archive:
            found[kernel] = {name: archive[name] for name in archive.files}
    return found


def case(designs: dict[str, dict[str, Array]], kernel: str, name: str, basis: str) -> dict[str, Array]:
    """The arrays of one case."""
    prefix = f"{name} {basis} "
    return {key.removeprefix(prefix): value for key, value in designs[kernel].items() if key.startswith(prefix)}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "basis"), CASES)
def test_every_linear_algebra_gives_one_design(designs: dict[str, dict[str, Array]], name: str, basis: str) -> None:
    """The same id, and arrays within 1e-9 of each one's largest entry."""
    first = case(designs, KERNELS[0], name, basis)
    for kernel in list(designs)[1:]:
        other = case(designs, kernel, name, basis)
        assert str(other.pop("id")) == str(first["id"])
        assert largest_difference(state_series(other), state_series(first)) < 1e-9, kernel
        for key, array in other.items():
            if not key.startswith("mode_"):
                assert largest_difference(array, first[key]) < 1e-9, (kernel, key)


@pytest.mark.slow
def test_kernels_do_round_differently(designs: dict[str, dict[str, Array]]) -> None:
    """Otherwise the test above shows nothing."""
    gains = [case(designs, kernel, "kiel", "clamped_free")["feedback_gain"] for kernel in designs]
    assert any(not np.array_equal(gains[0], gain) for gain in gains[1:])


@pytest.mark.slow
def test_feedforward_and_controller_of_different_machines_fit(designs: dict[str, dict[str, Array]]) -> None:
    """The motion of `tracking` with a reference of one kernel and a controller of another, within 1e-9."""
    made = compute_design(structures()["kiel"], DesignOptions())
    of_reference = ("flat_ratios", "mode_series", "mode_inputs", "mode_states", "static_inverse")
    mixed = {
        key: case(designs, KERNELS[0] if key in of_reference else list(designs)[-1], "kiel", "clamped_free")[key]
        for key in made.arrays
    }
    runs = [
        simulate(design, made.model(), steps=7500, targets=[(0.1, TARGET)])
        for design in (
            replace(made, arrays=case(designs, "Sandybridge", "kiel", "clamped_free")),
            replace(made, arrays=mixed),
        )
    ]
    for name in ("plant.y_pi", "plant.u", "controller.x_est"):
        assert largest_difference(runs[1][name], runs[0][name]) < 1e-9, name
