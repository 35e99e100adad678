"""Signals of a run as curves: looked up by name, with their quantity and the unit in which they are displayed."""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.results.checks import column_indices
from flexbeams.scenarios.simulation.recording import Recording

DISPLAY_UNITS = {
    "deflection": ("mm", 1e3),
    "voltage": ("V", 1.0),
    "strain": ("µm/m", 1e6),
    "force": ("N", 1.0),
    "value": ("", 1.0),
}
_ELEMENTS = {"deflection": "point", "voltage": "patch pair", "strain": "gauge", "force": "tip of beam", "value": ""}
_QUANTITIES = {
    "u": "voltage",
    "u_ff": "voltage",
    "planned_peak": "voltage",
    "voltage_limit": "voltage",
    "y_pi": "deflection",
    "y_ref": "deflection",
    "y_est": "deflection",
    "y_target": "deflection",
    "w": "deflection",
    "y_pm": "strain",
    "force": "force",
}


def quantity_of(base: str) -> str:
    """The quantity of a signal (a key of DISPLAY_UNITS), by its variable's name without index."""
    return _QUANTITIES.get(base, "value")


@dataclass(frozen=True)
class Curve:
    """A recorded signal array, drawn in one row."""

    label: str
    base: str  # the variable's name without owner and index
    quantity: str  # a key of DISPLAY_UNITS
    recording: Recording
    columns: list[int]  # of the recording

    def element(self, c: int) -> str:
        """The name of element c, for a title."""
        number = element_index(self.recording.columns[self.columns[c]])
        return f"{_ELEMENTS[self.quantity] or self.base} {number}" if number else self.base

    def axis(self) -> str:
        """Quantity and unit, for an axis."""
        unit = DISPLAY_UNITS[self.quantity][0]
        return f"{self.quantity} in {unit}" if unit else self.base


def element_index(column: str) -> str:
    """The index at the end of a column's name, empty for a scalar."""
    return column[column.rindex("[") + 1 : -1] if column.endswith("]") else ""


def array_name(column: str) -> str:
    """The name of the array to which a column belongs."""
    return column[: column.rindex("[")] if column.endswith("]") else column


def curve(name: str, recording: Recording, label: str = "") -> Curve:
    """The recorded array or element `name`; InputError without a key where it is not recorded."""
    columns = column_indices(recording.columns, name)
    if not columns:
        known = dict.fromkeys(map(array_name, recording.columns))
        raise InputError("", "names a signal that is not recorded" + suggestion(name, known), name)
    base = array_name(name).partition(".")[2] or array_name(name)
    return Curve(label or name, base, quantity_of(base), recording, columns)


def figure_curve(
    name: str, recording: Recording, open_loop: Recording | None, points: list[int] | None, key: str
) -> Curve:
    """A curve as a scenario's figure names it: open_loop.<signal> is taken from the open loop's run."""
    source, label = recording, name
    if name.startswith("open_loop."):
        if open_loop is None:
            raise InputError(f"{key}.rows", "needs the scenario's key open_loop", name)
        name, source, label = name.removeprefix("open_loop."), open_loop, "without control"
    try:
        selected = curve(name, source, label)
    except InputError as error:
        raise error.at("", f"{key}.rows") from None
    if points:
        selected = Curve(
            label,
            selected.base,
            selected.quantity,
            source,
            [selected.columns[p - 1] for p in points if p <= len(selected.columns)],
        )
    return selected


def align(recordings: list[Recording]) -> tuple[Array, list[Array]]:
    """The union of all recordings' times (rows,), and each recording's values at them, NaN outside its own time span.

    Recordings of one step share their times and are copied; others are interpolated linearly between their rows.
    """
    if all(np.array_equal(r.time, recordings[0].time) for r in recordings):
        return recordings[0].time, [r.values for r in recordings]
    time = np.unique(np.concatenate([r.time for r in recordings]))
    placed = []
    for recording in recordings:
        if np.array_equal(recording.time, time):
            placed.append(recording.values)
            continue
        rows = np.full((len(time), len(recording.columns)), np.nan)
        inside = (time >= recording.time[0]) & (time <= recording.time[-1])
        for k in range(len(recording.columns)):
            rows[inside, k] = np.interp(time[inside], recording.time, recording.values[:, k])
        placed.append(rows)
    return time, placed
