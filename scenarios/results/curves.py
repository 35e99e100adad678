"""Signals of a run as curves: names from a scenario's figures, what they are, and in which unit they are shown."""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.results.metrics import column_indices
from flexbeams.scenarios.simulation.recording import Recording

SHOWN = {
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
    """What a unit's signal is, by its variable's name without index."""
    return _QUANTITIES.get(base, "value")


@dataclass(frozen=True)
class Curve:
    """A signal array of one of the recordings, to be drawn in one row."""

    label: str
    base: str  # the variable's name without owner and index
    quantity: str  # a key of SHOWN
    recording: Recording
    places: list[int]  # columns of the recording

    def element(self, c: int) -> str:
        """What element c is, for a title."""
        number = index_of(self.recording.columns[self.places[c]])
        return f"{_ELEMENTS[self.quantity] or self.base} {number}" if number else self.base

    def axis(self) -> str:
        """Quantity and unit, for an axis."""
        unit = SHOWN[self.quantity][0]
        return f"{self.quantity} in {unit}" if unit else self.base


def index_of(column: str) -> str:
    """The index in a column's name, empty for a scalar."""
    return column[column.rindex("[") + 1 : -1] if column.endswith("]") else ""


def array_of(column: str) -> str:
    """The array that a column is an element of."""
    return column[: column.rindex("[")] if column.endswith("]") else column


def curve(name: str, recording: Recording, label: str = "") -> Curve:
    """The recorded array or element `name`; InputError without a key where it is not recorded."""
    places = column_indices(recording.columns, name)
    if not places:
        known = dict.fromkeys(map(array_of, recording.columns))
        raise InputError("", "names a signal that is not recorded" + suggestion(name, known), name)
    base = array_of(name).split(".", 1)[1]
    return Curve(label or name, base, quantity_of(base), recording, places)


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
        found = curve(name, source, label)
    except InputError as error:
        raise error.at("", f"{key}.rows") from None
    if points:
        found = Curve(
            label, found.base, found.quantity, source, [found.places[p - 1] for p in points if p <= len(found.places)]
        )
    return found


def on_one_time(recordings: list[Recording]) -> tuple[Array, list[Array]]:
    """Times of all recordings together (rows,), and each one's rows there, NaN where it has not begun or has ended.

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
