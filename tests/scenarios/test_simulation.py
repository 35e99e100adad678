"""Simulations that the caller steps: the same results as a run, own inputs, snapshots, new parameters."""

import multiprocessing
import signal
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.runs.simulation import Simulation
from tests.helpers import PUSHED_SCENARIO, Write
from tests.native.workshop import needs_zig

STOP = 0.2  # s


@pytest.fixture
def scenario(write_scenario: Write) -> str:
    return str(write_scenario("pushed", PUSHED_SCENARIO.format(stop=STOP)))


@pytest.fixture(params=[pytest.param("native", marks=needs_zig), "python"])
def sim(request: pytest.FixtureRequest, scenario: str) -> Iterator[Simulation]:
    with fb.simulation(scenario, backend=request.param) as simulation:
        yield simulation


def recorded(scenario: str, **settings: Any) -> Any:
    return run_scenario(scenario, Settings(record_animation=False, **settings)).recording


def law(strain: Any) -> Any:
    return -2e4 * strain[:1]


@pytest.mark.native
@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
def test_steps_add_up_to_the_run(scenario: str, coupling: Any) -> None:
    """In steps of any number, across blocks, with frames: the rows and the times of a run, bit for bit."""
    expected = recorded(scenario, coupling=coupling, decimate=7)
    with fb.simulation(scenario, coupling=coupling, decimate=7) as sim:
        for count in (1, 3, 600, 0, 17):
            sim.step(count)
        sim.step(until=STOP)
        assert (sim.time, sim.steps) == (STOP, 1000)
        found = sim.result().recording
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_array_equal(found.time, expected.time)
    assert found.columns == expected.columns


def test_results_of_both_kernels_at_any_time(sim: Simulation, scenario: str) -> None:
    expected = recorded(scenario, backend=sim.prepared.settings.backend)
    sim.step(400)
    first = sim.result().recording
    np.testing.assert_array_equal(first.values, expected.values[:401])
    sim.step(600)
    np.testing.assert_array_equal(sim.result().recording.values, expected.values)
    np.testing.assert_array_equal(first.values, expected.values[:401])


def test_snapshot_restores_the_course(sim: Simulation, scenario: str) -> None:
    """The rows of the past stay, those of the other future go; the bytes serve a new simulation."""
    expected = recorded(scenario, backend=sim.prepared.settings.backend).values
    sim.step(300)
    state = sim.snapshot()
    sim["controller.voltage_limit"] = 1.0
    sim.step(200)
    assert not np.array_equal(sim.result().recording.values, expected[:501])
    sim.restore(state)
    assert sim["controller.voltage_limit"] == 1000.0
    sim.step(until=STOP)
    np.testing.assert_array_equal(sim.result().recording.values, expected)
    with fb.simulation(scenario, backend=sim.prepared.settings.backend) as other:
        other.restore(bytes(state))
        other.step(until=STOP)
        found = other.result().recording
    np.testing.assert_array_equal(found.values, expected[300:])
    assert found.time[0] == 0.06


def _continued(arguments: tuple[str, bytes]) -> Any:
    scenario, state = arguments
    with fb.simulation(scenario) as sim:
        sim.restore(state)
        sim.step(until=STOP)
        return sim["plant.y_pi"]


@pytest.mark.native
def test_snapshot_serves_another_process(scenario: str) -> None:
    with fb.simulation(scenario) as sim:
        sim.step(500)
        state = bytes(sim.snapshot())
        sim.step(until=STOP)
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            (found,) = pool.map(_continued, [(scenario, state)])
        np.testing.assert_array_equal(found, sim["plant.y_pi"])


@pytest.mark.native
def test_reset_is_a_new_simulation_with_other_values(scenario: str) -> None:
    start = {"plant.beam[].tip_mass": 0.03, "feedforward.transition_time": 0.1, "plant.strain_noise_std": 1e-6}
    expected = recorded(scenario, overrides={**start, "plant.noise_seed": 5})
    plain = recorded(scenario)
    with fb.simulation(scenario) as sim:
        sim.step(100)
        sim.reset(start, seed=5)
        assert sim.time == 0.0
        sim.step(until=STOP)
        np.testing.assert_array_equal(sim.result().recording.values, expected.values)
        sim.reset()
        sim.step(until=STOP)
        np.testing.assert_array_equal(sim.result().recording.values, plain.values)


@pytest.mark.native
def test_a_law_in_python_takes_the_place_of_an_instance(scenario: str) -> None:
    """Voltages that the plant gets from a law are those of a run that is driven by their record."""
    with fb.simulation(scenario, without=["controller"], start={"plant.u": 3.0}) as sim:
        assert sim.inputs == ("plant.u", "plant.force")[:1]
        assert sim["plant.u"] == 3.0
        while sim.time < STOP:
            sim["plant.u"] = sim["feedforward.u_ff"] + law(sim["plant.y_pm"])
            sim.step()
        run = sim.result()
    columns = run.recording.columns
    u, y_pm = (run.recording.values[:, columns.index(name)] for name in ("plant.u[1]", "plant.y_pm[1]"))
    u_ff = run.recording.values[:, columns.index("feedforward.u_ff[1]")]
    np.testing.assert_allclose(u[:-1], (u_ff - 2e4 * y_pm)[:-1], rtol=1e-12, atol=1e-12)
    assert np.ptp(u) > 1.0


@pytest.mark.native
def test_an_input_without_its_signal_is_open(scenario: str) -> None:
    with fb.simulation(scenario, without=["feedforward.y_target"]) as sim:
        assert sim.inputs == ("feedforward.y_target",)
        sim.step(50)
        assert not sim["feedforward.moving"]
        sim["feedforward.y_target"] = [1e-3]
        sim.step()
        assert sim["feedforward.moving"] == 1.0
        assert sim["feedforward.y_target[1]"] == 1e-3


@pytest.mark.native
def test_without_recording_the_present_is_there(scenario: str) -> None:
    with fb.simulation(scenario, record=False) as sim:
        sim.step(until=STOP)
        recording = sim.result().recording
    assert recording.time.tolist() == [0.0, STOP]
    np.testing.assert_array_equal(recording.values[-1], recorded(scenario).values[-1])


@pytest.mark.native
def test_refusals_leave_the_simulation_as_it_was(scenario: str) -> None:
    expected = recorded(scenario).values
    with fb.simulation(scenario, without=["feedforward.y_target"]) as sim:
        sim.step(50)
        state = bytes(sim.snapshot())
        for call, message in (
            (
                lambda: sim["plant.y_pii"],
                "plant.y_pii is not a variable of this simulation; did you mean 'plant.y_pi'?",
            ),
            (lambda: sim.__setitem__("plant.v", 0.0), "plant.v is not a variable"),
            (lambda: sim.__setitem__("plant.u[1]", 0.0), "plant.u[1] is neither an open input (feedforward.y_target)"),
            (lambda: sim.__setitem__("feedforward.y_target", [1.0, 2.0]), "must have 1 numbers, got [1.0, 2.0]"),
            (lambda: sim.__setitem__("controller.integral_gain", -1.0), "controller.integral_gain must be from 0"),
            (lambda: sim.step(-1), "step must be an integer >= 0, got -1"),
            (lambda: sim.step(1.5), "step must be an integer >= 0, got 1.5"),
            (lambda: sim.step("3"), "step must be an integer >= 0, got '3'"),
            (lambda: sim.step(True), "step must be an integer >= 0, got True"),
            (lambda: sim.restore(None), "snapshot must be one that snapshot() gave, or its bytes"),
            (lambda: sim.reset(seed="a"), "seed must be an integer >= 0, got 'a'"),
            (lambda: sim.__setitem__("plant.y_pi", 1.0), "plant.y_pi is not open: feedforward.y_target can be set"),
            (lambda: sim.step(until=1.0), "step must end by the stop time, 0.2 s; see stop_time, got 1"),
            (lambda: sim.reset({"plant.mass": 1.0}), "--set plant.mass is not a variable"),
            (lambda: sim.reset({"plant.u": 1.0}), "--set must not set an input that the scenario drives"),
            (lambda: sim.reset({"controller.feedback": 2.0}), "--set controller.feedback must be of type Boolean"),
            (lambda: sim.restore(state[:-1]), "snapshot must be the unchanged bytes of a snapshot"),
            (lambda: sim.restore(b""), "snapshot must be the unchanged bytes of a snapshot"),
        ):
            with pytest.raises(fb.FlexbeamsError) as caught:
                call()  # type: ignore[no-untyped-call]
            assert message in str(caught.value)
            assert sim.steps == 50
        sim["feedforward.y_target"] = 1e3
        with pytest.raises(
            fb.FlexbeamsError, match=r"feedforward failed at 0.01 s in fmi2Set...: y_target\[1\] must be"
        ):
            sim.step()
        sim["feedforward.y_target"] = 1e-3
        sim.step(until=STOP)
        np.testing.assert_array_equal(sim.result().recording.values, expected)


@pytest.mark.native
def test_snapshots_of_other_simulations_are_refused(scenario: str) -> None:
    with fb.simulation(scenario) as sim, fb.simulation(scenario, without=["controller"]) as other:
        sim.step(10)
        with pytest.raises(
            fb.FlexbeamsError, match="snapshot must be of a simulation of feedforward, controller, plant"
        ):
            sim.restore(bytes(other.snapshot()))
        sim.step(10)
        assert sim.steps == 20
    with fb.simulation(scenario, step=1e-3) as sim:
        with pytest.raises(fb.FlexbeamsError, match=r"snapshot must be of steps of 0\.001 s, by the stop time"):
            sim.restore(bytes(other_snapshot(scenario)))
        sim.step()


def other_snapshot(scenario: str) -> Any:
    with fb.simulation(scenario) as sim:
        return sim.snapshot()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"without": ["controler"]}, "without is neither an instance nor a driven input; did you mean 'controller'?"),
        ({"without": ["feedforward", "controller", "plant"]}, "without must leave an instance"),
        ({"design": {"reduced_mode": 4}}, "design: reduced_mode is not a known key; did you mean 'reduced_modes'?"),
        ({"start": {"plant.mass": 1.0}}, "--set plant.mass is not a variable"),
        ({"scenario": "loop.ssp"}, "scenario must be a scenario, which may name FMUs; packages are run as a whole"),
        ({"scenario": "plant.FMU"}, "scenario must be a scenario, which may name FMUs; packages are run as a whole"),
    ],
)
def test_mistakes(scenario: str, options: Any, message: str) -> None:
    with pytest.raises(fb.FlexbeamsError) as caught:
        fb.simulation(**{"scenario": scenario, **options})
    assert message in str(caught.value)


def test_a_failed_unit_goes_on_after_restore_and_reset(scenario: str) -> None:
    """The controller gives up after 50 strains beyond its limit; a refused step counts as none."""
    for backend in ("native", "python"):
        with fb.simulation(scenario, without=["controller.y_pm"], backend=backend) as sim:  # type: ignore[arg-type]
            sim.step(10)
            state = sim.snapshot()
            sim["controller.y_pm"] = 0.5
            with pytest.raises(fb.FlexbeamsError, match=r"controller failed at 0\.0118 s"):
                sim.step(100)
            assert sim.steps == 59
            with pytest.raises(fb.FlexbeamsError, match="the simulation goes on after reset or restore"):
                sim.step()
            assert len(sim.result().time) == 60
            sim.restore(state)
            assert sim["controller.y_pm"].tolist() == [0.0, 0.0]
            sim.step(100)
            values = sim["plant.y_pi"]
            sim.reset()
            sim.step(110)
            np.testing.assert_array_equal(sim["plant.y_pi"], values)


def test_closed_simulations_keep_what_they_recorded(scenario: str) -> None:
    sim = fb.simulation(scenario, backend="python", start={"controller.feedback": False})
    sim.step(100)
    state, expected = sim.snapshot(), sim.result().recording
    sim.close()
    sim.close()
    np.testing.assert_array_equal(sim.result().recording.values, expected.values)
    assert expected.frames is not None
    np.testing.assert_array_equal(sim.result().recording.frames.values, expected.frames.values)  # type: ignore[union-attr]
    assert (sim.time, sim.steps, len(sim["plant.y_pm"])) == (0.02, 100, 2)
    for call in (sim.step, sim.snapshot, sim.reset, lambda: sim.step(until=0.02), lambda: sim.restore(state)):
        with pytest.raises(fb.FlexbeamsError, match="simulation is closed"):
            call()  # type: ignore[no-untyped-call, operator]
    with pytest.raises(fb.FlexbeamsError, match=r"plant\.energy is not a variable"):
        sim["plant.energy"]
    with fb.simulation(scenario, backend="python") as other:
        other.restore(state)
        assert other.steps == 100


@pytest.mark.native
def test_ctrl_c_takes_effect_between_two_steps(scenario: str, ctrl_c: None) -> None:
    with (
        fb.simulation(scenario, stop_time=200.0, record=False) as sim,
        fb.simulation(scenario, stop_time=200.0) as twin,
    ):
        timer = threading.Timer(0.05, signal.raise_signal, (signal.SIGINT,))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            sim.step(until=200.0)
        timer.join()
        done = sim.steps
        assert 0 < done < 1_000_000
        sim.step(10)
        twin.step(done + 10)
        np.testing.assert_array_equal(sim["plant.y_pi"], twin["plant.y_pi"])


@pytest.mark.native
def test_matrices_of_a_parameter_set_are_those_of_the_unit(scenario: str) -> None:
    """x+ = A x + B (u, force), y = C x with the sampled matrices, beside the unit with the same parameters."""
    changed = {"beam[1].tip_mass": 0.03, "patch[].piezo_ratio": 20.0}
    plant = fb.design("single_beam").plant(start=changed).sampled(2e-4)
    start: Any = {f"plant.{name}": value for name, value in changed.items()}
    random = np.random.default_rng(1)
    x, found, expected = np.zeros(len(plant.A)), [], []
    with fb.simulation(scenario, without=["controller", "plant.force"], start=start) as sim:
        for _ in range(200):
            u, force = random.uniform(-500, 500, 1), random.uniform(-1, 1, 1)
            sim["plant.u"], sim["plant.force"] = u, force
            sim.step()
            x = plant.A @ x + plant.B @ np.concatenate([u, force])
            expected.append(plant.C @ x)
            found.append(np.concatenate([sim["plant.y_pi"], sim["plant.y_pm"]]))
    gap, largest = np.abs(np.array(found) - expected).max(axis=0), np.abs(expected).max(axis=0)
    assert np.all(gap < 1e-11 * largest)


@pytest.mark.native
def test_whatever_is_restored_the_recording_is_that_of_the_course(scenario: str) -> None:
    """Random steps, snapshots, restores as objects and as bytes, resets and results; the law depends on the time."""
    steps, options = 1000, {"without": ["controller"], "decimate": 3}

    def run(sim: Simulation, count: int) -> None:
        for _ in range(min(count, steps - sim.steps)):
            sim["plant.u"] = 100 * np.sin(40 * sim.time)
            sim.step()

    with fb.simulation(scenario, **options) as sim:  # type: ignore[arg-type]
        run(sim, steps)
        expected = sim.result().recording
    random = np.random.default_rng(5)
    begins = set()
    for _ in range(12):
        states: list[Any] = []
        with fb.simulation(scenario, **options) as sim:  # type: ignore[arg-type]
            for action in random.choice(["step", "snapshot", "restore", "bytes", "reset", "result"], 25):
                run(sim, int(random.choice([1, 2, 7, 99, 101, 300])))
                if action == "snapshot":
                    states.append(sim.snapshot())
                elif action in ("restore", "bytes") and states:
                    state = states[random.integers(len(states))]
                    sim.restore(bytes(state) if action == "bytes" else state)
                elif action == "reset" and random.uniform() < 0.2:
                    sim.reset()
                elif action == "result":
                    sim.result()
            run(sim, steps)
            found = sim.result().recording
        first = int(np.searchsorted(expected.time, found.time[0]))
        begins.add(first)
        np.testing.assert_array_equal(found.time, expected.time[first:])
        np.testing.assert_array_equal(found.values, expected.values[first:])
        if first == 0:
            assert found.frames is not None
            assert expected.frames is not None
            np.testing.assert_array_equal(found.frames.values, expected.frames.values)
    assert len(begins) > 3
