"""Exports of scenarios for other tools."""

from collections.abc import Callable, Sequence
from importlib import import_module
from os.path import exists, isdir, isfile
from pathlib import Path
from typing import Any

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import EXPORT_OPTIONS, EXPORT_SUFFIXES, WIRING_TOOLS, ExportFormat
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.observer import ignore_note

# Functions that write the formats; their modules are imported when they are needed
WRITERS: dict[ExportFormat, tuple[str, str]] = {
    "ssp": ("flexbeams.scenarios.exporting.ssp", "export_ssp"),
    "ospsystem": ("flexbeams.scenarios.exporting.osp", "export_osp"),
    "closed-loop": ("flexbeams.scenarios.exporting.closed_loop", "export_closed_loop"),
    "container": ("flexbeams.scenarios.exporting.container", "export_container"),
    "wiring": ("flexbeams.scenarios.exporting.wiring", "export_wiring"),
}


def export(
    scenario: str | Path,
    file: str | Path | None = None,
    *,
    format: ExportFormat | None = None,
    platforms: Sequence[str] = ("host",),
    notify: Callable[[str], None] = ignore_note,
    **options: Any,
) -> Path:
    """Writes a scenario for other tools: the closed loop, complete in one file or folder.

    Parameters
    ----------
    scenario
        A shipped name or the path of a scenario file.
    file
        The file, or folder, to write; by default the scenario's name with the suffix of the format.
    format
        `ssp`, `ospsystem`, `closed-loop`, `container` or `wiring`. By default that of an option which belongs to one
        format only, else that of the file: `ssp` for *.ssp, `closed-loop` for *.fmu, `ospsystem` for a folder or *.zip;
        `ssp` without a file.
    platforms
        Binaries in the units, as in `build`.
    notify
        Receives notes, one line each.
    options
        `start`, `stop_time`, `step`, `coupling`, `basis`, `structure`, `compiler` and `kinds` as in `run`. Of single
        formats: `ssp_version` (`1.0` or `2.0`), `parts` (names of instances) and `with_signals` for closed loops,
        `wiring` (names of tools), `flags_as_real`.

    Returns
    -------
    Path
        The file or folder.

    Raises
    ------
    InputError
        Where the scenario cannot be read or run, an option does not belong to the format, or the file cannot be
        written.
    BuildError
        Where a tool is missing or fails.

    Examples
    --------
    >>> import flexbeams as fb
    >>> fb.export("single_beam", "single_beam.ssp").name
    'single_beam.ssp'
    """
    chosen = _format(format, file, options)
    extra = _format_options(chosen, options)
    out = Path(file) if file is not None else Path(f"{Path(scenario).stem}{EXPORT_SUFFIXES[chosen]}")
    _require_path(out, chosen)
    if chosen == "wiring" and "wiring" not in extra:
        raise InputError("--wiring", f"must be given with --format wiring: {', '.join(WIRING_TOOLS)}")
    start, kinds = options.pop("start", None) or {}, tuple(options.pop("kinds", ()))
    settings = Settings(record_animation=False, overrides=start, kinds=kinds, **options)
    module, function = WRITERS[chosen]
    write: Callable[..., Path] = getattr(import_module(module), function)
    return write(str(scenario), out, settings, platforms, notify, **extra)


def _format(format: str | None, file: str | Path | None, options: dict[str, Any]) -> ExportFormat:
    """The format that is named, else that of an option of one format only, else that of the file's suffix."""
    if format is None:
        for name, formats in EXPORT_OPTIONS.items():
            if options.get(name) and len(formats) == 1:
                return formats[0]
        return "ssp" if file is None else _format_of(Path(file))
    for name in EXPORT_SUFFIXES:
        if format == name:
            return name
    raise InputError("format", f"must be one of {', '.join(EXPORT_SUFFIXES)}", format)


def _format_options(chosen: ExportFormat, options: dict[str, Any]) -> dict[str, Any]:
    """Takes the options of single formats out of `options`; those that are set must belong to this format."""
    extra = {}
    for name, formats in EXPORT_OPTIONS.items():
        if not (value := options.pop(name, None)):
            continue
        if chosen not in formats:
            raise InputError(f"--{name.replace('_', '-')}", f"belongs to --format {' or '.join(formats)}, not {chosen}")
        extra[name] = value
    return extra


def _format_of(file: Path) -> ExportFormat:
    """The format of a file's suffix, or of a folder."""
    formats: dict[str, ExportFormat] = {".ssp": "ssp", ".fmu": "closed-loop", ".zip": "ospsystem", "": "ospsystem"}
    suffix = file.suffix.lower() if not isdir(file) else ""
    if suffix not in formats:
        rule = "must end with .ssp or .fmu, or be a folder or FILE.zip, where --format is not given"
        raise InputError("--out", rule, str(file))
    return formats[suffix]


def _require_path(out: Path, chosen: ExportFormat) -> None:
    """InputError for a path that cannot be a file, or a folder, of this format."""
    suffix = EXPORT_SUFFIXES[chosen]
    if suffix.startswith("."):
        if exists(out) and not isfile(out):
            raise InputError("--out", "must be a regular file or a new path", str(out))
        if out.suffix.lower() != suffix:
            raise InputError("--out", f"must end with {suffix} for --format {chosen}", str(out))
    elif not out.name or out.suffix.lower() in (".ssp", ".fmu"):
        raise InputError("--out", f"must be a folder, or FILE.zip, for --format {chosen}", str(out))
    if not isdir(out.parent):
        raise InputError("--out", "must be in a folder that exists", str(out))
