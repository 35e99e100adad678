"""Masters in a separate process, which contains their crashes, leaks, messages and changes of settings.

`python -m flexbeams.scenarios.masters.isolation` is that process: it reads a request as JSON from standard input and
writes the traces to a folder.
"""

import gc
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.archive import read_arrays
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.masters.catalogue import find_master
from flexbeams.scenarios.masters.tasks import read_task
from flexbeams.scenarios.masters.trace import Task, Trace
from flexbeams.scenarios.processes.children import python_command, python_environment


class MasterError(FlexbeamsError):
    """A master's process ended without a result; names the tool, its exit status and its last line of output."""


@dataclass(frozen=True, kw_only=True)
class Cycles:
    """Traces of the first run of each package, and effects of running all of them repeatedly."""

    traces: list[Trace]
    repeated: bool  # every later run gave the same values, bit by bit
    stepping: list[list[float]]  # s, of each task in each cycle
    resident: list[int]  # bytes of memory in use after each cycle; empty where the system does not report it


def run_master(
    name: str,
    file: Path,
    *,
    stop_time: float | None = None,
    step: float | None = None,
    signals: Sequence[str] | None = None,
) -> Trace:
    """Runs an SSP with a master; stop time and step (s) are the package's by default.

    Records the Real outputs `signals` (<component>.<variable>), by default all. Raises InputError for a package that
    cannot be read, MasterError where the tool refuses it or crashes.
    """
    return run_cycles(name, [read_task(file, stop_time=stop_time, step=step, signals=signals)]).traces[0]


def run_cycles(name: str, tasks: Sequence[Task], cycles: int = 1) -> Cycles:
    """Runs tasks one after another in one process on one core, all of them `cycles` times.

    Raises the same errors as `run_master`.
    """
    find_master(name)
    with temporary_folder() as folder:
        request = {
            "master": name,
            "cycles": cycles,
            "folder": str(folder),
            "tasks": [{**asdict(task), "file": str(task.file.resolve())} for task in tasks],
        }
        temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))
        done = subprocess.run(
            python_command("-m", "flexbeams.scenarios.masters.isolation"),
            input=json.dumps(request),
            text=True,
            capture_output=True,
            check=False,
            env=python_environment() | temporary,
        )
        result = folder / "result.json"
        if done.returncode or not result.is_file():
            last_line = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
            raise MasterError(f"{name} ended with status {done.returncode}, last output: {last_line}")
        kept = json.loads(result.read_text())
        traces = [_read_trace(folder / f"{k}.npz") for k in range(len(tasks))]
    return Cycles(traces=traces, repeated=kept["repeated"], stepping=kept["stepping"], resident=kept["resident"])


def serve(request: dict[str, Any]) -> None:
    """Runs a request and writes the traces of the first cycle and result.json to its folder."""
    if hasattr(os, "sched_setaffinity"):  # with several threads such small units wait for each other
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    simulate, folder = find_master(request["master"]).simulate, Path(request["folder"])
    tasks = [
        Task(**{**task, "file": Path(task["file"]), **{k: tuple(task[k]) for k in ("components", "signals")}})
        for task in request["tasks"]
    ]
    first = [simulate(task) for task in tasks]
    stepping, resident, repeated = [[trace.stepping for trace in first]], [resident_bytes()], True
    for _ in range(request["cycles"] - 1):
        again = [simulate(task) for task in tasks]
        repeated &= all(np.array_equal(a.values, b.values) for a, b in zip(again, first, strict=True))
        stepping.append([trace.stepping for trace in again])
        resident.append(resident_bytes())
    for k, trace in enumerate(first):
        np.savez(
            folder / f"{k}.npz",
            time=trace.time,
            columns=np.array(trace.columns, dtype=str),
            values=trace.values,
            stepping=trace.stepping,
            loading=np.nan if trace.loading is None else trace.loading,
        )
    (folder / "result.json").write_text(
        json.dumps({"repeated": repeated, "stepping": stepping, "resident": [r for r in resident if r is not None]})
    )


def resident_bytes() -> int | None:
    """Bytes of memory in use by this process, after releasing the allocator's reserve; None where it is not known."""
    import ctypes

    statm = Path("/proc/self/statm")
    gc.collect()
    if not statm.is_file():
        return None
    ctypes.CDLL(None).malloc_trim(0)
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _read_trace(file: Path) -> Trace:
    arrays = read_arrays(file)
    loading = float(arrays["loading"])
    return Trace(
        time=arrays["time"],
        columns=list(map(str, arrays["columns"])),
        values=arrays["values"],
        stepping=float(arrays["stepping"]),
        loading=None if np.isnan(loading) else loading,
    )


if __name__ == "__main__":
    serve(json.loads(sys.stdin.read()))
