"""Frames of an animation: the deflected beams with the voltages, read at regular steps of a run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import InstanceDeclaration, element_names

if TYPE_CHECKING:
    from flexbeams.scenarios.simulation.instance import UnitInstance

MAX_RATE = 50  # frames for each simulated second at most
MAX_FRAMES = 3000  # frames of a run at most; a longer run has them at wider intervals


@dataclass(frozen=True, kw_only=True)
class FrameLayout:
    """A frame: the plant's w, read by one call of fmi2GetReal, then values copied from the array of signals."""

    plant: str  # instance
    stations: list[str]  # its w[j,i], beam after beam, each from the clamp to the tip
    voltages: list[int]  # indices of the plant's u
    reference: list[int]  # indices of the feedforward's x_ref; empty without a feedforward
    feedforward: list[int]  # indices of its u_ff

    @property
    def indices(self) -> list[int]:
        """Indices of all values that follow the deflections."""
        return [*self.voltages, *self.reference, *self.feedforward]


@dataclass(kw_only=True)
class Frames:
    """Recorded frames: row k is of step k * every."""

    layout: FrameLayout
    every: int  # steps between frames
    values: Array  # (frames, stations + indices)

    @property
    def deflections(self) -> Array:
        """Deflections w (frames, r * STATIONS), m."""
        return self.values[:, : len(self.layout.stations)]

    @property
    def voltages(self) -> Array:
        """The plant's u (frames, n_u), V."""
        return self._part(0, len(self.layout.voltages))

    @property
    def reference(self) -> tuple[Array, Array]:
        """The feedforward's x_ref (frames, m) and u_ff (frames, n_u); both of width 0 without one."""
        first, middle = len(self.layout.voltages), len(self.layout.voltages) + len(self.layout.reference)
        return self._part(first, middle), self._part(middle, middle + len(self.layout.feedforward))

    def _part(self, start: int, stop: int) -> Array:
        offset = len(self.layout.stations)
        return self.values[:, offset + start : offset + stop]


def frame_layout(
    declarations: Mapping[str, InstanceDeclaration],
    sources: Mapping[str, int],
    inputs: Mapping[str, list[tuple[str, int]]],
) -> FrameLayout | None:
    """Frames of the first unit with deflections, and of the first with a reference; None without deflections.

    Indices as in Wiring.
    """
    kinds = {name: declaration.kind for name, declaration in declarations.items() if declaration.kind is not None}
    plant = next((name for name, kind in kinds.items() if kind.animated), None)
    leader = next((name for name, kind in kinds.items() if kind.reference), None)
    if plant is None or (animated := kinds[plant].animated) is None:
        return None
    variables, driven = declarations[plant].variables, dict(inputs[plant])

    def outputs(array: str) -> list[int]:
        names = element_names(declarations[leader].variables, array) if leader else []
        return [sources[f"{leader}.{n}"] for n in names]

    states, voltages = (kinds[leader].reference if leader else None) or ("", "")

    return FrameLayout(
        plant=plant,
        stations=element_names(variables, animated[0]),
        voltages=[driven[n] for n in element_names(variables, animated[1])],
        reference=outputs(states),
        feedforward=outputs(voltages),
    )


def frame_interval(steps: int, step: float) -> int:
    """Steps between frames, at most MAX_RATE frames for each second and MAX_FRAMES in all."""
    return max(1, int(np.ceil(1 / (MAX_RATE * step) - 1e-9)), -(-steps // (MAX_FRAMES - 1)))


class FrameRecorder:
    """Takes frames while a run steps; `due` is the next step to take one at, -1 where no frames are recorded."""

    def __init__(
        self, layout: FrameLayout | None, instances: Mapping[str, "UnitInstance"], steps: int, step: float
    ) -> None:
        self._layout, self._count, self.due = layout, 0, -1
        if layout is None:
            return
        self._every = frame_interval(steps, step)
        self._indices = np.array(layout.indices, dtype=np.intp)
        self._rows = np.empty((steps // self._every + 1, len(layout.stations) + len(self._indices)))
        self._read = instances[layout.plant].reader(layout.stations)
        self.due = 0

    def take(self, signals: Array) -> None:
        """The frame of step `due`, from the plant and the array of signals at the start of that step."""
        assert self._layout is not None
        row = self._rows[self._count]
        self._read(row)
        np.take(signals, self._indices, out=row[len(self._layout.stations) :])
        self._count += 1
        self.due += self._every

    def rewind(self, number: int) -> None:
        """Goes on at step `number`; frames of later steps are taken again."""
        if self._layout is not None:
            self._count = -(-number // self._every)
            self.due = self._count * self._every

    def taken(self) -> Frames | None:
        """The frames so far."""
        if self._layout is None:
            return None
        return Frames(layout=self._layout, every=self._every, values=self._rows[: self._count])
