"""Runs of scenarios and packages."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexbeams.fmus.units.kind import UnitKind
from flexbeams.scenarios.api.run_settings import run_settings
from flexbeams.scenarios.definition.choices import Backend, BasisName, Coupling
from flexbeams.scenarios.definition.schema import Value
from flexbeams.scenarios.runs.job import opened_experiment, run_experiment
from flexbeams.scenarios.runs.observer import Observer, ignore_note
from flexbeams.scenarios.runs.run_view import RunView, load

__all__ = ["load", "run"]


def run(
    scenario: str | Path,
    *,
    start: Mapping[str, Value] | None = None,
    stop_time: float | None = None,
    step: float | None = None,
    coupling: Coupling | None = None,
    basis: BasisName | None = None,
    structure: str | Path | None = None,
    design: Mapping[str, Any] | None = None,
    backend: Backend = "native",
    compiler: str = "zig",
    decimate: int = 1,
    build_folder: str | Path | None = None,
    kinds: Sequence[UnitKind] = (),
    notify: Callable[[str], None] = ignore_note,
) -> RunView:
    """Runs a scenario or an SSP package and measures its checks; writes no result files.

    Units that are missing are built first.

    Parameters
    ----------
    scenario
        A shipped name (see `flexbeams list`), the path of a scenario file, or of an SSP package.
    start
        Start values by <instance>.<variable>: a number, true or false, or a list for an array.
    stop_time, step
        Simulated time and communication step, s.
    coupling
        `jacobi` or `gauss-seidel`.
    basis, structure, design
        In place of the scenario's; `design` holds keys of its table [design], such as {"reduced_modes": 4}.
    backend, compiler, build_folder
        Kernel of the units, C compiler of native ones, and the folder where built units are kept: by default the
        user's cache, or that of the environment variable FLEXBEAMS_CACHE.
    decimate
        Records every `decimate`-th step, and the last one.
    kinds
        Further kinds of units that the scenario names.
    notify
        Receives notes, one line each.

    Returns
    -------
    RunView
        A mapping of arrays by name, with `time`, `checks`, `units`, `save` and tables of pandas and xarray.

    Raises
    ------
    FlexbeamsError
        Where the run cannot start. A unit that fails later ends the run: `run.recording.failure`.

    Examples
    --------
    >>> import flexbeams as fb
    >>> run = fb.run("tracking", start={"plant.strain_noise_std": 1e-7}, stop_time=2.0)
    >>> run["plant.y_pi"].shape, run["controller.u[1]"].shape, run.units["controller.u"]
    ((10001, 4), (10001,), 'V')
    >>> run.checks["largest voltage"].passed
    True
    """
    settings = run_settings(
        start=start,
        structure=structure,
        design=design,
        build_folder=build_folder,
        kinds=kinds,
        backend=backend,
        compiler=compiler,
        coupling=coupling,
        basis=basis,
        stop_time=stop_time,
        step=step,
        decimate=decimate,
        record_deflections=True,
    )
    with opened_experiment(str(scenario)) as experiment:
        return RunView.of(run_experiment(experiment, settings, Observer(notify=notify)))
