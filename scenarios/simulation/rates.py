"""Signals that are recorded at fewer steps than others: between these, a row holds the value of the one before."""

from collections.abc import Mapping, Sequence

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.simulation.recording import Recording


def require_rates(rates: Mapping[str, int], columns: Sequence[str], decimate: int) -> None:
    """InputError for a signal that is not recorded, and for steps that have no row."""
    for name, every in rates.items():
        if not element_names(dict.fromkeys(columns), name):
            known = dict.fromkeys(c.partition("[")[0] for c in columns)
            raise InputError("--record-every", "names a signal that is not recorded" + suggestion(name, known), name)
        if every < 1 or every % decimate:
            rule = f"of {name} must be a multiple of {decimate}, the steps from row to row"
            raise InputError("--record-every", rule, every)


def hold(recording: Recording, rates: Mapping[str, int]) -> None:
    """Holds the values of signals between the steps at which they are recorded; the last row is always a new one.

    `rates` gives arrays or elements, and the number of steps from one value to the next.
    """
    rows = {
        recording.columns.index(column): every // recording.decimate
        for name, every in rates.items()
        for column in element_names(dict.fromkeys(recording.columns), name)
    }
    held = np.zeros(len(recording.columns))
    begin = 0

    def keep(time: Array, values: Array, last: bool) -> None:
        nonlocal begin
        end, numbers = values[-1].copy(), np.arange(begin, begin + len(values))
        for column, every in rows.items():
            taken = numbers - numbers % every - begin  # row of the block with the value, negative before the block
            shown = np.where(taken < 0, held[column], values[np.maximum(taken, 0), column])
            held[column] = shown[-1]
            values[:, column] = shown
        if last:
            values[-1] = end
        begin += len(values)

    if rows:
        recording.change(keep)
