"""The section `actuator` of a structure file: amplifier, and hysteresis and creep of each patch pair."""

from collections.abc import Sequence
from dataclasses import field

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from flexbeams.plant.actuator.operators import Operators, Reals, broken_rule, with_linear_part
from flexbeams.plant.errors import InputError
from flexbeams.plant.validation import STRICT, Finite, NonNegative, Positive

EXTREMES = 4  # voltages of a history that units have at least


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class PatchPairActuator:
    """Hysteresis and creep of a patch pair between voltage and effective voltage."""

    linear_weight: Positive  # 1
    play_thresholds: list[NonNegative] = field(default_factory=list)  # V, ascending
    play_weights: list[NonNegative] = field(default_factory=list)  # 1
    dead_zone_thresholds: list[Finite] = field(default_factory=list)  # V, ascending
    dead_zone_slopes: list[Finite] = field(default_factory=list)  # 1
    creep_times: list[Positive] = field(default_factory=list)  # s
    creep_weights: list[NonNegative] = field(default_factory=list)  # 1
    history: list[Finite] = field(default_factory=list)  # V, extremes since the demagnetised state; none: that state

    def __post_init__(self) -> None:
        for first, second in (
            ("play_thresholds", "play_weights"),
            ("dead_zone_thresholds", "dead_zone_slopes"),
            ("creep_times", "creep_weights"),
        ):
            count, other = len(getattr(self, first)), len(getattr(self, second))
            if count != other:
                raise InputError(second, f"must have as many entries as {first}, {count}", other)
        keys = {
            "play_threshold": "play_thresholds",
            "play_weight": "play_weights",
            "dead_zone_threshold": "dead_zone_thresholds",
            "dead_zone_slope": "dead_zone_slopes",
        }
        if rule := broken_rule(operators([self]), lambda key, _, j: f"{keys[key]}[{j + 1}]"):
            key, _, text = rule.partition(" ")
            raise InputError(key, text)


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Actuator:
    """Amplifier and patch pairs between a controller's voltages and those that act on the beams."""

    face_minimum: Finite  # lowest voltage of a patch face, V
    face_maximum: Finite  # highest voltage of a patch face, V
    supply: Finite  # V: the faces of a pair get supply + u and supply - u
    lag: NonNegative = 0.0  # time constant of the amplifier, s; 0: none
    slew_rate: NonNegative = 0.0  # V/s; 0: no limit
    resolution: NonNegative = 0.0  # V; 0: none
    pair: list[PatchPairActuator] = Field(min_length=1)  # in the order of the patch pairs

    def __post_init__(self) -> None:
        if not self.face_minimum < self.supply < self.face_maximum:
            raise InputError("supply", "must be between face_minimum and face_maximum", self.supply)


def operators(pairs: Sequence[PatchPairActuator]) -> Operators:
    """The operators of patch pairs, (pairs, n): shorter lists are filled up with operators that do nothing."""
    return Operators(
        play_threshold=with_linear_part(0.0, _rows([p.play_thresholds for p in pairs], 0.0)),
        play_weight=with_linear_part(
            np.array([p.linear_weight for p in pairs]), _rows([p.play_weights for p in pairs], 0.0, repeat=False)
        ),
        dead_zone_threshold=_rows([p.dead_zone_thresholds for p in pairs], 0.0),
        dead_zone_slope=_rows([p.dead_zone_slopes for p in pairs], 0.0, repeat=False),
        creep_time=_rows([p.creep_times for p in pairs], 1.0),
        creep_weight=_rows([p.creep_weights for p in pairs], 0.0, repeat=False),
    )


def histories(pairs: Sequence[PatchPairActuator]) -> Reals:
    """Voltages (pairs, k) of the histories, k >= EXTREMES, the last one repeated."""
    rows = _rows([p.history for p in pairs], 0.0)
    return np.pad(rows, ((0, 0), (0, max(EXTREMES - rows.shape[1], 0))), mode="edge")


def _rows(lists: Sequence[Sequence[float]], empty: float, repeat: bool = True) -> Reals:
    """Lists as rows of one length >= 1, filled with their last entry (or `empty`)."""
    width = max(1, *(len(values) for values in lists))
    rows = np.full((len(lists), width), empty)
    for row, values in zip(rows, lists, strict=True):
        row[: len(values)] = values
        if values and repeat:
            row[len(values) :] = values[-1]
    return rows
