"""Margins, sensitivities and noise of the closed loop against python-control, direct responses and perturbed loops."""

from dataclasses import replace
from functools import cache

import control
import numpy as np
import pytest

from flexbeams.controller.analysis import loop_of
from flexbeams.controller.closed_loop import closed_loop_matrix, closed_loop_poles, sampled_plant
from flexbeams.controller.frequency import Complex, ModalForm, SchurForm, resolvent
from flexbeams.controller.loop import Loop
from flexbeams.controller.margins import Margins, loop_margins
from flexbeams.controller.structured_value import osborne_bounds, structured_bound
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import DesignError
from tests.helpers import design_of

pytestmark = pytest.mark.slow

SAMPLE = 2e-4
LOOPS: list[tuple[str, BasisName]] = [("kiel", "clamped_free"), ("kiel", "segment"), ("single_beam", "clamped_free")]


@cache
def loop(structure: str, basis: BasisName) -> Loop:
    return loop_of(design_of(structure), sampled_plant(design_of(structure).model(basis), SAMPLE))


@cache
def margins(structure: str, basis: BasisName) -> Margins:
    return loop_margins(loop(structure, basis))


def direct_response(here: Loop, omega: Array) -> tuple[Complex, Complex]:
    """S (k, n_u, n_u) and KS (k, n_u, n_pm) from P and K frequency by frequency."""
    P, K = here.plant, here.controller
    S, KS = [], []
    for z in np.exp(1j * omega * P.step):
        plant = P.H_pm @ np.linalg.solve(z * np.eye(len(P.A)) - P.A, P.B) + P.D_pm
        gain = K.C @ np.linalg.solve(z * np.eye(len(K.A)) - K.A, K.B)
        S.append(np.linalg.inv(np.eye(len(gain)) - gain @ plant))
        KS.append(S[-1] @ gain)
    return np.array(S), np.array(KS)


def with_factors(here: Loop, factors: Array) -> Array:
    """The loop's matrix with a factor on the voltage of each pair."""
    n, n_u = len(here.plant.A), here.plant.B.shape[1]
    matrix = closed_loop_matrix(here.controller, here.plant)
    changed = np.vstack([here.plant.B, here.controller.B @ here.plant.D_pm]) * (factors - np.ones(n_u))
    matrix[:, n:] += changed @ here.controller.C
    return matrix


@pytest.mark.parametrize(("structure", "basis"), LOOPS)
def test_sensitivities_against_a_direct_frequency_response(structure: str, basis: BasisName) -> None:
    omega = np.array([0.3, 5.0, 14.6, 23.4, 131.0, 850.0, 9e3])
    response = loop(structure, basis).sensitivity(omega)
    S, KS = direct_response(loop(structure, basis), omega)
    np.testing.assert_allclose(response.S, S, rtol=0, atol=1e-8)
    np.testing.assert_allclose(response.T, np.eye(S.shape[1]) - S, rtol=0, atol=1e-8)
    np.testing.assert_allclose(response.KS, KS, rtol=0, atol=1e-7 * np.abs(KS).max())


@pytest.mark.parametrize(("structure", "basis"), LOOPS)
def test_single_loops_against_python_control(structure: str, basis: BasisName) -> None:
    """Disk margins of each pair, the others closed."""
    here, n = loop(structure, basis), len(loop(structure, basis).plant.A)
    matrix, n_u = closed_loop_matrix(here.controller, here.plant), here.plant.B.shape[1]
    for k, channel in enumerate(margins(structure, basis).channels):
        b = np.concatenate([here.plant.B[:, k], here.controller.B @ here.plant.D_pm[:, k]])[:, None]
        c = np.concatenate([np.zeros(n), here.controller.C[k]])[None]
        opened = control.ss(matrix - b @ c, b, -c, 0, SAMPLE)
        omega = np.append(np.geomspace(1.0, 3e3, 200), channel.disk.frequency)
        alpha, _, _ = control.disk_margins(opened, np.sort(omega), skew=0.0)
        assert channel.disk.alpha == pytest.approx(float(alpha), abs=1e-3)
    assert len(margins(structure, basis).channels) == n_u


@pytest.mark.parametrize(("basis", "alpha"), [("clamped_free", 1.155), ("segment", 1.184)])
def test_all_pairs_at_once(basis: BasisName, alpha: float) -> None:
    """The value is reached: a perturbation of that size, found by ascent, puts a pole on the unit circle."""
    here, disk = loop("kiel", basis), margins("kiel", basis).disk
    assert disk.alpha == pytest.approx(alpha, abs=1e-3)
    S, _ = direct_response(here, np.array([disk.frequency]))
    M = S[0] - np.eye(4) / 2
    delta, reached = destabilising(M)
    assert disk.alpha * reached == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose(np.linalg.det(np.eye(4) - M @ np.diag(delta)), 0.0, atol=1e-6)
    omega = np.geomspace(5.0, 300.0, 60)
    lower = max(destabilising(S - np.eye(4) / 2, restarts=2)[1] for S in direct_response(here, omega)[0])
    assert lower <= 1 / disk.alpha * (1 + 1e-6)


def destabilising(M: Complex, restarts: int = 12) -> tuple[Complex, float]:
    """Delta, diagonal of equal magnitudes 1 / mu, with det(I - M Delta) = 0: largest spectral radius over phases."""
    random, best = np.random.default_rng(5), (np.zeros(len(M), dtype=np.complex128), 0.0)
    for _ in range(restarts):
        phases = random.uniform(0, 2 * np.pi, len(M))
        for _ in range(200):  # each phase turns so that the loop's gain adds up
            values, vectors = np.linalg.eig(M * np.exp(1j * phases))
            k = int(np.argmax(np.abs(values)))
            right = vectors[:, k]
            left = np.linalg.inv(vectors)[k].conj()
            turn = np.angle(right.conj() * left)
            phases = phases + np.angle(np.exp(1j * (turn - turn[0])))
        values = np.linalg.eigvals(M * np.exp(1j * phases))
        top = values[np.argmax(np.abs(values))]
        if abs(top) > best[1]:
            best = (np.exp(1j * phases) / top, float(abs(top)))
    return best


@pytest.mark.parametrize(("structure", "basis"), LOOPS)
def test_gain_margins_are_where_stability_ends(structure: str, basis: BasisName) -> None:
    here = loop(structure, basis)
    for k, channel in enumerate(margins(structure, basis).channels):
        assert channel.gain_reduction == 0.0
        for factor, stable in (
            (0.99 * channel.gain_increase, True),
            (1.01 * channel.gain_increase, False),
            (0.1, True),
        ):
            factors = np.ones(here.plant.B.shape[1])
            factors[k] = factor
            assert (np.abs(np.linalg.eigvals(with_factors(here, factors))).max() < 1) == stable


def test_delay_and_phase_margins_of_one_pair() -> None:
    """103 ms: in samples of 0.2 ms, as many are stable and one more is not; the phase at the same crossover."""
    here, channel = loop("single_beam", "clamped_free"), margins("single_beam", "clamped_free").channels[0]
    samples = channel.delay / SAMPLE
    assert 400 < samples < 600
    for extra, stable in ((int(samples), True), (int(samples) + 1, False)):
        assert (closed_loop_poles(here.controller, here.plant, extra)[0].real < 0) == stable
    found = control.margin(
        control.frd(1 / here.sensitivity(np.geomspace(1, 100, 4000)).S[:, 0, 0] - 1, np.geomspace(1, 100, 4000))
    )
    assert channel.phase == pytest.approx(abs(found[1]), abs=0.05)


@pytest.mark.parametrize(("structure", "basis"), LOOPS[::2])
def test_noise_gain_is_the_integral_of_the_response(structure: str, basis: BasisName) -> None:
    """Parseval: the variance is the mean of |KS|^2 over all frequencies up to Nyquist."""
    here = loop(structure, basis)
    omega = np.unique(np.concatenate([np.linspace(1e-3, np.pi / SAMPLE, 1500), np.geomspace(1e-3, 3e3, 6000)]))
    power = np.sum(np.abs(here.sensitivity(omega).KS) ** 2, axis=2)
    expected = np.sqrt(np.trapezoid(power, omega, axis=0) * SAMPLE / np.pi)
    np.testing.assert_allclose(here.noise_gain(), expected, rtol=2e-3)
    if structure == "kiel":
        assert here.noise_gain().max() == pytest.approx(0.04e6, rel=0.02)


def test_margins_of_an_unstable_loop_are_refused() -> None:
    here = loop("single_beam", "clamped_free")
    strong = Loop(replace(here.controller, C=8 * here.controller.C), here.plant)
    with pytest.raises(DesignError, match="margins need a stable loop, got a pole at"):
        loop_margins(strong)


def test_structured_value_of_known_matrices() -> None:
    """Rank one: the sum of |a_i b_i|; triangular: the largest entry of the diagonal; three scalars: what is reached."""
    random = np.random.default_rng(2)
    for n in (1, 2, 3, 5):
        a, b = random.normal(size=(2, n)) + 1j * random.normal(size=(2, n))
        M = np.outer(a, b)
        value = structured_bound(M, osborne_bounds(M[None])[1][0], 1e-7)
        assert value == pytest.approx(np.sum(np.abs(a * b)), rel=1e-5)
    M = random.normal(size=(3, 3)) + 1j * random.normal(size=(3, 3))
    bound, logs = osborne_bounds(M[None])
    value = structured_bound(M, logs[0], 1e-7)
    assert value <= bound[0]
    assert destabilising(M)[1] == pytest.approx(value, rel=1e-3)
    assert structured_bound(np.triu(M), np.zeros(3), 1e-6) == pytest.approx(np.abs(np.diag(M)).max(), rel=1e-5)
    for n in (4, 17, 53):  # a unitary matrix with another scaling: 1 is its spectral radius and its scaled norm
        unitary = np.linalg.qr(random.normal(size=(n, n)) + 1j * random.normal(size=(n, n)))[0]
        logs = random.normal(size=n)
        scaled = np.exp(logs[:, None] - logs) * unitary
        assert structured_bound(scaled, np.zeros(n)) == pytest.approx(1.0, rel=1e-6)
    assert structured_bound(np.zeros((3, 3), dtype=np.complex128), np.zeros(3)) == 0.0


def test_forms_of_a_frequency_response() -> None:
    """The modal form beside the Schur form; a matrix without a basis of eigenvectors takes the latter."""
    random = np.random.default_rng(4)
    A, B, C = random.normal(size=(9, 9)), random.normal(size=(9, 4)), random.normal(size=(3, 9))
    points = np.array([0.3j, 2.0 + 1j, -40.0])
    modal, triangular = resolvent(A, B, C), SchurForm.of(A, B, C)
    assert isinstance(modal, ModalForm)
    np.testing.assert_allclose(modal.at(points), triangular.at(points), rtol=1e-11)
    np.testing.assert_allclose(np.poly(modal.poles), np.poly(triangular.poles), atol=1e-10)
    expected = [C[1:2] @ np.linalg.solve(s * np.eye(9) - A, B[:, 2:]) for s in points]
    for form in (modal, triangular):
        np.testing.assert_allclose(form.part(slice(1, 2), slice(2, None)).at(points), expected, rtol=1e-11)
    chain = resolvent(np.eye(9, k=1) - np.eye(9), B, C)
    assert isinstance(chain, SchurForm)
    expected = [C @ np.linalg.solve((s + 1) * np.eye(9) - np.eye(9, k=1), B) for s in points]
    np.testing.assert_allclose(chain.at(points), expected, rtol=1e-11)


def test_a_grid_may_miss_modes_that_the_controller_hardly_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a fine basis: as good margins on a third of the points."""
    here = loop("kiel", "segment")
    coarse = here.frequencies()
    monkeypatch.setattr("flexbeams.controller.loop._SEEN", 0.0)
    assert len(coarse) < 0.7 * len(here.frequencies())
    every = loop_margins(here)
    assert margins("kiel", "segment").disk.alpha == pytest.approx(every.disk.alpha, rel=1e-6)
    for found, expected in zip(margins("kiel", "segment").channels, every.channels, strict=True):
        assert found.disk.alpha == pytest.approx(expected.disk.alpha, rel=1e-6)
        assert (found.gain_increase, found.phase) == pytest.approx((expected.gain_increase, expected.phase), rel=1e-6)


def test_noise_gain_without_a_modal_form() -> None:
    """By the Lyapunov equation of the Schur form: the same."""
    here = loop("single_beam", "clamped_free")
    other = loop_of(design_of("single_beam"), here.plant)
    other.__dict__["_resolvent"] = SchurForm.of(
        closed_loop_matrix(here.controller, here.plant), np.hstack(here._inputs), here._output
    )
    np.testing.assert_allclose(here.noise_gain(), other.noise_gain(), rtol=1e-9)
