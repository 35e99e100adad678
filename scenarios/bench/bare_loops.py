"""The arithmetic of the units without FMI: bare loops in C (native/bench.c) and recursions in numpy."""

import ctypes
import hashlib
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams import fmus
from flexbeams.controller.design import Design
from flexbeams.controller.transition import Transition, derivative_scales
from flexbeams.fmus.packaging.c_tables import panels
from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import BeamModel

_BENCH = Path(__file__).parent / "native"
_UNITS = Path(str(fmus.__file__)).parent / "native"
_SHARED = ("linear_algebra.c", "transition.c")


@dataclass(frozen=True, kw_only=True)
class Matrices:
    """What the loops of plant and controller multiply by."""

    transition: Array  # (n, n + inputs): [A_d, B_d] of the plant in energy coordinates
    outputs: Array  # (points + gauges, n / 2)
    filter: Array  # (states, states + voltages + gauges)
    regulator: Array  # (2 voltages, states + voltages)
    estimates: Array  # (points, states + voltages)
    gain: float  # of the integral, a sample
    limit: float  # V


def matrices_of(design: Design, model: BeamModel) -> Matrices:
    """The matrices of a design and its plant over a step of the design's sample time."""
    system, a = model.assemble(), design.arrays
    form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
    gain, seen = a["estimator_gain"], np.hstack([a["H_pi"], a["D_pi"]])
    voltages = len(a["feedback_gain"])
    return Matrices(
        transition=np.hstack(discretise(form.A, form.B, design.options.sample_time)),
        outputs=np.vstack([model.deflection, model.strain]) @ form.position,
        filter=np.hstack([a["A_d"] - gain @ a["H_pm"], a["B_d"] - gain @ a["D_pm"], gain]),
        regulator=np.vstack(
            [np.hstack([a["feedback_gain"], np.zeros((voltages, voltages))]), a["static_inverse"] @ seen]
        ),
        estimates=seen,
        gain=design.options.integral_gain,
        limit=design.options.voltage_limit,
    )


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Transitions of the flat output that are known from the start, in the order in which they begin and end."""

    begins: NDArray[np.int64]  # (count,), number of the step that each begins with
    durations: Array  # (count,), s
    steps: Array  # (count, voltages), V
    preview: float  # s


def bare_library(folder: Path, compiler: str, feedforward: Path) -> ctypes.CDLL:
    """The compiled bare loops with the tables of a native FlatnessFeedforward, kept in `folder`; BuildError."""
    with zipfile.ZipFile(feedforward) as archive:
        tables = archive.read("sources/tables.c")
    sources = [_BENCH / "bench.c", *(_UNITS / name for name in _SHARED)]
    digest = hashlib.sha256(tables + compiler.encode())
    for path in (*sources, _BENCH / "bench.h", *sorted(_UNITS.glob("*.h"))):
        digest.update(path.read_bytes())
    platform = host_platform()
    library = folder / f"bench-{digest.hexdigest()[:12]}{platform.suffix}"
    if not library.is_file():
        with tempfile.TemporaryDirectory(prefix="flexbeams_") as temporary:
            written, built = Path(temporary) / "tables.c", Path(temporary) / f"bench{platform.suffix}"
            written.write_bytes(tables)
            find_compiler(compiler).build(built, [*sources, written], _UNITS, platform)
            write_whole(library, built.read_bytes())
    loaded = ctypes.CDLL(str(library))
    loaded.bare_feedforward_scratch.restype = ctypes.c_size_t
    return loaded


def _structure(name: str, sizes: str, numbers: str, arrays: str) -> type[ctypes.Structure]:
    fields = [
        (field, kind)
        for names, kind in ((sizes, ctypes.c_size_t), (numbers, ctypes.c_double), (arrays, ctypes.c_void_p))
        for field in names.split()
    ]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


_Plant = _structure("_Plant", "states inputs shown", "", "transition outputs x driven held y")
_Controller = _structure(
    "_Controller",
    "states voltages gauges points",
    "integral_gain limit",
    "filter regulator estimates x_est u integral y_est scratch",
)


class _Feedforward(ctypes.Structure):
    _fields_ = [
        ("count", ctypes.c_size_t),
        ("begins", ctypes.c_void_p),
        ("starts", ctypes.c_void_p),
        ("durations", ctypes.c_void_p),
        ("steps", ctypes.c_void_p),
        ("preview", ctypes.c_double),
        ("begun", ctypes.c_size_t),
        ("ended", ctypes.c_size_t),
        ("offset", ctypes.c_void_p),
        ("u_ff", ctypes.c_void_p),
        ("x_ref", ctypes.c_void_p),
        ("y_ref", ctypes.c_void_p),
        ("scratch", ctypes.c_void_p),
    ]


class BareLoops:
    """The loops in C, from rest at zero; results stay in y (plant), u, y_est (controller), u_ff, x_ref, y_ref."""

    def __init__(self, library: ctypes.CDLL, matrices: Matrices, step: float, motion: Motion | None = None) -> None:
        self._library, self._step = library, step
        m = matrices
        states, voltages, points = len(m.filter), len(m.regulator) // 2, len(m.estimates)
        gauges, inputs = m.filter.shape[1] - states - voltages, m.transition.shape[1] - len(m.transition)
        self._kept = {
            name: panels(getattr(m, name)) for name in ("transition", "outputs", "filter", "regulator", "estimates")
        }
        sizes = {
            "x": len(m.transition),
            "driven": m.transition.shape[1],
            "held": inputs,
            "y": len(m.outputs),
            "x_est": states,
            "u": voltages,
            "integral": voltages,
            "y_est": points,
            "scratch": states + 3 * voltages + gauges,
            "offset": voltages,
            "u_ff": voltages,
            "x_ref": states,
            "y_ref": points,
        }
        self._work = {name: np.zeros(size) for name, size in sizes.items()}
        at = {name: array.ctypes.data for name, array in (self._kept | self._work).items()}
        self._plant = _Plant(
            states=len(m.transition),
            inputs=inputs,
            shown=len(m.outputs),
            **{name: at[name] for name in ("transition", "outputs", "x", "driven", "held", "y")},
        )
        self._controller = _Controller(
            states=states,
            voltages=voltages,
            gauges=gauges,
            points=points,
            integral_gain=m.gain,
            limit=m.limit,
            **{
                name: at[name]
                for name in ("filter", "regulator", "estimates", "x_est", "u", "integral", "y_est", "scratch")
            },
        )
        self._feedforward = _Feedforward()
        if motion is not None:
            scratch = np.zeros(library.bare_feedforward_scratch())
            known: list[NDArray[Any]] = [
                motion.begins,
                motion.begins * step,
                motion.durations,
                np.ascontiguousarray(motion.steps),
                scratch,
            ]
            begins, starts, durations, steps, work = (array.ctypes.data for array in known)
            self._keep_motion = known
            self._feedforward = _Feedforward(
                count=len(motion.begins),
                begins=begins,
                starts=starts,
                durations=durations,
                steps=steps,
                preview=motion.preview,
                scratch=work,
                **{name: at[name] for name in ("offset", "u_ff", "x_ref", "y_ref")},
            )

    def __getitem__(self, name: str) -> Array:
        """An array of the loops as it stands."""
        return self._work[name]

    def reset(self) -> None:
        """Rest at zero."""
        for array in self._work.values():
            array[:] = 0.0
        self._feedforward.begun = self._feedforward.ended = 0

    def plant(self, rows: Array) -> None:
        """A step for each row (inputs,): voltages, then forces."""
        self._library.bare_plant_loop(ctypes.byref(self._plant), ctypes.c_size_t(len(rows)), _data(rows))

    def controller(self, rows: Array) -> None:
        """A step for each row (u_ff, x_ref, y_pm)."""
        self._library.bare_controller_loop(ctypes.byref(self._controller), ctypes.c_size_t(len(rows)), _data(rows))

    def feedforward(self, first: int, count: int) -> None:
        """Steps first ... first + count - 1."""
        self._library.bare_feedforward_loop(
            ctypes.byref(self._feedforward), ctypes.c_int64(first), ctypes.c_size_t(count), ctypes.c_double(self._step)
        )

    def closed(self, count: int) -> None:
        """Steps of the closed loop from step 0, Jacobi coupling."""
        self._library.bare_loop(
            ctypes.byref(self._plant),
            ctypes.byref(self._controller),
            ctypes.byref(self._feedforward),
            ctypes.c_size_t(count),
            ctypes.c_double(self._step),
        )


def _data(rows: Array) -> ctypes.c_void_p:
    assert rows.flags.c_contiguous
    return ctypes.c_void_p(rows.ctypes.data)


class NumpyLoops:
    """The same recursions in numpy, step by step."""

    def __init__(self, design: Design, matrices: Matrices, motion: Motion | None = None) -> None:
        self._m, self._motion, self._step = matrices, motion, design.options.sample_time
        a = design.arrays
        exponent, norm = a["transition_constants"]
        self._theta = Transition(exponent=float(exponent), norm=float(norm), table=a["transition_table"])
        self._input_series, self._state_series = a["input_series"], a["state_series"].reshape(len(a["A"]), -1)
        voltages = len(a["feedback_gain"])
        self.x, self.y = np.zeros(len(matrices.transition)), np.zeros(len(matrices.outputs))
        self.x_est, self.u, self.integral = np.zeros(len(a["A"])), np.zeros(voltages), np.zeros(voltages)
        self.u_ff, self.x_ref, self.offset = np.zeros(voltages), np.zeros(len(a["A"])), np.zeros(voltages)
        self.y_est, self.y_ref = np.zeros(len(a["H_pi"])), np.zeros(len(a["H_pi"]))
        self._begun = self._ended = 0

    def plant_step(self, inputs: Array) -> None:
        """Voltages and forces (inputs,) held over a step."""
        self.x = self._m.transition @ np.concatenate((self.x, inputs))
        self.y = self._m.outputs @ self.x[: len(self.x) // 2]

    def controller_step(self, u_ff: Array, x_ref: Array, y_pm: Array) -> None:
        """A tick."""
        m = self._m
        self.x_est = m.filter @ np.concatenate((self.x_est, self.u, y_pm))
        error = m.regulator @ np.concatenate((x_ref - self.x_est, u_ff - self.u))
        wanted, growth = u_ff + error[: len(u_ff)] + self.integral, m.gain * error[len(u_ff) :]
        self.integral = self.integral + np.where((np.abs(wanted) > m.limit) & (wanted * growth > 0), 0.0, growth)
        self.u = np.clip(wanted, -m.limit, m.limit)
        self.y_est = m.estimates @ np.concatenate((self.x_est, self.u))

    def feedforward_step(self, number: int) -> None:
        """The outputs at the end of a step; at rest nothing is to do."""
        motion = self._motion
        assert motion is not None
        time = number * self._step + self._step + motion.preview
        while self._begun < len(motion.begins) and motion.begins[self._begun] <= number:
            self._begun += 1
        if self._ended == self._begun:
            return
        while self._ended < self._begun and time >= self._end(self._ended):
            self.offset = self.offset + motion.steps[self._ended]
            self._ended += 1
        xi = np.zeros((len(self._input_series), len(self.u_ff)))
        xi[0] = self.offset
        for k in range(self._ended, self._begun):
            duration = float(motion.durations[k])
            series = self._theta.series((time - motion.begins[k] * self._step) / duration, len(xi) - 1)
            xi += (series * derivative_scales(len(xi) - 1, duration))[:, None] * motion.steps[k]
        self.u_ff = self._input_series @ xi
        self.x_ref = self._state_series @ xi[:-1].ravel()
        self.y_ref = self._m.estimates @ np.concatenate((self.x_ref, self.u_ff))

    def _end(self, k: int) -> float:
        assert self._motion is not None
        return float(self._motion.begins[k] * self._step + self._motion.durations[k])

    def closed_step(self, number: int) -> None:
        """A step of the closed loop, Jacobi coupling."""
        forces = self._m.transition.shape[1] - len(self.x) - len(self.u)
        held = np.concatenate((self.u, np.zeros(forces)))
        self.controller_step(self.u_ff, self.x_ref, self.y[len(self.y_est) :])
        self.feedforward_step(number)
        self.plant_step(held)
