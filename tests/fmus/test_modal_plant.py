"""BeamPlant where its modal form matters: near critical damping, and for states from another machine."""

import struct
import zlib
from functools import cache

import numpy as np
import pytest

from flexbeams.plant.energy import energy_form
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.modal_form import modal_form
from tests.fmus.test_plant_unit import Motion
from tests.helpers import BuiltUnits, design_of
from tests.native.workshop import native_folder, needs_zig
from tests.units.loaded import Loaded, Real, loaded


def damped(factor: float) -> dict[str, float]:
    """The structural damping of all beams and patches of `kiel`, multiplied."""
    values = design_of().structure.parameters()
    return {name: factor * value for name, value in values.items() if name.endswith("structural_damping")}


def condition(factor: float) -> float:
    system = beam_model(design_of().structure, "clamped_free", 10).assemble(damped(factor))
    form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
    return modal_form(form.A).condition


@cache
def critical_factor() -> float:
    """Damping at which the first pair of eigenvalues meets, to the last digits: its condition passes any bound."""
    low, high = 24.0, 25.5  # complex, real
    for _ in range(60):
        middle = (low + high) / 2
        system = beam_model(design_of().structure, "clamped_free", 10).assemble(damped(middle))
        form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
        low, high = (middle, high) if np.all(np.linalg.eigvals(form.A).imag != 0.0) else (low, middle)
    return low


def run(unit: Loaded, factor: float, steps: tuple[float, ...]) -> Real:
    unit.begin(**damped(factor))
    rows = []
    for k, step in enumerate(steps):
        unit.advance(step, u=[300.0, -100.0 * (k % 3), 50.0, 0.0], force=[0.0, 0.02 * (k % 2), 0.0])
        rows.append(unit.take("y_pi", "y_pm", "w", "energy"))
    return np.array(rows)


STEPS = (2e-4, 1e-3, 3e-3, 2e-4, 0.05) * 12


def exact(factor: float) -> Real:
    model = beam_model(design_of().structure, "clamped_free", 10)
    motion = Motion(model, parameters=damped(factor))
    rows = []
    for k, step in enumerate(STEPS):
        motion.advance(step, np.array([300.0, -100.0 * (k % 3), 50.0, 0.0, 0.0, 0.02 * (k % 2), 0.0]))
        rows.append(motion.values())
    return np.array(rows)


@pytest.mark.parametrize("distance", [0.0, 1e-6, 1e-3, 0.5])
def test_motion_near_critical_damping(units: BuiltUnits, distance: float) -> None:
    """By the matrix exponential within about 1e-4 of the damping at which eigenvectors coincide."""
    factor = critical_factor() * (1 + distance)
    assert (condition(factor) > 100) == (distance < 1e-4)
    with loaded(units("BeamPlant")) as unit:
        found = run(unit, factor, STEPS)
    wanted = exact(factor)
    scale = np.abs(wanted).max(axis=0)
    assert np.all(np.abs(found - wanted).max(axis=0) <= 1e-9 * np.maximum(scale, 1e-6 * scale.max()))


@needs_zig
def test_a_state_with_other_coordinates_continues_from_the_energy_coordinates() -> None:
    """As another machine may have found them: turned, or in another order."""
    with loaded(native_folder("BeamPlant")) as one, loaded(native_folder("BeamPlant")) as other:
        one.begin().advance(0.01, u=300.0)
        other.begin()
        saved = one.saved()
        slots, states = 64, 60
        end = len(saved)
        place = end - 8 * (slots + states)
        z = np.frombuffer(saved[place : end - 8 * states])
        for changed in (z[::-1], 1.001 * z, np.where(np.arange(slots) % 8 < 4, z, -z)):
            content = bytearray(saved)
            content[place : end - 8 * states] = changed.tobytes()
            content[12:16] = struct.pack("<I", zlib.crc32(bytes(content[16:])))
            one.restore(saved)
            other.restore(bytes(content))
            for _ in range(5):
                one.advance(1e-3)
                other.advance(1e-3)
                for name in ("y_pi", "y_pm", "w", "energy"):
                    expected, found = one.take(name), other.take(name)
                    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
