"""Identification of hysteresis and creep from measured loops."""

from collections.abc import Callable, Mapping
from pathlib import Path

from flexbeams.plant.identification.actuator_file import write_pair
from flexbeams.plant.identification.hysteresis import MOST_PLAYS, HysteresisFit, fit_hysteresis
from flexbeams.plant.identification.loops import LoopColumns, read_loops
from flexbeams.plant.structure import find_structure
from flexbeams.scenarios.api.identifications import reading_of
from flexbeams.scenarios.definition.arguments import integer
from flexbeams.scenarios.report.hysteresis import write_hysteresis_page
from flexbeams.scenarios.runs.observer import ignore_note


def identify_hysteresis(
    file: str | Path,
    *,
    structure: str | Path = "kiel",
    pair: int | None = None,
    sensor: str | None = None,
    plays: int | None = None,
    columns: Mapping[str, str | tuple[str, float]] | None = None,
    out: str | Path | None = None,
    report: str | Path | None = None,
    notify: Callable[[str], None] = ignore_note,
) -> HysteresisFit:
    """Fits hysteresis and creep of one patch pair to measured loops, for the section [actuator] of a structure.

    Drive the pair slowly, up and down through its whole range and back to zero in between, then through smaller loops.

    Parameters
    ----------
    file
        CSV file with the columns time in s, u[k] in V, and y_pi[k] in m or y_pm[k].
    structure
        Where `out` takes all other values from: a shipped name or a structure file with a section [actuator].
    pair
        Patch pair, from 1 (default: the only one whose voltage changes).
    sensor
        Response, such as y_pi[1] (default: what follows the voltage best).
    plays
        Number of play operators, 1 to 12 (default: by cross-validation).
    columns
        Column of a signal, or column and factor to SI: {"y_pi[1]": ("laser 1 [mm]", 1e-3)}.
    out, report
        Structure file and page to write.
    notify
        Receives the error of each number of play operators that is tried, one line each.

    Returns
    -------
    HysteresisFit
        The fitted `pair`, its residual in shares of the stroke (`largest`, `rms`, `explained`), and what a compensator
        made of it would leave on these data (`largest_remaining`, `rms_remaining`).

    Raises
    ------
    InputError
        Where the data do not show hysteresis, and where an option or the structure breaks a rule.

    Examples
    --------
    >>> import flexbeams as fb
    >>> from importlib.resources import files
    >>> loops = files("flexbeams.plant") / "identification/mfc_loops.csv"
    >>> fit = fb.identify_hysteresis(loops, plays=4, out="results/rig.toml")
    >>> f"{100 * fit.line:.1f} % off a straight line, {100 * fit.largest:.1f} % left"
    '5.2 % off a straight line, 1.1 % left'
    >>> fb.structure("results/rig.toml").actuator.pair[0] == fit.pair
    True
    """
    pair = None if pair is None else integer("pair", pair, 1)
    plays = None if plays is None else integer("plays", plays, 1, MOST_PLAYS)
    loops = read_loops(
        Path(file), LoopColumns(pair=pair, sensor=sensor, mapping=dict(reading_of(columns or {}).columns))
    )
    fit = fit_hysteresis(
        loops, plays, lambda count, error: notify(f"{count} play operators: {100 * error:.3g} % on rows held back")
    )
    if out is not None:
        write_pair(find_structure(str(structure)), loops.pair, fit, Path(out))
    if report is not None:
        write_hysteresis_page(fit, Path(report))
    return fit
