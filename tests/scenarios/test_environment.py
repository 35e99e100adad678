"""The environment of Gymnasium: its own checker, seeds, observations, rewards and ends of episodes."""

import sys
import warnings
from typing import Any

import numpy as np
import pytest

import flexbeams as fb
from tests.native.workshop import needs_zig

gymnasium = pytest.importorskip("gymnasium")
pytestmark = [pytest.mark.native, needs_zig, pytest.mark.slow]


def make(**options: Any) -> Any:
    fb.register_environments()
    return gymnasium.make("flexbeams/Tracking-v0", structure="kiel", disable_env_checker=True, **options).unwrapped


def test_registered_once_by_a_public_name() -> None:
    for _ in range(2):
        fb.register_environments()
        assert gymnasium.spec("flexbeams/Tracking-v0").name == "Tracking"


def test_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(fb.FlexbeamsError, match=r"register_environments needs the package gymnasium \(pip install"):
        fb.register_environments()


@pytest.mark.parametrize("options", [{}, {"spread": 0.0, "noise": 0.0}, {"hold": 10}])
def test_checker_of_gymnasium_has_no_complaint(options: dict[str, Any]) -> None:
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(make(**options))
    assert [str(warning.message) for warning in caught] == []


def played(env: Any, seed: int, steps: int = 200) -> tuple[Any, Any, Any]:
    first, info = env.reset(seed=seed)
    random = np.random.default_rng(seed)
    observations = [first]
    for _ in range(steps):
        observation, *_ = env.step(random.uniform(-1, 1, 4).astype(np.float32))
        observations.append(observation)
    return np.array(observations), info["target"], info["parameters"]


def test_seed_decides_target_parameters_and_noise() -> None:
    env = make(spread=0.1, noise=1e-5)
    one, other, again = played(env, 3), played(env, 4), played(env, 3)
    np.testing.assert_array_equal(one[0], again[0])
    np.testing.assert_array_equal(one[1], again[1])
    assert one[2] == again[2]
    assert not np.array_equal(one[1], other[1])
    nominal = env.unwrapped._nominal
    assert set(one[2]) == set(nominal)
    assert len(nominal) == 37
    ratios = np.array([one[2][name] / value for name, value in nominal.items() if value])
    assert np.abs(ratios - 1).max() <= 0.1
    assert len(set(ratios)) == len(ratios)
    assert env._sim["plant.beam[1].tip_mass"] == one[2]["plant.beam[1].tip_mass"]
    quiet = make(spread=0.0, noise=0.0)
    np.testing.assert_array_equal(quiet.reset(seed=3)[0][:6], 0)
    assert np.abs(env.reset(seed=3)[0][:6]).min() > 0


def test_episode_of_the_feedforward_is_that_of_a_simulation() -> None:
    """Observations and rewards by a simulation with the same target; a restored start repeats the episode."""
    env = make(spread=0.0, noise=0.0, effort=0.5, episode_time=0.3)
    target = np.array([-4e-3, 5e-4, 2e-3, -3e-3])
    for _ in range(2):
        observation, info = env.reset(options={"target": target})
        np.testing.assert_array_equal(info["target"], target)
        action = np.float32([0.1, 0.0, -0.2, 0.0])
        rewards, ends = [], []
        for _ in range(1500):
            observation, reward, terminated, truncated, _ = env.step(action)
            rewards.append(reward)
            ends.append((terminated, truncated))
        assert ends == [(False, False)] * 1499 + [(False, True)]
        start, parts = {"feedforward.preview": 0.0}, ["controller", "feedforward.y_target"]
        with fb.simulation("tracking", without=parts, start=start, stop_time=0.3) as sim:
            sim["feedforward.y_target"] = target
            sim["plant.u"] = 1000.0 * action.astype(float)
            sim.step(1500)
            gap, added = sim["plant.y_pi"] - sim["feedforward.y_ref"], sim["plant.u"] - sim["feedforward.u_ff"]
            strains = sim["plant.y_pm"]
        expected = -np.mean(gap**2) / 1e-6 - 0.5 * np.mean(added**2) / 1e6
        assert rewards[-1] == pytest.approx(expected, rel=1e-12)
        static = env._sim.prepared.design.arrays
        scale = 1 / env._factors[0]
        np.testing.assert_allclose(observation[:6], strains / scale, rtol=1e-6, atol=1e-9)
        assert scale.shape == (len(static["H_pm"]),)


def test_large_deflections_terminate() -> None:
    env = make(spread=0.0, noise=0.0, deflection_limit=2e-3)
    env.reset(seed=1)
    terminated = False
    while not terminated:
        assert np.linalg.norm(env._sim["plant.y_pi"]) <= 2e-3
        _, _, terminated, truncated, _ = env.step(np.ones(4, np.float32))
        assert not truncated
    assert np.linalg.norm(env._sim["plant.y_pi"]) > 2e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [({"spread": 1.0}, "spread must be >= 0 and < 1, got 1"), ({"hold": 0}, "hold must be >= 1, got 0")],
)
def test_mistakes(options: dict[str, Any], message: str) -> None:
    with pytest.raises(fb.FlexbeamsError, match=message):
        make(**options)
