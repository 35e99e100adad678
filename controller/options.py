"""Options of a design and the weights of filter and regulator; the defaults are the paper's where it gives one."""

from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from flexbeams.controller.choices import OutputWeight, PlannerName
from flexbeams.controller.transition import LOWEST_ORDER
from flexbeams.controller.voltage_limits import VoltageLimits
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import DEFAULT_ORDER
from flexbeams.plant.validation import STRICT, Index, NonNegative, Positive

NonPositive = Annotated[float, Field(le=0, strict=True, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Weights:
    """Weights (46), (47) of filter and regulator; the defaults are the published ones.

    Those of the filter are covariances of one sample of 0.2 ms; other sample times convert them as noise densities.
    The last two are of the offset-free observer.
    """

    kalman_measurement: Positive = 20.0  # R_o / I, strain^2 in SI
    kalman_q_total: Positive = 50.0
    kalman_q_position: Positive = 5e3
    kalman_q_velocity: Positive = 10.0
    lqr_input: Positive = 0.01  # R_c / I
    lqr_q_total: Positive = 200.0
    lqr_q_position: Positive = 10.0
    lqr_q_velocity: NonNegative = 1e-3
    offset_time_constant: Positive = 0.2  # s, of the offset-free observer's strain offsets
    offset_strain_noise: Positive = 1e-8  # m/m, standard deviation of the strain offsets that errors have to exceed


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class DesignOptions:
    """What a designer chooses; only the static correction departs from the paper by default."""

    basis: BasisName = "clamped_free"
    order: Index | None = None  # modes of a beam, or polynomial degree; default 10 or 9
    reduced_modes: Index = 5  # N_r: position and velocity states retained of each beam
    output_weight: OutputWeight | None = None  # default: identity for clamped_free, energy for segment
    static_correction: Annotated[bool, Field(strict=True)] = True  # direct terms that carry the truncated modes at rest
    static_maps: Annotated[str, Field(min_length=1)] = "basis"  # statics of the "basis", of "segment", or a CSV file
    observer: Literal["paper", "offset_free"] = "paper"
    # relative half widths, such as {"patch[].piezo_ratio" = 0.1}, for offset_free; default: 0.1 for every parameter
    uncertainty: dict[str, NonNegative] | None = None
    static_gain: Literal["full", "reduced"] = "full"  # which DC gain turns a target into the flat output
    # a target that no voltages reach is refused, or replaced by the "nearest" one (least sum of squares)
    targets: Literal["reachable", "nearest"] = "reachable"
    planner: PlannerName = "paper"  # "multi_input": transitions whose length does not grow with the number of beams
    sample_time: Positive = 2e-4  # s
    transition_time: Annotated[float, Field(ge=1e-3, le=1e4, strict=True)] = 0.9  # s, as the unit's bounds
    gevrey_order: Annotated[float, Field(ge=LOWEST_ORDER, lt=2, strict=True)] = 1.9
    voltage_limit: Positive = 1000.0  # V, of all magnitudes
    voltage_min: list[NonPositive] | None = None  # V, of each pair, where it is above -voltage_limit
    voltage_max: list[NonNegative] | None = None  # V, of each pair, where it is below voltage_limit
    # k_I of (45) a sample of 0.2 ms; default: 1e-4, but at most a third of the largest stable gain; offset-free: 0
    integral_gain: Annotated[float, Field(ge=0, strict=True, allow_inf_nan=False)] | None = None
    verify: Literal["exact", "design"] = "exact"  # plants on which the closed loop must be stable: also the exact one
    weights: Weights = field(default_factory=Weights)

    def __post_init__(self) -> None:
        if self.static_maps != "basis" and not self.static_correction:
            raise InputError("static_maps", "must be 'basis' without static_correction", self.static_maps)
        if self.observer == "offset_free" and not self.static_correction:
            raise InputError("observer", "must be 'paper' without static_correction", self.observer)

    def relative_to(self, folder: Path) -> "DesignOptions":
        """The options with a file of static maps as a path from anywhere."""
        if self.static_maps in ("basis", "segment"):
            return self
        return replace(self, static_maps=str(folder / self.static_maps))

    @property
    def basis_order(self) -> int:
        """Modes of a beam, or polynomial degree, with the default of the basis."""
        return DEFAULT_ORDER[self.basis] if self.order is None else self.order

    @property
    def balanced_norm(self) -> OutputWeight:
        """Output weight of the balanced truncation, with the default of the basis."""
        return self.output_weight or ("energy" if self.basis == "segment" else "identity")

    def voltage_limits(self, pairs: int) -> VoltageLimits:
        """The limits of each of so many pairs; DesignError for lists that have not one entry for each."""
        own = {"voltage_min": self.voltage_min, "voltage_max": self.voltage_max}
        for name, values in own.items():
            if values is not None and len(values) != pairs:
                raise DesignError(f"{name} must have {pairs} values, one for each patch pair, got {len(values)}")
        minimum = np.full(pairs, -np.inf) if self.voltage_min is None else np.array(self.voltage_min)
        maximum = np.full(pairs, np.inf) if self.voltage_max is None else np.array(self.voltage_max)
        return VoltageLimits.joined(self.voltage_limit, minimum, maximum)

    def limit_warnings(self) -> list[str]:
        """Lines about limits of a pair that are wider than that of all."""
        own = {"voltage_min": self.voltage_min or [], "voltage_max": self.voltage_max or []}
        return [
            f"{name}[{k}] = {value:g} V has no effect: voltage_limit is {self.voltage_limit:g} V"
            for name, values in own.items()
            for k, value in enumerate(values, 1)
            if abs(value) > self.voltage_limit
        ]
