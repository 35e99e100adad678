"""Rest positions under constant voltages, measured, and what of the parameters they show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import least_squares

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.space import ParameterSpace
from flexbeams.plant.identification.static import LAST, LATER, plateau_mean, plateaus


@dataclass(frozen=True, kw_only=True)
class RestPosition:
    """The sensors' means at the end of a stretch of constant voltages."""

    voltages: Array  # (n_u,), V
    sensors: tuple[int, ...]
    means: Array  # (n_s,), m or 1
    errors: Array  # (n_s,): standard deviation by noise and by what is left of oscillations
    uncoupled: bool


def rest_positions(experiments: Sequence[Experiment]) -> list[RestPosition]:
    """Those of all plateaus under voltages."""
    found = []
    for experiment in experiments:
        for first, last in plateaus(experiment):
            if not np.any(experiment.voltages[first]):
                continue
            mean, variance = plateau_mean(experiment, first, last, LAST)
            left = np.max([np.abs(plateau_mean(experiment, first, last, s)[0] - mean) for s in LATER], axis=0)
            found.append(
                RestPosition(
                    voltages=experiment.voltages[first],
                    sensors=experiment.sensors,
                    means=mean,
                    errors=np.sqrt(variance + (left / 1.96) ** 2),
                    uncoupled=experiment.uncoupled,
                )
            )
    return found


class RestResiduals:
    """Predicted less measured means over `deviations` (n_all,), priors last, and their Jacobian; k means in all."""

    def __init__(
        self, model: BeamModel, positions: Sequence[RestPosition], space: ParameterSpace, deviations: Array
    ) -> None:
        self.model, self.positions, self.space, self.deviations = model, list(positions), space, deviations
        self._rows = np.vstack([model.deflection, model.strain])
        self._terms = {term.parameter: term for term in model.terms}

    @property
    def errors(self) -> Array:
        """Standard deviations (k,) of the residuals of the means."""
        return np.concatenate([p.errors / self.deviations[list(p.sensors)] for p in self.positions])

    def residuals(self, x: Array) -> Array:
        """The residuals (k + p,) at x (p,)."""
        values, parts = self.space.values(x), []
        for position in self.positions:
            rest, seen, _ = self._solved(values, position)
            parts.append((seen @ rest - position.means) / self.deviations[list(position.sensors)])
        return np.concatenate([*parts, x / self.space.deviation])

    def jacobian(self, x: Array) -> Array:
        """Derivatives (k + p, p) of the residuals at x (p,)."""
        values, slopes, parts = self.space.values(x), self.space.slopes(x), []
        for position in self.positions:
            rest, _, adjoint = self._solved(values, position)
            columns = np.zeros((len(position.sensors), len(x)))
            for k, name in enumerate(self.space.names):
                term = self._terms[name]
                if position.uncoupled and name.startswith("spring["):
                    continue
                rows = slice(term.start, term.start + len(term.block))
                if term.matrix == "K":
                    columns[:, k] = -slopes[k] * adjoint[:, rows] @ (term.block @ rest[rows])
                elif term.matrix == "L":
                    columns[:, k] = slopes[k] * adjoint[:, rows] @ term.block[:, 0] * position.voltages[term.column]
            parts.append(columns / self.deviations[list(position.sensors), None])
        return np.vstack([*parts, np.diag(1 / self.space.deviation)])

    def fitted(self, x: Array) -> Array:
        """The x (p,) with the least squares, from x on."""
        low, high = self.space.lower, self.space.upper
        start = np.clip(x, low + 1e-9, high - 1e-9)
        result = least_squares(self.residuals, start, jac=self.jacobian, bounds=(low, high), xtol=1e-10, ftol=1e-12)
        solution: Array = result.x
        return solution

    def _solved(self, values: dict[str, float], position: RestPosition) -> tuple[Array, Array, Array]:
        """Coordinates q (n,) at rest, the sensors' rows (n_s, n), and rows K^-1 (n_s, n)."""
        loose = {name: 0.0 for name in values if name.startswith("spring[")} if position.uncoupled else {}
        system = self.model.assemble({**values, **loose})
        factor = cho_factor(system.K, lower=True)
        seen = self._rows[list(position.sensors)]
        return cho_solve(factor, system.L @ position.voltages), seen, cho_solve(factor, seen.T).T
