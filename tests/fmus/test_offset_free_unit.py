"""TrackingController with the offset-free observer, against its equations written down here, on both backends."""

import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.tracking_controller import TRACKING_CONTROLLER
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import extracted_once, made_once
from tests.native.workshop import needs_zig
from tests.units.loaded import Real, loaded

SAMPLE = 2e-4
# A rate 4 times the usual one, so that offsets are large within a short test
OPTIONS = DesignOptions(observer="offset_free", integral_gain=2e-4, weights=Weights(offset_time_constant=0.05))


@cache
def design() -> Design:
    def make(folder: Path) -> None:
        structure = read_structure(find_structure("kiel"))
        (folder / "design.pickle").write_bytes(pickle.dumps(compute_design(structure, OPTIONS)))

    made = pickle.loads((made_once("designs/offset-free", make) / "design.pickle").read_bytes())
    assert isinstance(made, Design)
    return made


@cache
def unit_folder(backend: str) -> Path:
    """The extracted unit."""

    def make(folder: Path) -> None:
        build_units((TRACKING_CONTROLLER,), design(), design().model(), folder, backend=backend)  # type: ignore[arg-type]

    file = next(made_once(f"offset-free-{backend}", make).rglob("TrackingController.fmu"))
    return extracted_once(file)


backends = pytest.mark.parametrize("backend", [pytest.param("native", marks=needs_zig), "python"])


def signals(steps: int) -> tuple[Real, Real, Real]:
    """Strains, feedforward voltages and reference states, unlike from one step to the next."""
    rng = np.random.default_rng(4)
    return rng.normal(0, 3e-5, (steps, 6)), rng.normal(0, 300, (steps, 4)), rng.normal(0, 3e-3, (steps, 30))


def recursion(steps: int, limit: float, off: range) -> Real:
    """u, y_est, x_est, d after each tick; without feedback in the ticks `off`."""
    a: dict[str, Any] = design().arrays
    A, B, H, D, L, K = (a[k] for k in ("A_d", "B_d", "H_pm", "D_pm", "estimator_gain", "feedback_gain"))
    G, W, rate = a["static_inverse"], a["offset_map"], a["offset_gain"]
    y_pm, u_ff, x_ref = signals(steps)
    x, d, z, u = x_ref[0], np.zeros(6), np.zeros(4), np.clip(u_ff[0], -limit, limit)
    rows = []
    for k in range(steps):
        e = y_pm[k] - H @ x - D @ u - d
        x, d, before = A @ x + B @ u + L @ e, d + rate * e, u
        if k in off:
            d, z, u = np.zeros(6), np.zeros(4), np.clip(u_ff[k], -limit, limit)
        else:
            du = -G @ W @ d
            state = np.linalg.inv(np.eye(30) - A) @ B @ du
            commanded = u_ff[k] + du + K @ (x_ref[k] + state - x) + z
            growth = 2e-4 * G @ (a["H_pi"] @ (x_ref[k] - x) + a["D_pi"] @ (u_ff[k] - before) - W @ d)
            z = z + np.where((np.abs(commanded) > limit) & (commanded * growth > 0), 0.0, growth)
            u = np.clip(commanded, -limit, limit)
        rows.append(np.concatenate([u, a["H_pi"] @ x + a["D_pi"] @ u + W @ d, x, d]))
    return np.array(rows)


@backends
@pytest.mark.parametrize("limit", [1000.0, 400.0])
def test_runs_the_equations(backend: str, limit: float) -> None:
    """Also at the limit and through a time without feedback; each signal to 1e-11 of its largest magnitude."""
    steps, off = 200, range(80, 110)
    expected = recursion(steps, limit, off)
    y_pm, u_ff, x_ref = signals(steps)
    found = []
    with loaded(unit_folder(backend)) as unit:
        unit.begin(u_ff=u_ff[0], x_ref=x_ref[0], voltage_limit=limit)
        np.testing.assert_array_equal(unit.take("offset"), np.zeros(6))
        for k in range(steps):
            unit.put("feedback", k not in off)
            unit.advance(SAMPLE, y_pm=y_pm[k], u_ff=u_ff[k], x_ref=x_ref[k])
            found.append(unit.take("u", "y_est", "x_est", "offset"))
    for part in (slice(0, 4), slice(4, 8), slice(8, 38), slice(38, 44)):
        largest = np.abs(expected[:, part]).max()
        np.testing.assert_allclose(np.array(found)[:, part], expected[:, part], rtol=0, atol=1e-11 * largest)
    assert np.abs(expected[:, 38:]).max() > 1e-6


@pytest.mark.native
@needs_zig
def test_native_and_python_unit_agree() -> None:
    """Every variable after each of 1000 steps, to 1e-12 of its largest value; voltages reach their limit."""
    y_pm, u_ff, x_ref = signals(40)
    records = []
    for backend in ("native", "python"):
        with loaded(unit_folder(backend)) as unit:
            unit.begin(u_ff=u_ff[0], x_ref=x_ref[0], voltage_limit=400.0)
            rows = []
            for k in range(1000):
                if k % 25 == 0:
                    unit.put("y_pm", y_pm[k // 25])
                    unit.put("u_ff", u_ff[k // 25])
                    unit.put("x_ref", x_ref[k // 25])
                unit.advance(SAMPLE)
                rows.append(unit.everything())
        records.append(np.array(rows))
    largest = np.max(np.abs(records[1]), axis=0)
    deviation = np.max(np.abs(records[0] - records[1]), axis=0) / np.where(largest > 0, largest, 1.0)
    assert deviation.max() < 1e-12


@backends
def test_a_saved_state_has_the_offsets(backend: str) -> None:
    y_pm, u_ff, x_ref = signals(60)
    with loaded(unit_folder(backend)) as unit:
        unit.begin(u_ff=u_ff[0], x_ref=x_ref[0])
        for k in range(30):
            unit.advance(SAMPLE, y_pm=y_pm[k], u_ff=u_ff[k], x_ref=x_ref[k])
        state = unit.saved()
        ends = []
        for _ in range(2):
            unit.restore(state)
            for k in range(30, 60):
                unit.advance(SAMPLE, y_pm=y_pm[k], u_ff=u_ff[k], x_ref=x_ref[k])
            ends.append(unit.everything())
        np.testing.assert_array_equal(ends[0], ends[1])
        unit.call("reset")
        unit.begin(u_ff=u_ff[0], x_ref=x_ref[0])
        np.testing.assert_array_equal(unit.take("offset"), np.zeros(6))


def test_the_unit_declares_its_offsets_as_local_variables() -> None:
    with loaded(unit_folder("python")) as unit:
        offsets = [v for n, v in unit.variables.items() if n.startswith("offset[")]
        assert [v.causality for v in offsets] == ["local"] * 6
        assert float(unit.variables["integral_gain"].max) == pytest.approx(design().integral_gain_limit)
