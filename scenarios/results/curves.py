"""Signals of a run as curves: looked up by name, with their quantity and the unit in which they are displayed.

The quantities are those of this project's units, by the names of their variables; a variable of another unit of
measurement, as third-party units have them, is a value in the unit that it declares.
"""

from collections.abc import Sequence
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
_SI = {"deflection": "m", "voltage": "V", "strain": "1", "force": "N"}
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


def quantity_of(base: str, unit: str | None = None) -> str:
    """The quantity of a signal (a key of DISPLAY_UNITS), by its variable's name without index.

    "value" where the variable's unit of measurement is known and not that of the quantity.
    """
    quantity = _QUANTITIES.get(base, "value")
    return quantity if unit is None or unit == _SI.get(quantity) else "value"


def display_unit(base: str, unit: str | None = None) -> tuple[str, float]:
    """The unit in which a signal is displayed, and its values in that unit as a multiple of the recorded ones."""
    quantity = quantity_of(base, unit)
    return ("" if unit in (None, "1") else str(unit), 1.0) if quantity == "value" else DISPLAY_UNITS[quantity]


@dataclass(frozen=True)
class Curve:
    """A recorded signal array, drawn in one row."""

    label: str
    base: str  # the variable's name without owner and index
    recording: Recording
    columns: list[int]  # of the recording

    @property
    def quantity(self) -> str:
        """A key of DISPLAY_UNITS."""
        return quantity_of(self.base, self._common_unit())

    @property
    def unit(self) -> str:
        """In which it is displayed; empty where there is none, or its elements differ."""
        return display_unit(self.base, self._common_unit())[0]

    @property
    def factor(self) -> float:
        """From recorded to displayed values."""
        return display_unit(self.base, self._common_unit())[1]

    def element(self, c: int) -> str:
        """The name of element c, for a title; with its unit where not all elements have the same."""
        column = self.recording.columns[self.columns[c]]
        number = _index(column)
        name = f"{_ELEMENTS[self.quantity] or self.base} {number}" if number else self.base
        own = self.recording.units.get(column, "")
        return f"{name} in {own}" if own and own != self._common_unit() else name

    def axis(self) -> str:
        """Quantity and unit, for an axis."""
        named = self.base if self.quantity == "value" else self.quantity
        return f"{named} in {self.unit}" if self.unit else self.base

    def _common_unit(self) -> str | None:
        """The unit of measurement of all elements, None where it is not known, empty where they differ."""
        known = self.recording.units
        units = {known.get(self.recording.columns[k]) for k in self.columns}
        return units.pop() if len(units) == 1 else ""


def _index(column: str) -> str:
    """The index at the end of a column's name, empty for a scalar."""
    return column.removeprefix(array_name(column))[1:-1]


def array_name(column: str) -> str:
    """The name of the array to which a column belongs."""
    return column[: column.rindex("[")] if column.endswith("]") and "[" in column else column


def array_names(columns: Sequence[str]) -> list[str]:
    """The arrays of a recording, in the order of their first columns."""
    return list(dict.fromkeys(map(array_name, columns)))


def curve(name: str, recording: Recording, label: str = "") -> Curve:
    """The recorded array or element `name`; InputError without a key where it is not recorded."""
    columns = column_indices(recording.columns, name)
    if not columns:
        hint = suggestion(name, array_names(recording.columns))
        raise InputError("", f"names a signal that is not recorded{hint}", name)
    base = array_name(name).partition(".")[2] or array_name(name)
    return Curve(label or name, base, recording, columns)


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
        chosen = [selected.columns[p - 1] for p in points if p <= len(selected.columns)]
        selected = Curve(label, selected.base, source, chosen)
    return selected


def align(curves: Sequence[tuple[Curve, int]]) -> tuple[Array, Array]:
    """The union of the times (rows,) of curves' elements, and each one's values at them (rows, elements), as displayed.

    They are NaN outside a recording's own time span. Recordings of one step share their times and are copied; others
    are interpolated linearly between their rows.
    """
    times = list({id(c.recording): c.recording.time for c, _ in curves}.values())
    equal = all(np.array_equal(own, times[0]) for own in times)
    time = times[0] if equal else np.unique(np.concatenate(times))
    values = np.empty((len(time), len(curves)))
    for k, (c, element) in enumerate(curves):
        own, column = c.recording.time, c.recording.values[:, c.columns[element]]
        if len(own) != len(time):
            column = np.interp(time, own, column, left=np.nan, right=np.nan)
        values[:, k] = column * c.factor
    return time, values
