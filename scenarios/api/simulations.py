"""Simulations that a notebook steps."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.api.run_settings import run_settings
from flexbeams.scenarios.definition.choices import Backend, BasisName, Coupling
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Value
from flexbeams.scenarios.importing.package import is_package
from flexbeams.scenarios.runs.observer import Observer, ignore_note
from flexbeams.scenarios.runs.simulation import Simulation


def simulation(
    scenario: str | Path,
    *,
    without: str | Sequence[str] = (),
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
    record: bool = True,
    build_folder: str | Path | None = None,
    kinds: Sequence[UnitKind] = (),
    notify: Callable[[str], None] = ignore_note,
) -> Simulation:
    """Loads the units of a scenario, ready to be stepped: sim.step(), sim["plant.y_pi"], sim["plant.u"] = ...

    Parameters
    ----------
    scenario
        A shipped name (see `flexbeams list`), or the path of a scenario file.
    without
        Instances that are left out, such as `["controller"]`, or inputs, such as `["feedforward.y_target"]`, whose
        connection or signal is left out. The inputs that they drove are yours; `sim.inputs` lists them.
    record
        Whether steps are recorded for `sim.result()`; a simulation of many episodes takes less memory without.
    start, stop_time, step, coupling, basis, structure, design, backend, compiler, decimate, build_folder, kinds, notify
        As in `run`.

    Returns
    -------
    Simulation
        A context manager; `close` ends the units.

    Raises
    ------
    FlexbeamsError
        Where the simulation cannot start, as `run`.

    Examples
    --------
    >>> import flexbeams as fb
    >>> with fb.simulation("tracking", without=["controller"], stop_time=0.1) as sim:
    ...     while sim.time < 0.1:
    ...         sim["plant.u"] = sim["feedforward.u_ff"]  # V
    ...         sim.step()
    >>> sim.inputs, sim.time
    (('plant.u', 'plant.force'), 0.1)
    """
    if is_package(str(scenario)) or Path(scenario).suffix.lower() == ".fmu":
        rule = "must be a scenario, which may name FMUs; packages are run as a whole, by fb.run"
        raise InputError("scenario", rule, str(scenario))
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
    )
    file = load_scenario(str(scenario))
    left_out = [without] if isinstance(without, str) else without
    return Simulation(file, settings, without=left_out, record=record, observer=Observer(notify=notify))
