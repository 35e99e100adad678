"""Output-error estimate of the parameters: nonlinear least squares with exact Jacobian, from short to long horizons.

Oscillations that have slipped by more than half a period have local minima. A horizon of one period of the slowest
mode has none within reach of a start that is some ten percent off; each longer one starts from the last fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.noise import correlation_length
from flexbeams.plant.identification.residuals import Residuals, SensorModel
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.statespace import undamped_frequencies

ROUGH_ROWS = 400  # rows of an experiment that a short horizon needs
CAUTIOUS_WEIGHT = 0.1  # of strain gauges, relative
_AT_START = 1e-4  # length of x below which it is where the search began
WHITE = 5.0  # correlation length, in thinned rows, below which residuals are noise
ROUGH_DEVIATION = 0.05  # of a sensor's rms: noise assumed until residuals are there to measure it
FIRST_HORIZON = 0.125  # periods of the slowest mode: one or two of the next group of modes
FEWEST_ROWS = 10  # that count in a horizon
FEW = 15  # evaluations of a short horizon
SHORT, ROUGH, FINE = (1e-2, 1e-3), (1e-3, 1e-4), (1e-5, 1e-8)  # change of unknowns and of cost that ends a stage
FINISH = 5  # evaluations over all rows: one Gauss-Newton step from the thinned rows' estimate is efficient already
Loss = Literal["soft_l1", "linear"]
ROBUST_SCALE = 3.0  # standard deviations beyond which a residual counts less (soft_l1)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How the search runs."""

    loss: Loss = "soft_l1"  # of scipy.optimize.least_squares
    weights: Array | None = None  # (n_all,), multiplies the weight of each sensor; None: see Search
    delays: Array | None = None  # (n_all,), s
    fit_delays: bool = False
    fit_offsets: bool = False
    evaluations: int = 60  # at most, of the last stage


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Where a search ended."""

    residuals: Residuals  # over all data
    x: Array  # (size,)
    deviations: Array  # (n_all,): rms of the residuals of each sensor over its weight, m or 1
    weights: Array  # (n_all,)
    evaluations: int  # predictions of all experiments
    interrupted: bool = False

    @property
    def values(self) -> dict[str, float]:
        """All parameters, SI."""
        return self.residuals.space.values(self.x[: len(self.residuals.space.names)])


class Search:
    """The stages of one estimate.

    Without weights of the user's, strain gauges count CAUTIOUS_WEIGHT until their residuals look like noise: a basis
    may be far off in the statics of the strains, and would trade deflections for them. `notify` receives the name of
    each stage, `progress` the evaluations of its search: done, and at most.
    """

    def __init__(
        self,
        model: BeamModel,
        experiments: Sequence[Experiment],
        settings: Settings,
        notify: Callable[[str], None] = lambda text: None,
        progress: Callable[[int, int], None] = lambda done, most: None,
    ) -> None:
        self.model, self.experiments, self.settings = model, list(experiments), settings
        self.notify, self.progress = notify, progress
        self.evaluations = 0
        points, gauges = len(model.deflection), len(model.strain)
        self.sensor_count = points + gauges
        cautious = np.concatenate([np.ones(points), np.full(gauges, CAUTIOUS_WEIGHT)])
        self.weights: Array = cautious if settings.weights is None else settings.weights

    def coarse(self, space: ParameterSpace, start: Array) -> Estimate:
        """The estimate over growing horizons, then over thinned rows, from parameters `start` (p,)."""
        x, deviations = start, self.rough_deviations()
        try:
            for name, horizon in self._horizons(space, x):
                self.notify(name)
                part = self.residuals_of(horizon, space, deviations, rough=True)
                x = self._solve(part, self._extended(part, x), "linear", FEW, SHORT)[: len(space.names)]
            self.notify("all rows, thinned")
            part = self.residuals_of(self.experiments, space, deviations, rough=True)
            x = self._solve(part, self._extended(part, x), "linear", self.settings.evaluations, ROUGH)
            for _ in range(2):
                if self.settings.weights is None:
                    self._trust_white_sensors(part, x)
                deviations = self.measured_deviations(part, x)
                part = self.residuals_of(self.experiments, space, deviations, rough=True)
                x = self._solve(part, x, self.settings.loss, self.settings.evaluations, ROUGH)
        except _Interrupted as stop:
            return self._stopped(stop, space, deviations)
        return Estimate(residuals=part, x=x, deviations=deviations, weights=self.weights, evaluations=self.evaluations)

    def refined(self, space: ParameterSpace, x: Array, deviations: Array) -> Estimate:
        """The estimate over thinned rows from unknowns x (size,) near it."""
        try:
            part = self.residuals_of(self.experiments, space, deviations, rough=True)
            x = self._solve(part, x, self.settings.loss, self.settings.evaluations, ROUGH)
            deviations = self.measured_deviations(part, x)
        except _Interrupted as stop:
            return self._stopped(stop, space, deviations)
        return Estimate(residuals=part, x=x, deviations=deviations, weights=self.weights, evaluations=self.evaluations)

    def fine(self, space: ParameterSpace, x: Array, deviations: Array) -> Estimate:
        """The estimate over all rows from unknowns x (size,) near it, the sensors' deviations measured once more."""
        self.notify("all rows")
        try:
            full = self.residuals_of(self.experiments, space, deviations)
            deviations = self.measured_deviations(full, x)
            full = self.residuals_of(self.experiments, space, deviations)
            x = self._solve(full, x, self.settings.loss, FINISH, FINE)
        except _Interrupted as stop:
            return self._stopped(stop, space, deviations)
        return Estimate(residuals=full, x=x, deviations=deviations, weights=self.weights, evaluations=self.evaluations)

    def misfit(self, estimate: Estimate) -> float:
        """Median over the points of interest of the residuals' rms over that of the signal."""
        points = slice(0, len(self.model.deflection))
        sizes = self.rough_deviations() * self.weights / ROUGH_DEVIATION
        return float(np.median((estimate.deviations * self.weights / sizes)[points]))

    def _trust_white_sensors(self, residuals: Residuals, x: Array) -> None:
        """Full weight for sensors whose residuals are noise, whatever the model."""
        values = residuals.residuals(x)
        for sensor, spans in residuals.sensor_blocks().items():
            white = max(correlation_length(values[span]) for span in spans) < WHITE
            if white:
                self.weights = np.where(np.arange(self.sensor_count) == sensor, 1.0, self.weights)

    def _stopped(self, stop: "_Interrupted", space: ParameterSpace, deviations: Array) -> Estimate:
        full = self.residuals_of(self.experiments, space, deviations)
        x = stop.x if len(stop.x) == full.unknowns.size else self._extended(full, stop.x[: len(space.names)])
        return Estimate(
            residuals=full,
            x=x,
            deviations=deviations,
            weights=self.weights,
            evaluations=self.evaluations,
            interrupted=True,
        )

    def rough_deviations(self) -> Array:
        """ROUGH_DEVIATION of the rms of each sensor over all experiments (n_all,)."""
        squares, counts = np.zeros(self.sensor_count), np.zeros(self.sensor_count)
        for experiment in self.experiments:
            at = list(experiment.sensors)
            squares[at] += np.sum(experiment.outputs**2, axis=0)
            counts[at] += experiment.rows
        sizes = np.sqrt(squares / np.maximum(counts, 1))
        deviations: Array = ROUGH_DEVIATION * np.where(sizes > 0, sizes, 1.0) / self.weights
        return deviations

    def measured_deviations(self, residuals: Residuals, x: Array) -> Array:
        """Standard deviation (n_all,) of each sensor's residuals over its weight; outliers count up to 2.5 of them."""
        values = residuals.residuals(x)
        deviations = np.ones(self.sensor_count)
        for sensor, spans in residuals.sensor_blocks().items():
            own = np.concatenate([values[span] for span in spans])
            deviations[sensor] = _winsorised(own) * residuals.sensors.deviations[sensor]
        weighted: Array = deviations / self.weights
        return weighted

    def residuals_of(
        self, experiments: Sequence[Experiment], space: ParameterSpace, deviations: Array, rough: bool = False
    ) -> Residuals:
        settings = self.settings
        delays = np.zeros(self.sensor_count) if settings.delays is None else settings.delays
        sensors = SensorModel(
            deviations=deviations,
            delays=delays,
            fit_delays=settings.fit_delays,
            fit_offsets=settings.fit_offsets,
        )
        longest = max(experiment.rows - experiment.first_counted for experiment in experiments)
        return Residuals(self.model, experiments, space, sensors, stride=max(1, longest // ROUGH_ROWS) if rough else 1)

    def _extended(self, residuals: Residuals, x: Array) -> Array:
        """x (p,) with zeros for the unknowns beside the parameters."""
        return np.concatenate([x, np.zeros(residuals.unknowns.size - len(x))])

    def _horizons(self, space: ParameterSpace, x: Array) -> list[tuple[str, list[Experiment]]]:
        """Horizons of 1/8, 1/4, 1/2 ... periods of the slowest mode after each experiment's first excitation."""
        slowest = undamped_frequencies(self.model.assemble(space.values(x)))[0]
        period = 2 * np.pi / slowest
        horizons = []
        length = FIRST_HORIZON * period
        while length < max(e.duration - e.onset * e.step for e in self.experiments):
            horizons.append(
                (
                    f"{length:.2g} s",
                    [
                        e.first(min(e.rows, max(e.onset + int(length / e.step), e.first_counted + FEWEST_ROWS)))
                        for e in self.experiments
                    ],
                )
            )
            length *= 2
        return horizons

    def _solve(
        self, residuals: Residuals, x: Array, loss: str, evaluations: int, tolerance: tuple[float, float]
    ) -> Array:
        unknowns, best = residuals.unknowns, _Best()
        edge = 1e-9
        before = self.evaluations
        if np.linalg.norm(x) < _AT_START:  # the search's first steps are as long as x, but 1 from zero
            x = np.zeros_like(x)
        x = np.clip(x, unknowns.lower + edge, unknowns.upper - edge)

        def values(x: Array) -> Array:
            self.evaluations += 1
            self.progress(self.evaluations - before, evaluations)
            try:
                r = residuals.residuals(x)
            except DesignError:
                return np.full(residuals.data_rows + len(residuals.space.names), np.nan)
            best.see(x, r)
            return r

        try:
            result = least_squares(
                values,
                x,
                jac=residuals.jacobian,
                bounds=(unknowns.lower, unknowns.upper),
                method="trf",
                loss=loss,
                f_scale=ROBUST_SCALE,
                xtol=tolerance[0],
                ftol=tolerance[1],
                gtol=None,
                max_nfev=evaluations,
            )
        except KeyboardInterrupt:
            raise _Interrupted(x if best.x is None else best.x) from None
        solution: Array = result.x
        return solution


@dataclass
class _Best:
    """The unknowns with the least squares so far."""

    x: Array | None = None
    cost: float = field(default=np.inf)

    def see(self, x: Array, residuals: Array) -> None:
        cost = float(residuals @ residuals)
        if cost < self.cost:
            self.x, self.cost = x.copy(), cost


class _Interrupted(Exception):
    """Ctrl-C, with the best unknowns so far."""

    def __init__(self, x: Array) -> None:
        super().__init__()
        self.x = x


def _winsorised(values: Array) -> float:
    """Standard deviation about zero, each |value| cut at 2.5 of them; 0.97756 is the share that a normal one keeps."""
    deviation = float(np.sqrt(np.mean(values**2)))
    for _ in range(20):
        deviation = float(np.sqrt(np.mean(np.minimum(values**2, (2.5 * deviation) ** 2)) / 0.97756))
    return max(deviation, 1e-300)
