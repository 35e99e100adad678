"""Many plants under one controller, side by side: the loop in C (native/batch.c) for samples that differ in the plant.

The library is compiled for any processor and for those with the instructions of x86-64-v3 and x86-64-v4; all give the
same bits. The quickest one that this machine can run is taken.
"""

import ctypes
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.packaging.cache import is_sound, keep, prepare_cache, toolchain_key
from flexbeams.fmus.packaging.compilers import FLAGS, PROCESSOR_FLAGS, find_compiler, host_platform
from flexbeams.fmus.units.native_kernel import NATIVE as UNITS
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.plant.temporary import temporary_folder

_NATIVE = Path(__file__).parent / "native"
SOURCES = (
    *(
        _NATIVE / name
        for name in (
            "batch.c",
            "batch_kernel.c",
            "batch_plant.c",
            "batch_controller.c",
            "batch_filter.c",
            "batch_measures.c",
            "batch_modes.c",
            "batch_setup.c",
            "undamped_modes.c",
            "damped_modes.c",
            "processor_level.c",
        )
    ),
    *(
        UNITS / "numerics" / f"{name}.c"
        for name in (
            "block_modes",
            "cluster_vectors",
            "coupled_modes",
            "eigenvectors",
            "exact_hold",
            "linear_algebra",
            "modal",
            "modal_build",
            "mode_clusters",
            "modes",
            "normal_number",
            "schur",
        )
    ),
    *(UNITS / "units" / f"{name}.c" for name in ("plant_matrices", "unit", "format_line", "windup")),
)
INCLUDES = (_NATIVE, UNITS, UNITS / "numerics", UNITS / "units")
BASELINE = "baseline"  # the variant that runs anywhere
LEVELS = {"v3": 3, "v4": 4}  # of the other variants: the level of x86-64 that they need
FIGURES = 6  # of a measured element, see batch.h
SMALLEST, LARGEST, FIRST, LAST, CHANGE, OUT = range(FIGURES)
_POINTER, _INTEGER, _REAL = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double
_PLANT_SIZES = ("coordinates", "patches", "beams", "points", "gauges", "value_count")


class _Plant(ctypes.Structure):
    _fields_ = [
        *((name, _INTEGER) for name in _PLANT_SIZES),
        ("parameter_count", _INTEGER),
        ("parameters", _POINTER),
        ("term_count", _INTEGER),
        ("terms", _POINTER),
        *((name, _POINTER) for name in ("rows", "blocks", "starts", "columns", "values")),
        ("start_at_rest_under", _INTEGER),
        ("strain_noise_std", _INTEGER),
        ("noise_seed", _INTEGER),
    ]


class _Controller(ctypes.Structure):
    _fields_ = [
        ("states", _INTEGER),
        ("reduced_states", _INTEGER),
        ("filter", _POINTER),
        ("regulator", _POINTER),
        ("integral_gain", _REAL),
        ("strain_limit", _REAL),
        ("integral_range", _POINTER),
        ("lowest", _POINTER),
        ("highest", _POINTER),
    ]


class _Task(ctypes.Structure):
    _fields_ = [
        ("plant", _Plant),
        ("controller", _Controller),
        ("step", _REAL),
        ("steps", _INTEGER),
        ("x_ref", _POINTER),
        ("u_ff", _POINTER),
        ("force", _POINTER),
        ("measure_count", _INTEGER),
        ("measures", _POINTER),
        ("bands", _POINTER),
    ]


@dataclass(frozen=True, kw_only=True)
class BatchTask:
    """A loop of plant and controller as the library takes it; arrays row by row."""

    plant: Mapping[str, Any]  # fields of BatchPlant in batch.h but counts
    controller: Mapping[str, Any]  # fields of BatchController
    step: float  # s
    steps: int
    x_ref: Array  # (steps + 1, reduced states)
    u_ff: Array  # (steps + 1, patches)
    force: Array | None  # (steps + 1, beams)
    measures: NDArray[np.int64]  # (elements, 6)
    bands: Array  # (elements, 2)


class Batch:
    """A loaded library with a task; a context manager that frees it."""

    def __init__(self, task: BatchTask, libraries: Mapping[str, Path]) -> None:
        """`libraries` by variant. Raises FlexbeamsError where the controller has no form for this loop."""
        self._library = _loaded(libraries)
        self._kept: list[Any] = []  # that the C structures point to
        self._width = int(task.plant["value_count"])
        self._measures = len(task.measures)
        self._task = self._structure(task)
        self._batch: int | None = self._library.batch_open(ctypes.byref(self._task))
        if self._batch is None:
            raise FlexbeamsError("the filter has no modal form, or there is not enough memory")

    def run(self, values: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Figures (samples, elements, FIGURES) for values (samples, value_count) of the plant's variables.

        Also whether the loop covers each sample; where it does not, the sample's figures are 0.
        """
        values = np.ascontiguousarray(values, dtype=np.float64)
        figures = np.empty((len(values), self._measures, FIGURES))
        outcomes = np.empty(len(values), np.int32)
        self._library.batch_run(self._batch, len(values), values.ctypes.data, figures.ctypes.data, outcomes.ctypes.data)
        return figures, outcomes == 0

    def close(self) -> None:
        """Frees the library's memory."""
        if self._batch is not None:
            self._library.batch_close(self._batch)
            self._batch = None

    def __enter__(self) -> "Batch":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _structure(self, task: BatchTask) -> _Task:
        plant, controller = task.plant, task.controller
        return _Task(
            plant=_Plant(
                **{name: plant[name] for name in (*_PLANT_SIZES, "start_at_rest_under")},
                strain_noise_std=plant["strain_noise_std"],
                noise_seed=plant["noise_seed"],
                parameter_count=len(plant["parameters"]),
                parameters=self._integers(plant["parameters"]),
                term_count=len(plant["terms"]),
                terms=self._integers(plant["terms"]),
                **{name: self._reals(plant[name]) for name in ("blocks", "values")},
                **{name: self._numbers(plant[name]) for name in ("rows", "starts", "columns")},
            ),
            controller=_Controller(
                **{name: controller[name] for name in ("states", "reduced_states", "integral_gain", "strain_limit")},
                **{
                    name: self._reals(controller[name])
                    for name in ("filter", "regulator", "integral_range", "lowest", "highest")
                },
            ),
            step=task.step,
            steps=task.steps,
            x_ref=self._reals(task.x_ref),
            u_ff=self._reals(task.u_ff),
            force=None if task.force is None else self._reals(task.force),
            measure_count=len(task.measures),
            measures=self._integers(task.measures),
            bands=self._reals(task.bands),
        )

    def _reals(self, values: Any) -> int:
        return self._kept_address(np.ascontiguousarray(values, dtype=np.float64))

    def _integers(self, values: Any) -> int:
        return self._kept_address(np.ascontiguousarray(values, dtype=np.int64))

    def _numbers(self, values: Any) -> int:
        return self._kept_address(np.ascontiguousarray(values, dtype=np.uint32))

    def _kept_address(self, array: NDArray[Any]) -> int:
        self._kept.append(array)
        return int(array.ctypes.data)


def _loaded(libraries: Mapping[str, Path]) -> Any:
    """The library of the highest level that this machine can run."""
    library: Any = ctypes.CDLL(str(libraries[BASELINE]))
    library.processor_level.restype = ctypes.c_int
    level = library.processor_level()
    if usable := [name for name in LEVELS if name in libraries and LEVELS[name] <= level]:
        library = ctypes.CDLL(str(libraries[max(usable, key=LEVELS.__getitem__)]))
    library.batch_open.restype = ctypes.c_void_p
    library.batch_close.argtypes = (ctypes.c_void_p,)
    library.batch_close.restype = None
    library.batch_run.argtypes = (ctypes.c_void_p, ctypes.c_size_t, *([ctypes.c_void_p] * 3))
    library.batch_run.restype = None
    return library


def batch_libraries(folder: Path, compiler: str) -> dict[str, Path]:
    """The compiled library by variant, kept in the cache `folder` as stepper_library's.

    Raises BuildError, and InputError for a cache that cannot be trusted.
    """
    platform = host_platform()
    headers = sorted({header for place in INCLUDES for header in place.glob("*.h")})
    content = b"".join(file.read_bytes() for file in (*SOURCES, *headers)) + toolchain_key(compiler).encode()
    found = {}
    prepare_cache(folder)
    for name in (BASELINE, *(LEVELS if platform.name.startswith("x86_64") else ())):
        processor = f"x86-64-{name}" if name in LEVELS else ""
        flags = repr((processor, FLAGS, PROCESSOR_FLAGS.get(processor)))
        digest = hashlib.sha256(content + flags.encode()).hexdigest()[:16]
        library = found[name] = folder / f"batch-{name}-{digest}{platform.suffix}"
        if not is_sound(library, folder):
            with temporary_folder() as temporary:
                built = temporary / f"batch{platform.suffix}"
                find_compiler(compiler).build(built, SOURCES, INCLUDES, platform, processor=processor)
                keep(library, built.read_bytes(), folder)
    return found
