"""Voltages and states of the reduced model over a motion, for either kind of transition."""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from flexbeams.controller.flat_output import FlatParameterisation
from flexbeams.controller.planner import Curves, InputShapes, PendingTransitions
from flexbeams.controller.spline_transitions import SplineCourse, SplineTransitions
from flexbeams.controller.transition import Transition
from flexbeams.plant.basis import Array


class MotionModel(Protocol):
    """What a motion is made of."""

    @property
    def curves(self) -> Curves:
        """The voltages that the planner looks at."""

    def references(self, motion: PendingTransitions, time: float) -> tuple[Array, Array]:
        """Voltages (n_u,) and state (m,) at `time` (s)."""


def motion_model(arrays: Mapping[str, Array]) -> MotionModel:
    """The model in a design's or a unit's arrays."""
    return SplineModel(arrays) if "spline_times" in arrays else FlatModel(arrays)


class FlatModel:
    """The paper's: the flat output xi = offset + sum_k changes_k Theta((t - starts_k) / T_k)."""

    def __init__(self, arrays: Mapping[str, Array]) -> None:
        exponent, norm = arrays["transition_constants"].tolist()
        self._transition = Transition(exponent=exponent, norm=norm, table=arrays["transition_table"])
        self._flat = FlatParameterisation.of(arrays)
        self.curves = InputShapes(times=arrays["shape_times"], values=arrays["shape_values"])

    def references(self, motion: PendingTransitions, time: float) -> tuple[Array, Array]:
        """Voltages and state by power series."""
        voltages, amplitudes = motion.offset.copy(), self._flat.complex_inputs @ motion.offset
        for start, duration, change in zip(
            motion.starts.tolist(), motion.durations.tolist(), motion.changes, strict=True
        ):
            terms = self._flat.terms(self._transition, min(max((time - start) / duration, 0.0), 1.0), duration)
            voltages += np.sum(terms) * change
            amplitudes += self._flat.amplitudes(terms, change)
        return voltages, self._flat.state(amplitudes)


class SplineModel:
    """Splines of all voltages."""

    def __init__(self, arrays: Mapping[str, Array]) -> None:
        self.curves = SplineTransitions.of(arrays)
        self._courses: dict[tuple[float, bytes], SplineCourse] = {}  # of the latest motion

    def references(self, motion: PendingTransitions, time: float) -> tuple[Array, Array]:
        """Voltages and state by the exact solution of each span."""
        tables, courses = self.curves, self._courses
        voltages, amplitudes = motion.offset.copy(), tables.amplitudes_at_rest(motion.offset)
        keys = [(d, c.tobytes()) for d, c in zip(motion.durations.tolist(), motion.changes, strict=True)]
        self._courses = {
            key: courses.get(key) or SplineCourse(tables, key[0], change)
            for key, change in zip(keys, motion.changes, strict=True)
        }
        for key, start in zip(keys, motion.starts.tolist(), strict=True):
            u, y = self._courses[key].at(min(max((time - start) / key[0], 0.0), 1.0))
            voltages += u
            amplitudes += y
        return voltages, tables.state(amplitudes)
