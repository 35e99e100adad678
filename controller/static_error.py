"""Where a design ends on plants whose parameters differ from its own: the statics of the loop, by Monte Carlo."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.observer import tick_matrices
from flexbeams.controller.offsets import uncertainty_of
from flexbeams.controller.statics import statics_of
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import static_gains

SAMPLES = 200
SEED = 1


@dataclass(frozen=True, kw_only=True)
class StaticErrors:
    """Largest |y_i - y_i*| over the points of interest at rest, m, on each of the random plants (samples,)."""

    feedforward: Array  # the feedforward alone
    loop: Array  # with the controller
    targets: Array  # (targets, n_pi), m; of several the largest error counts
    uncertainty: Mapping[str, float]  # relative half width of each parameter

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types: [median, 95 %, largest] in m."""
        return {
            "targets": self.targets.tolist(),
            "samples": len(self.loop),
            "feedforward": _quantiles(self.feedforward),
            "loop": _quantiles(self.loop),
            "loop_better": float(np.mean(self.loop <= self.feedforward)),
        }


def static_errors(
    design: Design, model: BeamModel | None = None, targets: Array | None = None, samples: int = SAMPLES
) -> StaticErrors:
    """Errors at rest over uniformly distributed parameters within the declared uncertainty, by default +-10 % of all.

    `model` gives the plants, by default that of the design's static maps. `targets` (k, n_pi) are by default what half
    the voltage limit on each pair reaches.
    """
    nominal = statics_of(design.model(), design.options)
    truth = model or nominal.model
    structure = design.structure
    uncertainty = uncertainty_of(list(structure.parameters()), design.options.uncertainty)
    if targets is None:
        targets = 0.5 * design.options.voltage_limit * nominal.deflection.T
    voltages = np.asarray(targets) @ design.arrays["static_inverse"].T  # (k, n_u)
    loop = StaticLoop.of(design)
    errors = []
    for parameters in random_parameters(structure.parameters(), uncertainty, samples):
        deflection, strain = static_gains(truth, truth.assemble(parameters))
        ends = [np.max(np.abs(u @ deflection.T - targets)) for u in (voltages, loop.voltages(strain, voltages))]
        errors.append(ends)
    feedforward, controlled = np.array(errors).T
    return StaticErrors(feedforward=feedforward, loop=controlled, targets=targets, uncertainty=uncertainty)


def random_parameters(
    values: Mapping[str, float], uncertainty: Mapping[str, float], samples: int, seed: int = SEED
) -> Iterator[dict[str, float]]:
    """Parameters uniformly distributed within value (1 +- uncertainty), the same for equal seeds."""
    generator = np.random.default_rng(seed)
    names = list(uncertainty)
    for _ in range(samples):
        factors = 1 + np.array([uncertainty[name] for name in names]) * generator.uniform(-1, 1, len(names))
        yield {name: values[name] * float(factor) for name, factor in zip(names, factors, strict=True)}


@dataclass(frozen=True, kw_only=True)
class StaticLoop:
    """The controller at rest: voltages u with M u = M_ff u_ff for a plant whose strains at rest are y_pm = G_pm u."""

    constant: Array  # (rows, unknowns): of the estimate, the integral's coordinates and the voltages
    by_strain: Array  # (rows, n_pm): effect of y_pm on the rows
    by_feedforward: Array  # (rows, n_u)
    voltage_count: int

    @classmethod
    def of(cls, design: Design) -> "StaticLoop":
        """The equations of a tick (42), (44), (45) at rest, the integral within the range of G_0^+ [H_pi, D_pi]."""
        arrays = design.arrays
        tick = tick_matrices(arrays)
        s, n_u, n_pm = len(tick.filter), len(tick.regulator) // 2, arrays["estimator_gain"].shape[1]
        F_z, F_u, F_y = np.split(tick.filter, [s, s + n_u], axis=1)
        K, growth = tick.regulator[:n_u, :s], tick.regulator[n_u:]
        reference = np.zeros((s, n_u))
        reference[: len(arrays["A"])] = -np.linalg.solve(arrays["A"], arrays["B"])
        basis = np.zeros((n_u, 0))
        if design.integral_gain > 0:
            U, sigma, _ = np.linalg.svd(growth)
            basis = U[:, sigma > 1e-9 * max(sigma[0], np.finfo(float).tiny)]
        k = basis.shape[1]
        constant = np.block(
            [
                [np.eye(s) - F_z, np.zeros((s, k)), -F_u],
                [K, -basis, np.eye(n_u)],
                [basis.T @ growth[:, :s], np.zeros((k, k)), basis.T @ growth[:, s:]],
            ]
        )
        return cls(
            constant=constant,
            by_strain=np.vstack([F_y, np.zeros((n_u + k, n_pm))]),
            by_feedforward=np.vstack(
                [np.zeros((s, n_u)), np.eye(n_u) + K @ reference, basis.T @ (growth[:, :s] @ reference + growth[:, s:])]
            ),
            voltage_count=n_u,
        )

    def voltages(self, strain: Array, feedforward: Array) -> Array:
        """Voltages at rest (k, n_u) for static strains `strain` (n_pm, n_u) and feedforward voltages (k, n_u)."""
        matrix = self.constant.copy()
        matrix[:, -self.voltage_count :] -= self.by_strain @ strain
        solution = np.linalg.solve(matrix, self.by_feedforward @ feedforward.T)
        return np.asarray(solution[-self.voltage_count :].T, dtype=np.float64)


def _quantiles(values: Array) -> list[float]:
    return [float(v) for v in (np.median(values), np.quantile(values, 0.95), np.max(values))]
