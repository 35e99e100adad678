"""Tuning of the weights: what a choice of weights is worth for a disturbance, on nominal and on uncertain plants.

Filter and regulator depend on ratios of the eight weights only: position and velocity weight of the filter over the
measurement noise, and of the regulator over the input weight. These four are varied, and the offset-free observer's
time constant, as powers of ten of the published values.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from flexbeams.controller.closed_loop import SampledController, sampled_controller
from flexbeams.controller.computation import reduced_with
from flexbeams.controller.design import Design
from flexbeams.controller.gains import control_arrays, offset_gain
from flexbeams.controller.modal_loop import DisturbedPlant, ModalLoop, Response
from flexbeams.controller.offsets import uncertainty_of
from flexbeams.controller.options import Weights
from flexbeams.controller.static_error import random_parameters
from flexbeams.controller.verification import models_of
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.measures import decay_time

# Decades by which a weight may differ from the published one
RANGES = {
    "kalman_q_position": (-3.0, 4.0),
    "kalman_q_velocity": (-3.0, 5.0),
    "lqr_q_position": (-3.0, 4.0),
    "lqr_q_velocity": (-3.0, 6.0),
}
OFFSET_RANGE = (-1.0, 1.0)
OPEN_LOOP_TIME = 4.0  # of the scenario's stop time: the open loop takes longer
LEAST_DECAY = 1e-3  # 1/s: slower poles count as unstable


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Uncertainty and limits that a choice of weights has to meet."""

    uncertainty: float = 0.1  # relative half width of every parameter of the random plants
    plants: int = 6  # random plants
    seed: int = 1
    strain_noise: float = 2e-7  # m/m rms a sample
    disk_margin: float = 0.8
    voltage_limit: float = 1000.0  # V


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A choice of weights and its figures; NaN where the loop is unstable on some plant."""

    weights: Mapping[str, float]
    decay: float  # s, on the scenario's plant
    worst_decay: float  # s, on all plants
    peak_voltage: float  # V, on all plants
    noise_voltage: float  # V rms, of the noisiest pair
    disk_margin: float  # smaller one of the design's own plant and the exact one
    violation: float  # 0 where all requirements hold

    @property
    def feasible(self) -> bool:
        """Whether all requirements hold."""
        return self.violation == 0.0

    def texts(self, open_decay: float) -> list[str]:
        """Decay, that of the open loop over it, worst decay, voltage, noise and disk margin for a table."""
        return [
            f"{self.decay:.3f}",
            f"{open_decay / self.decay:.1f}",
            f"{self.worst_decay:.3f}",
            f"{self.peak_voltage:.0f}",
            f"{self.noise_voltage:.4f}",
            f"{self.disk_margin:.3f}",
        ]

    def figures(self) -> dict[str, Any]:
        """In JSON's types."""
        return asdict(self)


class TuningProblem:
    """The loops of a design with other weights, under a disturbance.

    model, parameters: the scenario's plant; forces (k, r), N, a row a sample.
    """

    def __init__(
        self,
        design: Design,
        model: BeamModel,
        parameters: Mapping[str, float],
        forces: Array,
        stop: float,
        requirements: Requirements,
    ) -> None:
        self.design, self.requirements = design, requirements
        self._forces, self._stop = forces, stop
        options, own = design.options, design.model()
        step = options.sample_time
        self._reduced = reduced_with(own, own.assemble(), options, options.reduced_modes)
        self.plant = DisturbedPlant.of(model, step, dict(parameters))
        self._verified = [DisturbedPlant.of(m, step) for m in models_of(own).values()]
        values = {**model.structure.parameters(), **parameters}
        widths = uncertainty_of(list(values), None)
        uncertain = dict.fromkeys(widths, requirements.uncertainty)
        self._random = [
            DisturbedPlant.of(model, step, random)
            for random in random_parameters(values, uncertain, requirements.plants, requirements.seed)
        ]
        self.open_loop = ModalLoop(self.plant, None).response(forces, OPEN_LOOP_TIME * stop)
        self.peak = float(np.max(np.abs(self.open_loop.y)))
        self.start = float(self.open_loop.time[0])
        self.open_decay = self._decay(self.open_loop)

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Decades around the published weights."""
        offset_free = self.design.options.observer == "offset_free"
        return [*RANGES.values(), *([OFFSET_RANGE] if offset_free else [])]

    def weights(self, decades: Sequence[float]) -> Weights:
        """Weights to three digits; all others are the published ones."""
        names = [*RANGES, "offset_time_constant"]
        factors = zip(names, decades, strict=False)
        published = Weights()
        return replace(published, **{name: float(f"{getattr(published, name) * 10**x:.3g}") for name, x in factors})

    def decades(self) -> list[float]:
        """Decades that stand for the design's own weights, within the bounds."""
        own, published = self.design.options.weights, Weights()

        def effective(weights: Weights) -> list[float]:
            filter_scale = weights.kalman_q_total / weights.kalman_measurement
            regulator_scale = weights.lqr_q_total / weights.lqr_input
            return [
                filter_scale * weights.kalman_q_position,
                filter_scale * weights.kalman_q_velocity,
                regulator_scale * weights.lqr_q_position,
                regulator_scale * max(weights.lqr_q_velocity, 1e-12),
                weights.offset_time_constant,
            ]

        ratios = np.log10(np.divide(effective(own), effective(published)))[: len(self.bounds)]
        return [float(np.clip(x, low, high)) for x, (low, high) in zip(ratios, self.bounds, strict=True)]

    def controller(self, weights: Weights) -> SampledController:
        """The sampled controller with other weights and the design's integral gain."""
        options = replace(self.design.options, weights=weights)
        arrays = {**self.design.arrays, **control_arrays(self._reduced, options)}
        if "offset_map" in arrays:
            arrays["offset_gain"] = offset_gain(options, len(arrays["H_pm"]))
        return sampled_controller(arrays, self.design.integral_gain)

    def evaluate(self, weights: Weights) -> Candidate:
        """Figures of a choice of weights."""
        chosen = {name: value for name, value in asdict(weights).items() if value != getattr(Weights(), name)}
        nothing = dict.fromkeys(("decay", "worst_decay", "peak_voltage", "noise_voltage", "disk_margin"), float("nan"))
        try:
            controller = self.controller(weights)
        except DesignError:
            return Candidate(weights=chosen, violation=1e3, **nothing)
        verified = [ModalLoop(plant, controller) for plant in self._verified]
        disturbed = [ModalLoop(plant, controller) for plant in (self.plant, *self._random)]
        growth = max(loop.growth for loop in (*verified, *disturbed))
        if not growth < -LEAST_DECAY:
            return Candidate(weights=chosen, violation=10 + float(np.log1p(max(growth, 0.0))), **nothing)
        responses = [loop.response(self._forces, self._stop) for loop in disturbed]
        decays = [self._decay(response) for response in responses]
        peak = max(float(np.max(np.abs(r.u))) for r in responses)
        margin = min(loop.disk_margin() for loop in verified)
        required = self.requirements
        violation = max(0.0, required.disk_margin - margin) + max(0.0, np.log(peak / required.voltage_limit))
        return Candidate(
            weights=chosen,
            decay=decays[0],
            worst_decay=max(decays),
            peak_voltage=peak,
            noise_voltage=required.strain_noise * float(np.max(disturbed[0].noise_gain())),
            disk_margin=margin,
            violation=float(violation),
        )

    def response(self, weights: Weights) -> Response:
        """The response on the scenario's plant."""
        return ModalLoop(self.plant, self.controller(weights)).response(self._forces, self._stop)

    def _decay(self, response: Response) -> float:
        """Time from the disturbance to the last deviation above 2 % of the open loop's peak, s."""
        return decay_time(response.time, response.y, np.zeros(response.y.shape[1]), self.start, self.peak)


def pareto_front(candidates: Sequence[Candidate]) -> list[Candidate]:
    """The feasible candidates that no other one beats in worst decay and noise, by ascending noise."""
    front: list[Candidate] = []
    for candidate in sorted((c for c in candidates if c.feasible), key=lambda c: (c.noise_voltage, c.worst_decay)):
        if not front or candidate.worst_decay < front[-1].worst_decay:
            front.append(candidate)
    return front
