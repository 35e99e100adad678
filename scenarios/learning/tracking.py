"""The tracking task as an environment of Gymnasium: voltages from strains and a reference."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Backend
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.simulation import Simulation

Vector = NDArray[np.float32]
_LARGEST_TARGET = 0.8  # share of the voltage limit that a target needs at rest, at most
_PER_METRE = 1e3  # errors count in mm


class TrackingEnvironment(gymnasium.Env[Vector, Vector]):
    """Rest-to-rest motions of elastically coupled beams: the agent takes the place of the controller.

    The feedforward plans a motion to a random target that begins with the episode. The action holds for `hold`
    communication steps of 0.2 ms.

    Observation
        (n_pm + n_pi + n_u,) float32 in [-1, 1]: strains, reference deflections, feedforward voltages. Strains and
        deflections are divided by twice those that the voltage limit gives at rest at most, and clipped; voltages are
        divided by the limit.
    Action
        (n_u,) float32 in [-1, 1]: voltages divided by the limit, clipped to those of each pair.
    Reward
        -mean((y_pi - y_ref)^2) / mm^2 - effort * mean((u - u_ff)^2) / limit^2 at the end of the step: the squared error
        of the deflections, and the squared voltage that the agent adds to the feedforward.
    End
        The episode is truncated after `episode_time`; it is terminated where the norm of the deflections y_pi exceeds
        `deflection_limit`, far beyond the linear model.
    Reset
        `reset(seed=...)` seeds all that is random: the target, the plant's parameters, each uniformly within `spread`
        of its value, and the strain noise. Without spread and noise the state at rest is restored. The option
        `target`, deflections (n_pi,) in m, takes the place of the random one. `info` has `target` and `parameters`.

    Parameters
    ----------
    scenario, structure
        A scenario with the instances feedforward, controller and plant, and another structure for it.
    spread
        Relative half width of the plant's parameters.
    noise
        Standard deviation of the strain noise, a new value each sample.
    episode_time, hold
        Simulated time of an episode, s, and communication steps for each action.
    effort, deflection_limit
        Weight of the agent's voltage in the reward; norm of the deflections that ends an episode, m.
    backend
        Kernel of the units, `native` or `python`.

    Raises
    ------
    FlexbeamsError
        Where the scenario cannot be simulated, or an option breaks a rule.

    Examples
    --------
    >>> import flexbeams as fb, gymnasium
    >>> fb.register_environments()
    >>> env = gymnasium.make("flexbeams/Tracking-v0", spread=0.1, noise=1e-7)
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(observation[-4:])  # the feedforward's voltages
    >>> observation.shape, terminated, truncated
    ((14,), False, False)
    >>> env.close()
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (as gymnasium declares it)

    def __init__(
        self,
        scenario: str = "tracking",
        *,
        structure: str | None = None,
        spread: float = 0.1,
        noise: float = 1e-7,
        episode_time: float = 3.0,
        hold: int = 1,
        effort: float = 0.01,
        deflection_limit: float = 0.1,
        backend: Backend = "native",
        render_mode: None = None,
    ) -> None:
        if not 0 <= spread < 1:
            raise InputError("spread", "must be >= 0 and < 1", spread)
        if hold < 1:
            raise InputError("hold", "must be >= 1", hold)
        self.render_mode = render_mode
        settings = Settings(
            structure=structure,
            overrides={"feedforward.preview": 0.0, "plant.strain_noise_std": noise},
            stop_time=episode_time,
            backend=backend,
        )
        parts = ["controller", "feedforward.y_target"]
        self._sim = Simulation(load_scenario(scenario), settings, without=parts, record=False)
        self._spread, self._noisy, self._hold, self._stop = spread, noise > 0, hold, self._sim.prepared.steps
        design = self._sim.prepared.design
        self._limit = design.options.voltage_limit
        self._nominal = {f"plant.{name}": value for name, value in design.structure.parameters().items()}
        a = design.arrays
        self._static = np.linalg.pinv(a["static_inverse"])  # m/V, of deflections
        views = [self._sim.view(name) for name in ("plant.y_pm", "feedforward.y_ref", "feedforward.u_ff")]
        self._u, self._y_pi = self._sim.view("plant.u"), self._sim.view("plant.y_pi")
        self._y_pm, self._y_ref, self._u_ff = views
        strain = -a["H_pm"] @ np.linalg.solve(a["A"], a["B"]) + a["D_pm"]  # 1/V, at rest
        scales = [2 * self._limit * np.abs(gain).sum(axis=1) for gain in (strain, self._static)]
        self._factors = [1 / scales[0], 1 / scales[1], 1 / self._limit]
        self._buffer = np.empty(sum(map(len, views)))
        ends = np.cumsum([len(view) for view in views])
        self._parts = np.split(self._buffer, ends[:-1])
        self._voltages = design.options.voltage_limits(len(self._u))
        self._error, self._added = np.empty(len(self._y_pi)), np.empty(len(self._u))
        self._weights = _PER_METRE**2 / len(self._error), effort / (self._limit**2 * len(self._added))
        self._largest = deflection_limit**2
        self._rest = self._sim.snapshot()
        self.action_space = spaces.Box(-1.0, 1.0, (len(self._u),), np.float32)
        self.observation_space = spaces.Box(-1.0, 1.0, (len(self._buffer),), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Vector, dict[str, Any]]:
        """See gymnasium.Env.reset."""
        super().reset(seed=seed)
        random = self.np_random
        voltages = _LARGEST_TARGET * random.uniform(self._voltages.lowest, self._voltages.highest)
        target = np.asarray((options or {}).get("target", self._static @ voltages), dtype=float)
        factors = random.uniform(1 - self._spread, 1 + self._spread, len(self._nominal))
        noise_seed = int(random.integers(2**31 - 1))
        parameters = dict(zip(self._nominal, factors * list(self._nominal.values()), strict=True))
        if self._spread or self._noisy:
            self._sim.reset(parameters if self._spread else {}, seed=noise_seed)
        else:
            self._sim.restore(self._rest)
        self._sim["feedforward.y_target"] = target
        return self._observed(), {"target": target, "parameters": parameters}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """See gymnasium.Env.step."""
        u = self._u
        np.multiply(action, self._limit, out=u, dtype=np.float64)
        np.minimum(u, self._voltages.highest, out=u)
        np.maximum(u, self._voltages.lowest, out=u)
        sim = self._sim
        sim.step(self._hold)
        y_pi, error, added = self._y_pi, self._error, self._added
        np.subtract(y_pi, self._y_ref, out=error)
        np.subtract(u, self._u_ff, out=added)
        of_error, of_effort = self._weights
        reward = -of_error * float(error @ error) - of_effort * float(added @ added)
        terminated = bool(y_pi @ y_pi > self._largest)
        return self._observed(), reward, terminated, sim.steps + self._hold > self._stop, {}

    def _observed(self) -> Vector:
        for part, view, factor in zip(self._parts, (self._y_pm, self._y_ref, self._u_ff), self._factors, strict=True):
            np.multiply(view, factor, out=part)
        buffer = self._buffer
        np.minimum(buffer, 1.0, out=buffer)
        np.maximum(buffer, -1.0, out=buffer)
        return buffer.astype(np.float32)

    def close(self) -> None:
        """Ends the units."""
        self._sim.close()
