"""Second-order balanced truncation against pyMOR, and what the reduced model keeps."""

import re
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import control
import numpy as np
import pytest
from pymor.core.logger import set_log_levels
from pymor.models.iosys import LTIModel
from scipy.linalg import block_diag, cholesky, solve_triangular, svd

from flexbeams.controller.choices import OutputWeight
from flexbeams.controller.design import compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ENERGY_MODES, ReducedModel, reduce
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import energy_form
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.structure import Spring, Structure, find_structure, read_structure
from tests.oracles.accuracy import response
from tests.oracles.examples import beam, five_beams, gauge, patch, point, single_beam, three_beams

KIEL = read_structure(find_structure("kiel"))
STRUCTURES = {"kiel": KIEL, "single": single_beam(), "three": three_beams(), "five": five_beams()}
WEIGHTS: list[OutputWeight] = ["identity", "energy"]


class Balanced(NamedTuple):
    """An independent reduction, in energy coordinates."""

    position: Array  # singular values
    velocity: Array
    A: Array
    B: Array
    H_pi: Array
    H_pm: Array


@cache
def model_of(
    name: str, basis: BasisName = "clamped_free", order: int | None = None
) -> tuple[BeamModel, SecondOrderSystem]:
    """A structure's model and its matrices."""
    model = beam_model(STRUCTURES[name], basis, order)
    return model, model.assemble()


def reduction(name: str, kept: int, output_weight: OutputWeight, *, static_correction: bool = True) -> ReducedModel:
    """The reduction of a structure on its default basis."""
    return reduce(
        *model_of(name), position_states=kept, output_weight=output_weight, static_correction=static_correction
    )


def balance(model: BeamModel, system: SecondOrderSystem, kept: int, output_weight: OutputWeight) -> Balanced:
    """(22)-(30) with pyMOR's Gramians: the state is (R_K' q, R_M' q'), and y = (q, q') where H = I."""
    set_log_levels({"pymor": "ERROR"})
    n = model.size
    form = energy_form(system.M, system.D, system.K, system.L)
    velocity = solve_triangular(cholesky(system.M, lower=True), np.eye(n), lower=True).T
    C = block_diag(form.position, velocity) if output_weight == "identity" else np.eye(2 * n)
    lti = LTIModel.from_matrices(form.A, form.B, C)
    R_c, R_o = (lti.gramian(kind).to_numpy() for kind in ("c_lr", "o_lr"))
    right, left, values = [], [], []
    for part in (slice(0, n), slice(n, 2 * n)):
        U, sigma, Vt = svd(R_o[part].T @ R_c[part])
        root = np.sqrt(sigma[:kept])
        right.append(R_c[part] @ Vt[:kept].T / root)
        left.append((R_o[part] @ U[:, :kept] / root).T)
        values.append(sigma)
    T, inverse = block_diag(*right), block_diag(*left)
    position, velocity = values
    return Balanced(
        position,
        velocity,
        inverse @ form.A @ T,
        inverse @ form.B,
        form.outputs(model.deflection) @ T,
        form.outputs(model.strain) @ T,
    )


@pytest.mark.parametrize(
    ("name", "output_weight"),
    [
        ("kiel", "identity"),
        ("kiel", "energy"),
        ("three", "identity"),
        ("three", "energy"),
        ("single", "energy"),
        ("five", "identity"),
    ],
)
def test_singular_values_against_pymor(name: str, output_weight: OutputWeight) -> None:
    found = reduction(name, 2, output_weight)
    expected = balance(*model_of(name), 2, output_weight)
    for values, exact in ((found.hankel_position, expected.position), (found.hankel_velocity, expected.velocity)):
        np.testing.assert_allclose(values, exact[: len(values)], rtol=0, atol=1e-8 * exact[0])
        assert len(values) == model_of(name)[0].size


@pytest.mark.parametrize("output_weight", WEIGHTS)
@pytest.mark.parametrize(("name", "kept"), [("kiel", 15), ("three", 15), ("single", 4)])
def test_transfer_function_against_pymor(name: str, kept: int, output_weight: OutputWeight) -> None:
    """The reduced model, whatever the signs of its states, from 0 to 3000 rad/s."""
    found = reduction(name, kept, output_weight, static_correction=False)
    expected = balance(*model_of(name), kept, output_weight)
    frequencies = np.array([0.0, 3.0, 14.0, 40.0, 130.0, 900.0, 3000.0])
    n_u = found.B.shape[1]
    for H, H_exact in ((found.H_pi, expected.H_pi), (found.H_pm, expected.H_pm)):
        reference = control.ss(expected.A, expected.B, H_exact, np.zeros((len(H), n_u)))
        exact = np.moveaxis(reference(1j * frequencies, squeeze=False), -1, 0)
        mine = np.stack([H @ np.linalg.solve(1j * w * np.eye(2 * kept) - found.A, found.B) for w in frequencies])
        assert mine.shape == exact.shape
        scale = np.abs(exact).max(axis=(1, 2), keepdims=True)
        assert np.all(np.abs(mine - exact) <= 1e-7 * scale)


@pytest.mark.parametrize("output_weight", WEIGHTS)
def test_nothing_is_lost_where_all_states_are_kept(output_weight: OutputWeight) -> None:
    """Spectrum and responses are then the plant's."""
    model, system = model_of("single", "clamped_free", 4)
    found = reduce(model, system, position_states=4, output_weight=output_weight)
    form = energy_form(system.M, system.D, system.K, system.L)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(found.A)), np.sort_complex(np.linalg.eigvals(form.A)), rtol=1e-8
    )
    assert found.hankel_share == 1.0
    assert np.max(np.abs(found.D_pi)) < 1e-9 * np.max(np.abs(found.static_gain()[0]))
    for s in (0.0, 5j, 30 + 200j, 3000j):
        inner = np.linalg.solve(s * np.eye(8) - found.A, found.B)
        for H, exact in zip((found.H_pi, found.H_pm), response(model, s), strict=True):
            np.testing.assert_allclose(H @ inner, exact[:, :1], rtol=0, atol=1e-8 * np.abs(exact[:, :1]).max())


@pytest.mark.parametrize("output_weight", WEIGHTS)
@pytest.mark.parametrize(("name", "kept"), [("kiel", 15), ("kiel", 9), ("single", 5), ("three", 15), ("five", 25)])
def test_reduced_model_is_stable_and_right_at_rest(name: str, kept: int, output_weight: OutputWeight) -> None:
    found = reduction(name, kept, output_weight)
    assert np.max(np.linalg.eigvals(found.A).real) < 0
    assert found.A.shape == (2 * kept, 2 * kept)
    assert found.position_states == kept
    assert found.residual < 1e-9
    model, system = model_of(name)
    exact = [
        rows @ np.linalg.solve(system.K, system.L)
        for rows in (model.deflection, model.strain, model.stations.reshape(-1, model.size))
    ]
    rest = -np.linalg.solve(found.A, found.B)
    for H, D, gain in zip((found.H_pi, found.H_pm, found.H_w), (found.D_pi, found.D_pm, found.D_w), exact, strict=True):
        np.testing.assert_allclose(H @ rest + D, gain, rtol=0, atol=1e-10 * np.abs(gain).max())


def test_static_correction_is_what_the_reduction_misses() -> None:
    """Off, the direct terms are zero, and at rest strains are off by more than half, a deflection by a tenth."""
    plain, corrected = (reduction("kiel", 15, "identity", static_correction=on) for on in (False, True))
    for D in (plain.D_pi, plain.D_pm, plain.D_w):
        np.testing.assert_array_equal(D, 0.0)
    np.testing.assert_array_equal(plain.A, corrected.A)
    exact = static_gains(*model_of("kiel"))
    missed = [np.max(np.abs(D) / np.abs(gain)) for D, gain in zip((corrected.D_pi, corrected.D_pm), exact, strict=True)]
    assert missed[0] > 0.1
    assert missed[1] > 0.5


def test_share_counts_both_kinds_of_singular_values() -> None:
    found = reduction("kiel", 15, "identity")
    parts = found.hankel_position, found.hankel_velocity
    assert found.hankel_share == pytest.approx(
        sum(p[:15].sum() for p in parts) / sum(p.sum() for p in parts), rel=1e-14
    )
    assert all(np.all(np.diff(p) <= 0) for p in parts)


def test_energy_norm_does_not_depend_on_coordinates() -> None:
    """q = S p with any S: energy keeps singular values and responses, identity does not."""
    model, system = model_of("three")
    S = np.random.default_rng(5).normal(size=(model.size, model.size)) + 4 * np.eye(model.size)
    turned = SecondOrderSystem(
        M=S.T @ system.M @ S, D=S.T @ system.D @ S, K=S.T @ system.K @ S, L=S.T @ system.L, F=S.T @ system.F
    )
    moved = replace(model, deflection=model.deflection @ S, strain=model.strain @ S, stations=model.stations @ S)
    here, there = (
        reduce(m, s, position_states=15, output_weight="energy") for m, s in ((model, system), (moved, turned))
    )
    np.testing.assert_allclose(there.hankel_position, here.hankel_position, rtol=0, atol=1e-8 * here.hankel_position[0])
    np.testing.assert_allclose(there.hankel_velocity, here.hankel_velocity, rtol=0, atol=1e-8 * here.hankel_velocity[0])
    gains = [r.H_pi @ np.linalg.solve(20j * np.eye(30) - r.A, r.B) for r in (here, there)]
    np.testing.assert_allclose(gains[1], gains[0], rtol=0, atol=1e-6 * np.abs(gains[0]).max())
    here, there = (
        reduce(m, s, position_states=15, output_weight="identity") for m, s in ((model, system), (moved, turned))
    )
    assert abs(there.hankel_position[0] / here.hankel_position[0] - 1) > 0.1


def test_energy_norm_agrees_between_bases() -> None:
    """Refined, both bases tend to the same singular values; those above a fifth of the largest are met within 6 %."""
    fine, coarse = (
        reduce(*model_of("kiel", basis, order), position_states=15, output_weight="energy")
        for basis, order in (("segment", 7), ("clamped_free", 25))
    )
    for kind in ("hankel_position", "hankel_velocity"):
        exact, values = getattr(fine, kind), getattr(coarse, kind)
        assert len(exact) == ENERGY_MODES
        large = exact > exact[0] / 5
        np.testing.assert_allclose(values[large], exact[large], rtol=0.06)


def half_damped() -> Structure:
    """An undamped beam with a damping patch pair, coupled to a heavy, hardly damped one."""
    beams = [
        beam(1, length=0.4, tip_mass=0.0, viscous_damping=0.0, structural_damping=0.0),
        beam(2, length=0.4, tip_mass=0.2, viscous_damping=1e-3, structural_damping=1e-2),
    ]
    return Structure(
        beam=beams,
        patch=[patch(1, 1, 0.1, length=0.1, structural_damping=0.3)],
        spring=[Spring(between=(1, 2), stiffness=100.0)],
        point_of_interest=[point(1, 0.3), point(2, 0.3)],
        strain_gauge=[gauge(1, 0.05), gauge(2, 0.05)],
    )


@pytest.mark.parametrize("output_weight", WEIGHTS)
def test_an_unstable_reduction_is_refused_with_its_eigenvalue(output_weight: OutputWeight) -> None:
    """The plant is stable and M, D, K are positive definite, which is not enough: damping is not uniform."""
    model = beam_model(half_damped(), "clamped_free", 7)
    system = model.assemble()
    assert np.max(np.linalg.eigvals(energy_form(system.M, system.D, system.K, system.L).A).real) < 0
    with pytest.raises(DesignError, match="the reduced model with 6 position states is not stable") as refusal:
        reduce(model, system, position_states=6, output_weight=output_weight)
    named = re.search(r"eigenvalue ([\d.]+)([+-][\d.]+)j 1/s; change reduced_modes, output_weight", str(refusal.value))
    assert named
    values = np.linalg.eigvals(balance(model, system, 6, output_weight).A)
    worst = values[np.argmax(values.real)]
    assert [float(named[1]), abs(float(named[2]))] == pytest.approx([worst.real, abs(worst.imag)], rel=1e-4)


def test_a_design_of_such_a_structure_is_refused() -> None:
    with pytest.raises(DesignError, match="is not stable: eigenvalue"):
        compute_design(half_damped(), DesignOptions(order=7, reduced_modes=3))


@pytest.mark.parametrize("kept", [0, 31, -1])
def test_more_states_than_there_are_are_refused(kept: int) -> None:
    with pytest.raises(DesignError, match=rf"reduced_modes must be 1 to 10, modes of each beam .*, got {kept / 3:g}$"):
        reduction("kiel", kept, "identity")


def test_states_that_cannot_be_reached_are_refused() -> None:
    """A second beam that no patch moves and no spring couples."""
    structure = replace(half_damped(), spring=[])
    model = beam_model(structure, "clamped_free", 5)
    system = model.assemble({"beam[1].viscous_damping": 0.03})
    with pytest.raises(DesignError, match=r"state 6, whose Hankel singular value .* vanishes beside the first"):
        reduce(model, system, position_states=6, output_weight="energy")
