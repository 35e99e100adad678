"""How well an identification meets each experiment, and what it predicts for a controller."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from flexbeams.plant.basis import Array
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.method import Identification
from flexbeams.plant.identification.residuals import Residuals


@dataclass(frozen=True, kw_only=True)
class Fit:
    """One experiment beside its prediction; n_s sensors."""

    experiment: Experiment
    predicted: Array  # (rows that count, n_s), m or 1
    initial: Array  # (rows that count, n_s): prediction of the start

    @property
    def name(self) -> str:
        """Name of the experiment."""
        return self.experiment.name

    @property
    def held_back(self) -> bool:
        """Whether the fit did not see it."""
        return self.experiment.held_back

    @property
    def measured(self) -> Array:
        """The outputs (rows that count, n_s)."""
        return self.experiment.outputs[self.experiment.first_counted :]

    def relative_by_sensor(self, names: list[str]) -> dict[str, float]:
        """rms of the residual over rms of the signal, by sensor."""
        size = np.sqrt(np.mean(self.measured**2, axis=0))
        rest = np.sqrt(np.mean((self.measured - self.predicted) ** 2, axis=0))
        relative = rest / np.where(size > 0, size, 1.0)
        return {names[s]: float(relative[k]) for k, s in enumerate(self.experiment.sensors)}


def fits_of(result: Identification) -> list[Fit]:
    """All experiments, those held back last and without fitted offsets or starts."""
    fitted = result.estimate.residuals
    initial = _with_start_values(result, fitted)
    fits = [
        Fit(
            experiment=drive.experiment,
            predicted=(after.outputs + fitted.offsets(result.estimate.x, k)[:, None]).T,
            initial=before.outputs.T,
        )
        for k, (drive, after, before) in enumerate(
            zip(fitted.drives, fitted.predictions(result.estimate.x), initial, strict=True)
        )
    ]
    if result.held_back:
        space, p = fitted.space, len(fitted.space.names)
        held = Residuals(result.model, result.held_back, space, fitted.sensors)
        x = np.zeros(held.unknowns.size)
        x[:p] = result.estimate.x[:p]
        if fitted.sensors.fit_delays:
            x[held.unknowns.delays] = result.estimate.x[fitted.unknowns.delays]
        fits += [
            Fit(experiment=experiment, predicted=after.outputs.T, initial=before.outputs.T)
            for experiment, after, before in zip(
                result.held_back, held.predictions(x), _with_start_values(result, held), strict=True
            )
        ]
    return fits


def _with_start_values(result: Identification, residuals: Residuals) -> list:  # type: ignore[type-arg]
    space = residuals.space
    x = np.zeros(residuals.unknowns.size)
    starts = {p.name: p.start for p in result.parameters}
    x[: len(space.names)] = space.coordinates(starts)
    return residuals.predictions(x)


@dataclass(frozen=True, kw_only=True)
class EndError:
    """Predicted uncertainty of where a feedforward ends."""

    target: Array  # (n_pi,), m
    half_width: Array  # (n_pi,), m, of 95 % intervals


def end_error(result: Identification) -> EndError:
    """Where a feedforward with the identified statics ends on a plant of the same basis, to first order.

    y = G(p) G(p^)^+ y*, so that dy = dG G^+ y*. The target y* is the largest static deflection of the experiments.
    """
    model, values = result.model, {p.name: p.value for p in result.parameters}
    system = model.assemble(values)
    factor = cho_factor(system.K, lower=True)
    rest = cho_solve(factor, system.L)
    gain = model.deflection @ rest
    voltages = [e.voltages[k] for e in _experiments(result) for k in (len(e.voltages) // 2, -1)]
    target = max((gain @ v for v in voltages), key=lambda y: float(np.max(np.abs(y))))
    u = np.linalg.pinv(gain) @ target
    slopes = _static_slopes(result, values, cho_solve(factor, model.deflection.T).T, rest, u)
    spread = np.einsum("ik,kl,il->i", slopes, result.joint.covariance, slopes)
    return EndError(target=np.asarray(target), half_width=1.96 * np.sqrt(np.maximum(spread, 0.0)))


def _experiments(result: Identification) -> list[Experiment]:
    return [drive.experiment for drive in result.estimate.residuals.drives]


def _static_slopes(result: Identification, values: Mapping[str, float], seen: Array, rest: Array, u: Array) -> Array:
    """d(G u)/d ln p (n_pi, p) for the jointly free parameters."""
    terms = {term.parameter: term for term in result.model.terms}
    slopes = np.zeros((len(seen), len(result.joint.names)))
    for k, name in enumerate(result.joint.names):
        term = terms[name]
        part = slice(term.start, term.start + len(term.block))
        if term.matrix == "K":
            slopes[:, k] = -values[name] * seen[:, part] @ term.block @ rest[part] @ u
        elif term.matrix == "L":
            slopes[:, k] = values[name] * seen[:, part] @ term.block[:, 0] * u[term.column]
    return slopes
