"""BeamPlant in Python: exact steps of the Galerkin model, in the modal form of its energy coordinates."""

from __future__ import annotations

import math

import numpy as np

from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit
from flexbeams.plant.assembly import Term, assemble
from flexbeams.plant.energy import EnergyForm, discretise, energy_form
from flexbeams.plant.errors import DesignError
from flexbeams.plant.modal_form import ModalForm, modal_form

# Condition number of an eigenvalue above which the matrix exponential takes the place of the modal form
LARGEST_CONDITION = 100.0
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
    """M q'' + D q' + K q = L u + F force, inputs held over the step.

    The state z has x = (R_K' q, R_M' q') = Re(V z), of the modal form or, where its condition is too large, V = 1.
    """

    def setup(self) -> None:
        """Views of the variables."""
        self._u = self.view("u")
        self._inputs = self.values[self.span("u").start : self.span("force").stop]
        # y_pi, y_pm and w are contiguous, so one product fills them
        self._observed = self.values[self.span("y_pi").start : self.span("w").stop]
        self._y_pm = self.view("y_pm")
        self._energy, self._noise_std = self.view("energy"), self.view("strain_noise_std")
        self._z = self.state_array("z", 2 * int(self.meta["size"]), np.complex128)
        self._terms = [
            Term(parameter=name, matrix=matrix, start=start, column=column, block=self.data[f"term_{k}"])
            for k, (name, matrix, start, column) in enumerate(self.meta["terms"])
        ]
        self._built: bytes = b""

    def initialise(self) -> None:
        """At rest under the given voltages."""
        self._build()
        form, n = self._form, int(self.meta["size"])
        x = np.zeros(2 * n)
        x[:n] = np.linalg.solve(
            form.position.T @ self._K @ form.position, form.position.T @ (self._L @ self.view("start_at_rest_under"))
        )
        self._z[:] = 0.0
        self._z[: self._count] = x if self._modal is None else self._modal.W @ x
        self._write_outputs(0.0)

    def restore(self) -> None:
        """Compute the matrices for the restored parameters."""
        self._build()

    def advance(self, time: float, step: float) -> None:
        """Exact for any step; what depends on its length is computed where it differs from the last one."""
        if step != self._step:
            self._prepare(step)
        z = self._z[: self._count]
        if self._modal is None:
            z += self._A_d_less_one @ z + self._B_d @ self._inputs
        else:
            z += self._growth * z + self._hold * (self._driven @ self._inputs)
        self._write_outputs(time + step)

    def _prepare(self, step: float) -> None:
        """Compute the matrices or the functions of the eigenvalues for a step, s."""
        if self._modal is None:
            A_d, self._B_d = discretise(self._form.A, self._form.B, step)
            self._A_d_less_one = A_d - np.eye(len(A_d))
        else:
            self._growth, self._hold = self._modal.step_functions(step)
        self._step = step

    def _write_outputs(self, time: float) -> None:
        results = self._results @ self._z[: self._count].view(np.float64)
        count = len(self._observed)
        self._observed[:] = results[:count]
        x = results[count:]
        self._energy[0] = 0.5 * (x @ x)
        if self._noise_std[0] > 0:
            seed = int(self.view("noise_seed")[0])
            period = self.meta["sample_time"]
            tick = math.floor((time + self.clock.tolerance(time, period)) / period)
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
        self._diagonalise(self._form)
        self._built = key

    def _diagonalise(self, form: EnergyForm) -> None:
        """Compute the modal form, where there is one, and the rows that give y_pi, y_pm, w and x."""
        modal = modal_form(form.A)
        self._modal: ModalForm | None = None
        V = np.eye(len(form.A), dtype=np.complex128)
        if modal.condition <= LARGEST_CONDITION:
            self._modal, V = modal, modal.V
            self._driven = modal.W @ form.B
        self._count = V.shape[1]
        rows = np.vstack([form.outputs(self.data["outputs"]) @ V, V])
        self._results = np.empty((len(rows), 2 * self._count))  # of real and imaginary parts in turn
        self._results[:, 0::2], self._results[:, 1::2] = rows.real, -rows.imag
        self._step = 0.0

    def physical_parameters(self) -> dict[str, float]:
        """The parameters by name; UnitError for one that is physically impossible."""
        values = {name: float(self.values[k]) for name, k in self.meta["parameters"].items()}
        for name, value in values.items():
            if value <= 0 and name not in self.meta["may_vanish"]:
                raise UnitError(f"{name} must be finite and > 0, got {value!r}")
        return values
