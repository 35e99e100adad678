"""Building of FMUs."""

from collections.abc import Callable, Sequence
from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.choices import BACKENDS, Backend
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.fmus.units.catalogue import CATALOGUE, require_kind
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.api.design_view import DesignView
from flexbeams.scenarios.runs.observer import ignore_note


def build(
    design: Design | DesignView,
    units: Sequence[str | UnitKind] = (),
    *,
    folder: str | Path = "build/fmus",
    backend: Backend = "native",
    platforms: Sequence[str] = ("host",),
    compiler: str = "zig",
    flags_as_real: bool = False,
    notify: Callable[[str], None] = ignore_note,
) -> list[Path]:
    """Builds FMUs of a design; those of one design belong together.

    Parameters
    ----------
    design
        The design whose data the units carry.
    units
        `BeamPlant`, `FlatnessFeedforward`, `TrackingController`, `MfcActuator`, `MfcCompensator`, or records of other
        kinds. Where none is named all five, without the last two for a structure without a section [actuator].
    folder
        Units are written to folder/<backend>/<unit>.fmu.
    backend
        `native` for kernels in C, `python` for kernels in Python.
    platforms
        Binaries in native units: `host`, `all`, or names as in `flexbeams build --help`.
    compiler
        C compiler of native units: `zig`, or one of the system's.
    flags_as_real
        Boolean outputs (`moving`, `saturated`) as Real, 0 or 1, for hosts that know only Real; such units carry no
        reference results.
    notify
        Receives a line for each binary of several platforms.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        For an unknown unit, platform or backend.
    InterfaceError
        For `MfcActuator` and `MfcCompensator` of a structure without a section [actuator].
    BuildError
        Where a tool is missing or fails, or where a unit does not reproduce its own reference results.

    Examples
    --------
    >>> import flexbeams as fb
    >>> [file.as_posix() for file in fb.build(fb.design("single_beam"), ["BeamPlant"])]
    ['build/fmus/native/BeamPlant.fmu']
    """
    kinds = [u if isinstance(u, UnitKind) else require_kind(u, "UNIT") for u in dict.fromkeys(units)]
    if backend not in BACKENDS:
        raise InputError("backend", f"must be one of {', '.join(BACKENDS)}", backend)
    computed = design.computed if isinstance(design, DesignView) else design
    kinds = kinds or [kind for kind in CATALOGUE if kind.is_made_by(computed)]
    files = build_units(
        kinds,
        computed,
        computed.model(),
        Path(folder),
        backend=backend,
        platforms=platforms,
        compiler=compiler,
        flags_as_real=flags_as_real,
        cache=cache_folder(),
        notify=notify,
    )
    for file in files:
        _require_references(file)
    return files


def _require_references(file: Path) -> None:
    """Runs the experiments inside a unit that loads on this machine; removes the unit where one fails."""
    from flexbeams.scenarios.validation.references import reference_checks

    for check in reference_checks(file):
        if check.ran and not check.passed:
            file.unlink()
            raise BuildError(f"{file}: {check.message}; the unit is removed")
