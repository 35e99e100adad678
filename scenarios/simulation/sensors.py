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
    """Replaces the values of the sensors' columns by what these record; rows are `row_step` s apart."""
    instruments = {
        recording.columns.index(name): Instrument(name, sensor, row_step)
        for sensor in sensors
        for name in element_names(dict.fromkeys(recording.columns), sensor.of)
    }

    def show(time: Array, values: Array, last: bool) -> None:
        for column, instrument in instruments.items():
            values[:, column] = instrument.shows(time, values[:, column], last)

    if instruments:
        recording.change(show)


class Instrument:
    """A column as its sensor records it, block after block: delayed, with white noise, rounded to its resolution.

    Before the delay has passed, the sensor shows the first value. The noise of a column depends on its name and the
    sensor's seed only, so that other columns and a later stop time do not change it.
    """

    def __init__(self, name: str, sensor: Sensor, row_step: float) -> None:
        self._sensor, self._row_step = sensor, row_step
        self._rows = round(sensor.delay / row_step)
        self._time, self._values = np.empty(0), np.empty(0)  # true values that a later row may show
        self._noise = np.random.default_rng([sensor.seed, crc32(name.encode())])

    def shows(self, time: Array, values: Array, last: bool) -> Array:
        """What it shows of the next rows (k,); the last step of the last block may be shorter."""
        sensor = self._sensor
        if self._rows:
            values = self._delayed(time, values, last)
        if sensor.noise:
            values = values + sensor.noise * self._noise.standard_normal(len(values))
        if sensor.resolution:
            values = sensor.resolution * np.round(values / sensor.resolution) + 0.0  # no negative zero
        return values

    def _delayed(self, time: Array, values: Array, last: bool) -> Array:
        known = np.concatenate([self._values, values])
        times = np.concatenate([self._time, time])
        first = len(self._values) - self._rows  # of the shown rows among the known ones
        shown = known[np.maximum(np.arange(first, first + len(values)), 0)]
        if last and len(times) > 1 and times[-1] - times[-2] < (1 - WHOLE) * self._row_step:
            shown[-1] = np.interp(times[-1] - self._sensor.delay, times, known)
        self._time, self._values = times[-self._rows - 1 :], known[-self._rows - 1 :]
        return shown
