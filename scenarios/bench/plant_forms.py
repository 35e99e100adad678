"""The plant's modal form beside its dense form, both compiled from the same sources and through the FMI functions."""

import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.fmus.packaging.binaries import binary_entries
from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.fmus.packaging.native import HEADERS, compiled_file
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.plant.basis import Array
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.bench.timing import timed
from flexbeams.scenarios.bench.unit_loops import Loop
from flexbeams.scenarios.bench.workbench import Workbench

UNIT = "BeamPlant"
ALWAYS_DENSE = "LARGEST_CONDITION=0.0"  # the condition above which the matrix exponential takes the modal form's place
LENGTHS, REPEATS, WARM_UP = 30, 3, 10  # new ones in a row, rows in a round, and new ones before these
STARTS = 3  # initialisations in a round


def plant_form_costs(bench: Workbench, rounds: int) -> list[dict[str, Any]]:
    """Microseconds of both forms and the median ratio of modal to dense: `cost`, `modal_us`, `dense_us`, `ratio`.

    A step of the usual length, one of a length never seen before, and a reset with an initialisation for parameters
    never seen before. Raises BuildError.
    """
    inputs = len(bench.model.structure.patch) + len(bench.model.structure.beam)
    rows = np.random.default_rng(1).normal(0.0, 1e-2, (bench.steps, inputs))
    with temporary_folder() as folder:
        files = {
            "modal": bench.plant_file,
            "dense": dense_plant(bench.plant_file, folder / f"{UNIT}.fmu", bench.compiler),
        }
        loops = {form: bench.file_loop(file, ("u", "force"), rows, folder=form) for form, file in files.items()}
    measures: dict[str, tuple[int, Callable[[Loop], float]]] = {
        "step": (bench.steps, partial(Loop.advance_from_start, rows=rows)),
        "step of a new length": (LENGTHS, partial(_new_lengths, bench=bench, rows=rows)),
        "initialisation": (STARTS, _initialisations),
    }
    return [_cost(name, loops, measure, count, rounds) for name, (count, measure) in measures.items()]


def dense_plant(modal: Path, out: Path, compiler: str) -> Path:
    """The FMU of a plant whose library never takes the modal form; BuildError where it cannot be compiled."""
    with zipfile.ZipFile(modal) as archive:
        entries = {name: archive.read(name) for name in archive.namelist() if not name.startswith("binaries/")}
    platform = host_platform()
    with temporary_folder() as folder:
        for name, content in entries.items():
            if name.startswith("sources/"):
                (folder / Path(name).name).write_bytes(content)
        library = folder / f"{UNIT}{platform.suffix}"
        definitions = ["FMI2_OVERRIDE_FUNCTION_PREFIX", ALWAYS_DENSE]
        find_compiler(compiler).build(library, [folder / compiled_file(UNIT)], [HEADERS], platform, definitions)
        write_whole(out, zip_bytes(entries | binary_entries(UNIT, {platform: library.read_bytes()})))
    return out


def _cost(
    name: str, loops: dict[str, Loop], measure: Callable[[Loop], float], count: int, rounds: int
) -> dict[str, Any]:
    times = np.array([[measure(loop) / count for loop in loops.values()] for _ in range(rounds)])
    modal, dense = (1e6 * times.min(axis=0)).tolist()
    return {
        "cost": name,
        "modal_us": modal,
        "dense_us": dense,
        "ratio": float(np.median(times[:, 0] / times[:, 1])),
    }


def _new_lengths(loop: Loop, bench: Workbench, rows: Array) -> float:
    """Seconds of LENGTHS usual steps with their inputs and outputs, and what new lengths add to steps alone.

    A few new lengths go first, since the other form has taken the caches.
    """
    seconds, time = loop.advance_from_start(rows) * LENGTHS / len(rows), len(rows) * bench.step
    usual, new = np.full(LENGTHS, bench.step), bench.step * (1.0 + 1e-4 * np.arange((1 + REPEATS) * LENGTHS))
    spent = []
    for lengths in (
        new[:WARM_UP],
        *(half for k in range(REPEATS) for half in (usual, new[(k + 1) * LENGTHS :][:LENGTHS])),
    ):
        spent.append(timed(lambda t=time, h=lengths: bench.step_lengths(loop, t, h)))  # type: ignore[misc]
        time += float(lengths.sum())
    return seconds + max(min(spent[2::2]) - min(spent[1::2]), 0.0)


def _initialisations(loop: Loop) -> float:
    """Seconds of STARTS resets and initialisations, each for another density."""

    def start_all() -> None:
        for k in range(STARTS):
            loop.start(**{"beam[1].density": 2000.0 + k})

    return timed(start_all)
