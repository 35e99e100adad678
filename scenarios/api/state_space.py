"""Linear models with named signals, and their exports to python-control, scipy and pyMOR."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise
from flexbeams.plant.errors import InputError


@dataclass(frozen=True, kw_only=True)
class StateSpace:
    """x' = A x + B u, y = C x + D u, or x+ = A x + B u with a sample time `step` in s.

    Attributes
    ----------
    A, B, C, D
        Matrices (n, n), (n, m), (p, n), (p, m).
    inputs, outputs
        Names of the signals, such as `u[1]` (V), `force[1]` (N), `y_pi[1]` (m), `y_pm[1]` (1).
    """

    name: str
    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    step: float | None = None

    def sampled(self, step: float) -> Self:
        """The model for inputs held over `step` s, exact. Raises InputError for a model of another sample time."""
        if self.step is not None:
            if self.step == step:
                return self
            raise InputError("dt", f"must be the sample time of the {self.name}, {self.step:g} s", step)
        if not 0 < step < np.inf:
            raise InputError("dt", "must be finite and > 0", step)
        A, B = discretise(self.A, self.B, step)
        return replace(self, A=A, B=B, step=step)

    def to_control(self, dt: float | None = None) -> Any:
        """A `control.StateSpace` with the names of the signals; sampled where a sample time `dt` in s is given."""
        import control

        model = self if dt is None else self.sampled(dt)
        time = 0 if model.step is None else model.step
        return control.ss(
            model.A, model.B, model.C, model.D, time, name=self.name, inputs=self.inputs, outputs=self.outputs
        )

    def to_scipy(self, dt: float | None = None) -> Any:
        """A `scipy.signal.StateSpace`; sampled where a sample time `dt` in s is given."""
        from scipy.signal import StateSpace as ScipyStateSpace

        model = self if dt is None else self.sampled(dt)
        matrices = (model.A, model.B, model.C, model.D)
        return ScipyStateSpace(*matrices) if model.step is None else ScipyStateSpace(*matrices, dt=model.step)

    def to_pymor(self, dt: float | None = None) -> Any:
        """A `pymor.models.iosys.LTIModel`; sampled where a sample time `dt` in s is given."""
        from pymor.models.iosys import LTIModel

        model = self if dt is None else self.sampled(dt)
        return LTIModel.from_matrices(model.A, model.B, model.C, model.D, sampling_time=model.step or 0)


def numbered(array: str, count: int) -> tuple[str, ...]:
    """Names of the elements of an array: u[1], u[2] ..."""
    return tuple(f"{array}[{k}]" for k in range(1, count + 1))
