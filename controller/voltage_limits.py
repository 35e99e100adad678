"""Limits of the voltages of each pair, and what breaks them furthest."""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array


@dataclass(frozen=True, kw_only=True)
class Violation:
    """The voltage that is furthest beyond a limit."""

    excess: float  # V; not above 0 where all are within
    pair: int  # index
    voltage: float  # V
    is_below: bool  # it is a lowest voltage


@dataclass(frozen=True, kw_only=True)
class VoltageLimits:
    """The lowest and the highest voltage of each pair."""

    lowest: Array  # (n_u,), V, <= 0
    highest: Array  # (n_u,), V, >= 0

    @classmethod
    def symmetric(cls, limit: float, pairs: int) -> "VoltageLimits":
        """One limit (V) of all magnitudes."""
        return cls(lowest=np.full(pairs, -limit), highest=np.full(pairs, limit))

    @classmethod
    def joined(cls, limit: float, minimum: Array, maximum: Array) -> "VoltageLimits":
        """What a limit of all magnitudes (V) and each pair's own limits (n_u,) leave."""
        return cls(lowest=np.maximum(minimum, -limit), highest=np.minimum(maximum, limit))

    @property
    def largest(self) -> float:
        """Largest magnitude, V."""
        return float(max(np.max(np.abs(self.lowest)), np.max(np.abs(self.highest))))

    def containing(self, u: Array) -> "VoltageLimits":
        """Limits that are as wide, and wide enough for voltages u (n_u,)."""
        return VoltageLimits(lowest=np.minimum(u, self.lowest), highest=np.maximum(u, self.highest))

    def furthest_beyond(self, lowest: Array, highest: Array) -> Violation:
        """What is furthest beyond, of the lowest and highest voltages (n_u,) of each pair."""
        # in the order of the pairs, the highest first: of equals the first counts
        excess = np.column_stack([highest - self.highest, self.lowest - lowest]).ravel()
        worst = int(np.argmax(excess))
        pair, side = divmod(worst, 2)
        voltage = (highest, lowest)[side][pair]
        return Violation(excess=float(excess[worst]), pair=pair, voltage=float(voltage), is_below=side == 1)
