"""Frames of the animation: how many, and that they hold the shapes that the run had."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from flexbeams.plant.galerkin import STATIONS
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.frames import MAX_FRAMES, MAX_RATE, frame_interval

pytestmark = pytest.mark.native


@pytest.fixture(scope="module")
def tracking(run_folder) -> Run:
    return run_scenario("tracking", Settings(build_folder=run_folder / "build/fmus", stop_time=2.5))


def at_points(run: Run, shapes: np.ndarray) -> np.ndarray:
    """Deflections of shapes (frames, r * STATIONS) at the points of interest, by splines clamped at 0."""
    structure = run.design.structure
    found = []
    for point in structure.point_of_interest:
        part = shapes[:, (point.beam - 1) * STATIONS : point.beam * STATIONS]
        places = np.linspace(0, structure.beam[point.beam - 1].length, STATIONS)
        found.append(CubicSpline(places, part, axis=1, bc_type=("clamped", "natural"))(point.position))
    return np.array(found).T


def recorded(run: Run, name: str, rows: slice) -> np.ndarray:
    places = [k for k, c in enumerate(run.recording.columns) if c.startswith(f"{name}[")]
    return run.recording.values[rows][:, places]


@pytest.mark.parametrize(("steps", "step"), [(30_000, 2e-4), (30_001, 2e-4), (10_000_000, 2e-4), (7, 2e-4), (50, 0.1)])
def test_frames_are_bounded_in_number_and_rate(steps, step):
    every = frame_interval(steps, step)
    assert steps // every + 1 <= MAX_FRAMES
    assert 1 / (every * step) <= MAX_RATE * (1 + 1e-9)


def test_six_seconds_have_fifty_frames_each():
    assert frame_interval(30_000, 2e-4) == 100


def test_frames_hold_the_plants_shapes(tracking):
    frames = tracking.recording.frames
    assert frames is not None
    y_pi = recorded(tracking, "plant.y_pi", slice(None, None, frames.every))
    assert frames.deflections.shape == (126, 3 * STATIONS)
    np.testing.assert_allclose(at_points(tracking, frames.deflections), y_pi, atol=2e-4 * np.abs(y_pi).max())


def test_frames_hold_the_plants_voltages(tracking):
    frames = tracking.recording.frames
    np.testing.assert_array_equal(frames.voltages, recorded(tracking, "plant.u", slice(None, None, frames.every)))


def test_ghost_is_the_reference_shape(tracking):
    frames, arrays = tracking.recording.frames, tracking.design.arrays
    x_ref, u_ff = frames.reference
    ghost = x_ref @ arrays["H_w"].T + u_ff @ arrays["D_w"].T
    y_ref = recorded(tracking, "feedforward.y_ref", slice(None, None, frames.every))
    np.testing.assert_allclose(at_points(tracking, ghost), y_ref, atol=2e-4 * np.abs(y_ref).max())


def test_shape_at_rest_is_that_of_the_full_model(tracking):
    arrays, model = tracking.design.arrays, tracking.design.model()
    system = model.assemble()
    at_rest = arrays["D_w"] - arrays["H_w"] @ np.linalg.solve(arrays["A"], arrays["B"])
    full = model.stations.reshape(-1, model.size) @ np.linalg.solve(system.K, system.L)
    np.testing.assert_allclose(at_rest, full, atol=1e-9 * np.abs(full).max())


def test_both_kernels_give_the_same_frames(tracking, run_folder):
    settings = Settings(build_folder=run_folder / "build/fmus", stop_time=2.0, backend="python")
    frames = run_scenario("tracking", settings).recording.frames
    native = tracking.recording.frames
    count = len(frames.values)
    np.testing.assert_allclose(frames.deflections, native.deflections[:count], atol=1e-9)
    np.testing.assert_allclose(frames.voltages, native.voltages[:count], atol=1e-4)


def test_no_frames_where_none_are_wanted(run_folder):
    settings = Settings(build_folder=run_folder / "build/fmus", stop_time=2.0, record_animation=False)
    assert run_scenario("tracking", settings).recording.frames is None


def test_a_plant_alone_has_frames_without_reference(run_folder):
    run = run_scenario("step_response", Settings(build_folder=run_folder / "build/fmus", stop_time=1.2))
    x_ref, u_ff = run.recording.frames.reference
    assert x_ref.shape[1] == u_ff.shape[1] == 0
    assert run.recording.frames.voltages[-1].tolist() == [817.0, -770.0, -807.0, 781.0]
