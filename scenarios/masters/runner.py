"""This project's own runner behind the interface of the masters, for comparison."""

import time

from flexbeams.scenarios.masters.trace import Master, Task, Trace


def simulate(task: Task) -> Trace:
    """Runs an SSP with its coupling; without signals only the first and the last row are recorded."""
    from flexbeams.scenarios.definition.settings import Settings
    from flexbeams.scenarios.runs.package import run_package

    begin = time.perf_counter()
    recording = run_package(
        task.file,
        Settings(
            record_animation=False,
            step=task.step,
            stop_time=task.steps * task.step,
            compiler=task.compiler,
            decimate=1 if task.signals else task.steps,
        ),
    ).recording
    columns = [name for name in task.signals if name in recording.columns]  # long arrays are not recorded
    return Trace(
        time=recording.time,
        columns=columns,
        values=recording.values[:, [recording.columns.index(name) for name in columns]],
        loading=time.perf_counter() - begin - recording.wall_seconds,
        stepping=recording.wall_seconds,
    )


MASTER = Master(
    name="runner",
    distribution="flexbeams",
    module="flexbeams.scenarios.runs.package",
    coupling="jacobi",
    delayed_start=False,
    faults=(),
    simulate=simulate,
)
