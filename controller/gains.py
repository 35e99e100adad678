"""The sampled model with the gains of filter and regulator, from densities and rates that hold at any sample time."""

from dataclasses import dataclass

import numpy as np

from flexbeams.controller.kalman import hankel_weights, predictor_gain
from flexbeams.controller.lqr import lqr_gain
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ReducedModel
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise

PUBLISHED_SAMPLE_TIME = 2e-4  # s, at which the published weights are covariances of one sample


def sample_ratio(options: DesignOptions) -> float:
    """Sample time as a multiple of the published one; exactly 1 there."""
    return options.sample_time / PUBLISHED_SAMPLE_TIME


def offset_gain(options: DesignOptions, gauges: int) -> Array:
    """l (n_pm,): fraction of the innovation that enters each strain offset in a sample."""
    return np.full(gauges, -np.expm1(-options.sample_time / options.weights.offset_time_constant))


@dataclass(frozen=True, kw_only=True)
class ControlWeights:
    """Weights of filter and regulator at a sample time, in the states of the reduced model."""

    Q_o: Array  # (m, m), of the process noise
    R_o: Array  # (n_pm, n_pm), of the measurement noise
    Q_c: Array  # (m, m), of the states
    R_c: Array  # (n_u, n_u), of the voltages


def control_weights(reduced: ReducedModel, options: DesignOptions) -> ControlWeights:
    """The weights (46), (47), diagonal in balanced states, in the states of the reduced model.

    Process and measurement noise are densities: over a sample of length T the first grows to Q T, the second falls
    to R / T. The regulator's cost is an integral, whose weights all scale with T.
    """
    weights, k, ratio = options.weights, reduced.position_states, sample_ratio(options)
    sigma = reduced.hankel_position[:k], reduced.hankel_velocity[:k]
    rotation = reduced.rotation
    Q_o = hankel_weights(
        *sigma, total=weights.kalman_q_total, position=weights.kalman_q_position, velocity=weights.kalman_q_velocity
    )
    Q_c = hankel_weights(
        *sigma, total=weights.lqr_q_total, position=weights.lqr_q_position, velocity=weights.lqr_q_velocity
    )
    return ControlWeights(
        Q_o=rotation.T @ np.diag(Q_o * ratio) @ rotation,
        R_o=weights.kalman_measurement / ratio * np.eye(len(reduced.H_pm)),
        Q_c=rotation.T @ np.diag(Q_c) @ rotation,
        R_c=weights.lqr_input * np.eye(reduced.B.shape[1]),
    )


def control_arrays(reduced: ReducedModel, options: DesignOptions) -> dict[str, Array]:
    """A_d, B_d (41), estimator_gain of (42), (46) and feedback_gain of (44), (47)."""
    weights = control_weights(reduced, options)
    A_d, B_d = discretise(reduced.A, reduced.B, options.sample_time)
    return {
        "A_d": A_d,
        "B_d": B_d,
        "estimator_gain": predictor_gain(A_d, reduced.H_pm, weights.Q_o, weights.R_o),
        "feedback_gain": lqr_gain(A_d, B_d, weights.Q_c, weights.R_c),
    }
