"""Sensors of a recording: what instruments with delay, noise and finite resolution make of the recorded signals.

Units exchange the true signals; a sensor changes what is recorded.
"""

from collections.abc import Sequence
from zlib import crc32

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.definition.schema import Sensor
from flexbeams.scenarios.simulation.recording import Recording

WHOLE = 1e-6  # of a row by which a delay may be off


def require_sensors(sensors: Sequence[Sensor], columns: Sequence[str], row_step: float, source: str) -> None:
    """InputError for a sensor of a signal that is not recorded, or that has one, and for a delay between two rows.

    Rows are `row_step` s apart.
    """
    taken: set[str] = set()
    for k, sensor in enumerate(sensors, 1):
        key = f"sensor[{k}]"
        names = element_names(dict.fromkeys(columns), sensor.of)
        if not names:
            known = dict.fromkeys(c.partition("[")[0] for c in columns)
            rule = "names a signal that is not recorded" + suggestion(sensor.of, known)
            raise InputError(f"{key}.of", rule, sensor.of, source=source)
        if repeated := [name for name in names if name in taken]:
            raise InputError(f"{key}.of", "must have no other sensor", repeated[0], source=source)
        taken.update(names)
        if abs(sensor.delay / row_step - round(sensor.delay / row_step)) > WHOLE:
            rule = f"must be a whole number of recorded steps of {row_step:g} s"
            raise InputError(f"{key}.delay", rule, sensor.delay, source=source)


def measure(recording: Recording, sensors: Sequence[Sensor], row_step: float) -> None:
    """Replaces the values of the sensors' columns by what these record."""
    for sensor in sensors:
        for name in element_names(dict.fromkeys(recording.columns), sensor.of):
            column = recording.values[:, recording.columns.index(name)]
            column[:] = measured(name, column, sensor, recording.time, row_step)


def measured(name: str, values: Array, sensor: Sensor, time: Array, row_step: float) -> Array:
    """A column (rows,) as its sensor records it: delayed, then with white noise, then rounded to its resolution.

    `time` (rows,) in s has steps of `row_step` s; the last one may be shorter. Before the delay has passed, the sensor
    shows the first value. The noise of a column depends on its name and the sensor's seed only, so that other columns
    and a later stop time do not change it.
    """
    rows = min(round(sensor.delay / row_step), len(values))
    if rows:
        delayed = np.concatenate([np.full(rows, values[0]), values[: len(values) - rows]])
        if len(time) > 1 and time[-1] - time[-2] < (1 - WHOLE) * row_step:
            delayed[-1] = np.interp(time[-1] - sensor.delay, time, values)
        values = delayed
    if sensor.noise:
        generator = np.random.default_rng([sensor.seed, crc32(name.encode())])
        values = values + sensor.noise * generator.standard_normal(len(values))
    if sensor.resolution:
        values = sensor.resolution * np.round(values / sensor.resolution) + 0.0  # no negative zero
    return values
