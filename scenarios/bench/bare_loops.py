"""The arithmetic of the units without FMI: bare loops in C (native/bench.c)."""

import ctypes
import hashlib
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.packaging.c_tables import panels
from flexbeams.fmus.packaging.cache import is_sound, keep, toolchain_key
from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.fmus.packaging.native import HEADERS
from flexbeams.plant.basis import Array
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.bench.arithmetic import Matrices, TransitionSequence

_BENCH = Path(__file__).parent / "native"
_MATRICES = ("transition", "outputs", "filter", "regulator", "estimates")


def bare_library(folder: Path, compiler: str, feedforward: Path) -> ctypes.CDLL:
    """The compiled bare loops with the sources of a native FlatnessFeedforward, cached in `folder`.

    Raises BuildError.
    """
    with zipfile.ZipFile(feedforward) as archive:
        sources = {name: archive.read(name) for name in archive.namelist() if name.startswith("sources/Flat")}
    digest = hashlib.sha256(toolchain_key(compiler).encode())
    for content in (*sources.values(), *((_BENCH / name).read_bytes() for name in ("bench.c", "bench.h"))):
        digest.update(content)
    platform = host_platform()
    library = folder / f"bench-{digest.hexdigest()[:16]}{platform.suffix}"
    if not is_sound(library, folder):
        with temporary_folder() as temporary:
            built = temporary / f"bench{platform.suffix}"
            for name, content in sources.items():
                (temporary / Path(name).name).write_bytes(content)
            find_compiler(compiler).build(built, [_BENCH / "bench.c"], [temporary, HEADERS], platform)
            keep(library, built.read_bytes(), folder)
    loaded = ctypes.CDLL(str(library))
    loaded.bare_feedforward_scratch.restype = ctypes.c_size_t
    loaded.step_lengths.restype = ctypes.c_size_t
    return loaded


def step_lengths(library: ctypes.CDLL, do_step: int | None, component: int, time: float, lengths: Array) -> None:
    """Steps of a component from `time` through the fmi2DoStep at an address, each of its own length (k,), s."""
    done = library.step_lengths(
        ctypes.c_void_p(do_step),
        ctypes.c_void_p(component),
        ctypes.c_double(time),
        ctypes.c_size_t(len(lengths)),
        _data(lengths),
    )
    assert done == len(lengths)


def _structure(name: str, sizes: str, numbers: str, arrays: str) -> type[ctypes.Structure]:
    fields = [
        (field, kind)
        for names, kind in ((sizes, ctypes.c_size_t), (numbers, ctypes.c_double), (arrays, ctypes.c_void_p))
        for field in names.split()
    ]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


_Plant = _structure("_Plant", "states inputs output_count", "", "transition outputs x driven held y")
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
        ("changes", ctypes.c_void_p),
        ("preview", ctypes.c_double),
        ("begun", ctypes.c_size_t),
        ("ended", ctypes.c_size_t),
        ("offset", ctypes.c_void_p),
        ("u_ff", ctypes.c_void_p),
        ("x_ref", ctypes.c_void_p),
        ("y_ref", ctypes.c_void_p),
        ("scratch", ctypes.c_void_p),
    ]


def _work_sizes(m: Matrices) -> dict[str, int]:
    """Elements of each array that the loops write."""
    states, voltages, points = len(m.filter), len(m.regulator) // 2, len(m.estimates)
    gauges = m.filter.shape[1] - states - voltages
    return {
        "x": len(m.transition),
        "driven": m.transition.shape[1],
        "held": m.transition.shape[1] - len(m.transition),
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


def _plant(m: Matrices, addresses: Mapping[str, int]) -> Any:
    arrays = ("transition", "outputs", "x", "driven", "held", "y")
    return _Plant(
        states=len(m.transition),
        inputs=m.transition.shape[1] - len(m.transition),
        output_count=len(m.outputs),
        **{name: addresses[name] for name in arrays},
    )


def _controller(m: Matrices, addresses: Mapping[str, int]) -> Any:
    states, voltages = len(m.filter), len(m.regulator) // 2
    arrays = ("filter", "regulator", "estimates", "x_est", "u", "integral", "y_est", "scratch")
    return _Controller(
        states=states,
        voltages=voltages,
        gauges=m.filter.shape[1] - states - voltages,
        points=len(m.estimates),
        integral_gain=m.gain,
        limit=m.limit,
        **{name: addresses[name] for name in arrays},
    )


class BareLoops:
    """The loops in C, from rest at zero; results stay in y (plant), u, y_est (controller), u_ff, x_ref, y_ref."""

    def __init__(
        self, library: ctypes.CDLL, matrices: Matrices, step: float, transitions: TransitionSequence | None = None
    ) -> None:
        self._library, self._step = library, step
        self._work = {name: np.zeros(size) for name, size in _work_sizes(matrices).items()}
        self._constants = {name: panels(getattr(matrices, name)) for name in _MATRICES}
        addresses = {name: array.ctypes.data for name, array in (self._constants | self._work).items()}
        self._plant = _plant(matrices, addresses)
        self._controller = _controller(matrices, addresses)
        self._feedforward = _Feedforward()
        if transitions is not None:
            self._transitions: list[NDArray[Any]] = [
                transitions.begins,
                transitions.begins * step,
                transitions.durations,
                np.ascontiguousarray(transitions.changes),
                np.zeros(library.bare_feedforward_scratch()),
            ]
            begins, starts, durations, changes, scratch = (array.ctypes.data for array in self._transitions)
            self._feedforward = _Feedforward(
                count=len(transitions.begins),
                begins=begins,
                starts=starts,
                durations=durations,
                changes=changes,
                preview=transitions.preview,
                scratch=scratch,
                **{name: addresses[name] for name in ("offset", "u_ff", "x_ref", "y_ref")},
            )

    def __getitem__(self, name: str) -> Array:
        """The current values of an array of the loops."""
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
