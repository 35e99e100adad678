"""How well the data determine the unknowns: deviations, correlations and directions that stay open.

The estimate solves sum_s J_s' psi(r_s) + x / prior^2 = 0 over the sensors s. To first order its covariance is
A^-1 B A^-1 with A = sum a_s J_s' J_s + P, B = sum v_s t_s J_s' J_s + P, where a_s is the mean slope and v_s the mean
square of psi, and t_s >= 1 counts how many neighbouring residuals say the same (1 for white noise).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from flexbeams.plant.basis import Array
from flexbeams.plant.identification.noise import correlation_length
from flexbeams.plant.identification.residuals import Residuals

OPEN = 0.5  # share of its prior's deviation that an undetermined parameter keeps
_NAMED = 0.25  # component of a unit direction that is worth naming


@dataclass(frozen=True, kw_only=True)
class Direction:
    """A combination of parameters that the data leave open."""

    deviation: float  # relative change that the data allow along it (one standard deviation); inf: no limit
    shares: dict[str, float]  # largest components of the unit vector, with sign


@dataclass(frozen=True, kw_only=True)
class Information:
    """Uncertainty of the parameters in the coordinates of the search, where a logarithm's unit is 100 %."""

    names: tuple[str, ...]
    deviations: Array  # (p,), one standard deviation, prior included
    correlations: Array  # (p, p), -1 ... 1
    covariance: Array  # (p, p)
    data: Array  # (p, p): Fisher information of the data alone, other unknowns eliminated
    undetermined: tuple[str, ...]  # parameters about which the prior says more than the data
    directions: tuple[Direction, ...]  # most open first
    correlation_lengths: Array  # (n_all,): t_s, rows


def information(residuals: Residuals, x: Array, *, robust_scale: float | None, rows: int = 1) -> Information:
    """The uncertainty at an estimate.

    `robust_scale` is the deviation at which soft_l1 bends, None for plain squares; each row stands for `rows` of the
    data.
    """
    p, size = len(residuals.space.names), residuals.unknowns.size
    prior = np.zeros(size)
    prior[:p] = 1 / residuals.space.deviation**2
    jacobian, values = residuals.jacobian(x).T, residuals.residuals(x)
    slopes, spread, fisher = np.diag(prior), np.diag(prior), np.zeros((size, size))
    lengths = np.ones(len(residuals.sensors.deviations))
    blocks = residuals.sensor_blocks()
    for sensor, spans in blocks.items():
        r = np.concatenate([values[span] for span in spans])
        psi, slope = influence(r, robust_scale)
        lengths[sensor] = max(correlation_length(values[span]) for span in spans)
        gram = rows * np.sum([jacobian[:, span] @ jacobian[:, span].T for span in spans], axis=0)
        a, v = float(np.mean(slope)), max(float(np.mean(psi**2)), 1e-12)
        slopes = slopes + a * gram
        spread = spread + v * lengths[sensor] * gram
        fisher = fisher + a**2 / (v * lengths[sensor]) * gram
    factor = cho_factor(slopes + 1e-12 * np.diag(np.diag(slopes)))
    covariance = cho_solve(factor, cho_solve(factor, spread).T)[:p, :p]
    deviations = np.sqrt(np.diag(covariance))
    data = _without_others(fisher, p)
    posterior = np.sqrt(np.diag(np.linalg.inv(data + np.diag(prior[:p]))))
    undetermined = posterior > OPEN * residuals.space.deviation
    return Information(
        names=residuals.space.names,
        deviations=deviations,
        correlations=covariance / np.outer(deviations, deviations),
        covariance=covariance,
        data=data,
        undetermined=tuple(n for n, is_open in zip(residuals.space.names, undetermined, strict=True) if is_open),
        directions=open_directions(data, residuals.space.names, OPEN * float(np.median(residuals.space.deviation))),
        correlation_lengths=lengths,
    )


def open_directions(data: Array, names: tuple[str, ...], limit: float) -> tuple[Direction, ...]:
    """Directions in which the data allow more than `limit`, most open first."""
    values, vectors = np.linalg.eigh(data)
    floor = 1e-13 * max(float(values[-1]), 1e-300)
    directions = []
    for value, vector in zip(values, vectors.T, strict=True):
        deviation = 1 / np.sqrt(value) if value > floor else np.inf
        if deviation <= limit:
            break
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        largest = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) >= min(_NAMED, np.max(np.abs(vector)))]
        directions.append(Direction(deviation=float(deviation), shares={names[k]: float(vector[k]) for k in largest}))
    return tuple(directions)


def influence(r: Array, scale: float | None) -> tuple[Array, Array]:
    """psi(r) of soft_l1 and its slope."""
    if scale is None:
        return r, np.ones_like(r)
    bend = 1 + (r / scale) ** 2
    return r / np.sqrt(bend), bend**-1.5


def _without_others(fisher: Array, p: int) -> Array:
    """Information on the first p unknowns once the others are estimated as well (Schur complement)."""
    if len(fisher) == p:
        return fisher
    inner = fisher[p:, p:]
    regular = inner + 1e-12 * np.diag(np.diag(inner)) + 1e-300 * np.eye(len(inner))
    data: Array = fisher[:p, :p] - fisher[:p, p:] @ np.linalg.solve(regular, fisher[p:, :p])
    return data
