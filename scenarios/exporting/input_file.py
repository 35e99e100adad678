"""A scenario's external signals as the CSV file that simulators take as input."""

from collections.abc import Mapping

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.runs.prepare import PreparedScenario

# A change of value at t_k lies between these times, in steps before t_k: early enough that a host's rounded clock
# finds the new value at t_k, late enough that steps of a fraction of the unit's do so too.
_OLD_UNTIL, _NEW_FROM = 0.011, 0.010


def input_table(prepared: PreparedScenario, inputs: Mapping[str, str]) -> bytes:
    """CSV with the time (s) and the inputs that the scenario's signals drive; empty where there are none.

    `inputs` has the columns' names by <instance>.<input>. Times increase strictly; linear interpolation and holding
    the last row give the same values at all multiples of the step.
    """
    places = {f"{owner}.{name}": place for owner, pairs in prepared.wiring.inputs.items() for name, place in pairs}
    driven = [drive.to for drive in prepared.scenario.input]
    names = [
        name for name in places if name in inputs and any(name == to or name.startswith(f"{to}[") for to in driven)
    ]
    if not names:
        return b""
    time: Array = np.arange(prepared.steps + 1, dtype=np.float64) * prepared.step
    signals = np.zeros((len(time), prepared.wiring.size))
    for span, signal in prepared.wiring.external:
        signals[:, span] = signal if isinstance(signal, float) else signal.sample(time)
    rows = _steps(time, signals[:, [places[name] for name in names]], prepared.step)
    header = ",".join(f'"{name}"' for name in ("time", *(inputs[name] for name in names)))
    return "\n".join([header, *(",".join(map(repr, row)) for row in rows.tolist()), ""]).encode()


def _steps(time: Array, values: Array, step: float) -> Array:
    """Rows (time, values) of a staircase with a steep edge right before each change."""
    changed = 1 + np.flatnonzero(np.any(values[1:] != values[:-1], axis=1))
    times = np.column_stack([time[changed] - _OLD_UNTIL * step, time[changed] - _NEW_FROM * step]).ravel()
    levels = np.stack([values[changed - 1], values[changed]], axis=1).reshape(-1, values.shape[1])
    return np.column_stack([np.r_[0.0, times, time[-1]], np.vstack([values[:1], levels, values[-1:]])])
