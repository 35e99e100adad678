"""BeamPlant in Python: the exact discretisation of the Galerkin model in energy coordinates."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit
from flexbeams.plant.assembly import Term, assemble
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.errors import DesignError

_MASK = 2**64 - 1


def splitmix64(key: int) -> int:
    """The 64-bit finaliser of SplitMix64 (Steele, Lea and Flood 2014)."""
    key = ((key ^ (key >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    key = ((key ^ (key >> 27)) * 0x94D049BB133111EB) & _MASK
    return key ^ (key >> 31)


def normal_number(seed: int, tick: int, channel: int) -> float:
    """A standard normal number for a seed, sample and channel: order and step size do not matter (Box-Muller)."""
    key = splitmix64((splitmix64((splitmix64((seed + 0x9E3779B97F4A7C15) & _MASK) + tick) & _MASK) + channel) & _MASK)
    first = ((key >> 11) + 0.5) / 2**53
    second = (splitmix64((key + 0x9E3779B97F4A7C15) & _MASK) >> 11) / 2**53
    return math.sqrt(-2 * math.log(first)) * math.cos(2 * math.pi * second)


class BeamPlant(Unit):
    """M q'' + D q' + K q = L u + F force, inputs held over the step."""

    def setup(self) -> None:
        """Views of the variables; the state is x = (R_K' q, R_M' q')."""
        self._u = self.view("u")
        self._inputs = self.values[self.span("u").start : self.span("force").stop]
        # y_pi, y_pm and w are contiguous, so one product fills them
        self._observed = self.values[self.span("y_pi").start : self.span("w").stop]
        self._y_pm = self.view("y_pm")
        self._energy, self._noise_std = self.view("energy"), self.view("strain_noise_std")
        self._x = self.state_array("x", 2 * int(self.meta["size"]))
        self._q = self._x[: len(self._x) // 2]
        self._terms = [
            Term(parameter=name, matrix=matrix, start=start, column=column, block=self.data[f"term_{k}"])
            for k, (name, matrix, start, column) in enumerate(self.meta["terms"])
        ]
        self._built: bytes = b""
        self._steps: dict[float, NDArray[np.float64]] = {}

    def initialise(self) -> None:
        """At rest under the given voltages."""
        self._build()
        n = len(self._x) // 2
        self._x[:n] = np.linalg.solve(
            self._form.position.T @ self._K @ self._form.position,
            self._form.position.T @ (self._L @ self.view("start_at_rest_under")),
        )
        self._x[n:] = 0.0
        self._write_outputs(self.values[0])

    def restore(self) -> None:
        """Compute the matrices for the restored parameters."""
        self._build()

    def advance(self, time: float, step: float) -> None:
        """x_{k+1} = A_d x_k + B_d (u, force), exact for any step."""
        transition = self._steps.get(step)
        if transition is None:
            if len(self._steps) > 64:
                self._steps.clear()
            transition = self._steps[step] = np.hstack(discretise(self._form.A, self._form.B, step))
        self._x[:] = transition @ np.concatenate((self._x, self._inputs))
        self._write_outputs(time + step)

    def _write_outputs(self, time: float) -> None:
        self._observed[:] = self._outputs @ self._q
        self._energy[0] = 0.5 * (self._x @ self._x)
        if self._noise_std[0] > 0:
            seed = int(self.view("noise_seed")[0])
            tick = math.floor(time / self.meta["sample_time"] + 1e-6)
            self._y_pm += self._noise_std[0] * np.array([normal_number(seed, tick, k) for k in range(len(self._y_pm))])

    def _build(self) -> None:
        """Compute the matrices where the parameters have changed."""
        parameters = self.physical_parameters()
        if (key := np.array(list(parameters.values())).tobytes()) == self._built:
            return
        system = assemble(self._terms, parameters, self.data["tips"], len(self._u))
        try:
            self._form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
        except DesignError as error:
            raise UnitError(str(error)) from None
        self._K, self._L = system.K, system.L
        self._outputs = self.data["outputs"] @ self._form.position
        self._steps.clear()
        self._built = key

    def physical_parameters(self) -> dict[str, float]:
        """The parameters by name; UnitError for one that is physically impossible."""
        values = {name: float(self.values[k]) for name, k in self.meta["parameters"].items()}
        for name, value in values.items():
            if value <= 0 and name not in self.meta["may_vanish"]:
                raise UnitError(f"{name} must be finite and > 0, got {value!r}")
        return values
