"""Measured loops of one patch pair: voltage and response over time, checked for what a fit of hysteresis needs."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.identification.reading import Column, Reading, even_step, signal_column
from flexbeams.plant.number_table import read_number_table

NOISE = 0.02  # of the voltage range: smaller reversals are no turning points
FLAT = 0.05  # of the voltage range over which a response that stands still is saturated
FOLLOWS = 0.5  # share of the response's variance that the voltage must explain
SMALLEST_RANGE = 20.0  # V; voltages of patches span more
LARGEST_RESPONSE = {"y_pi": 0.5, "y_pm": 0.02}  # m and 1


@dataclass(frozen=True, kw_only=True)
class Loops:
    """Rows of one file, in equal steps."""

    name: str
    pair: int  # from 1
    step: float  # s
    voltage: Array  # (n,), V
    response: Array  # (n,), m or 1
    sensor: str  # y_pi[2], y_pm[1]
    turns: list[int]  # rows of turning points, with the first and the last row
    first_counted: int  # row from which on the states of all play operators are known: both extremes have been reached

    @property
    def stroke(self) -> float:
        """Range of the response."""
        return float(np.ptp(self.response[self.first_counted :]))


@dataclass(frozen=True, kw_only=True)
class LoopColumns:
    """Which columns of a file are read; None takes the only candidate."""

    pair: int | None = None
    sensor: str | None = None
    mapping: dict[str, Column] = field(default_factory=dict)


def read_loops(path: Path, columns: LoopColumns | None = None) -> Loops:
    """The loops in a CSV file with columns time, u[k] (V) and y_pi[k] (m) or y_pm[k] (1).

    Of several voltages the only one that changes is taken, of several sensors the one that follows it best. Raises
    InputError with row and reason for data from which hysteresis cannot be identified.
    """
    columns = columns or LoopColumns()
    source, reading = str(path), Reading(columns=columns.mapping)
    table = read_number_table(path)
    header, values = table.header, table.values
    time = signal_column("time", header, values, reading, source, required=True)
    assert time is not None
    step = even_step(time, table.rows, source)
    names = [*dict.fromkeys([*(name.rpartition(".")[2] for name in header), *columns.mapping])]
    pair, voltage = _voltage(names, columns, header, values, reading, source)
    turns = turning_points(voltage)
    _require_loops(voltage, turns, source)
    sensor, response = _response(names, columns, header, values, reading, source, voltage)
    _require_units(voltage, sensor, response, source)
    _require_following(time, voltage, response, sensor, source)
    _require_unsaturated(voltage, response, sensor, source)
    first = max(int(np.argmax(voltage)), int(np.argmin(voltage)))
    if len([t for t in turns if t > first]) < 2 or len(voltage) - first < 50:
        raise InputError(
            f"row {first + 2}",
            "is where the voltage has first reached both extremes: a loop must follow, of at least 50 rows",
            len(voltage) - first - 1,
            source=source,
        )
    return Loops(
        name=path.stem,
        pair=pair,
        step=step,
        voltage=voltage,
        response=response,
        sensor=sensor,
        turns=turns,
        first_counted=first,
    )


def turning_points(voltage: Array) -> list[int]:
    """Rows at which the voltage turns by more than NOISE of its range; the first and the last row are among them."""
    least = NOISE * float(np.ptp(voltage))
    turns, candidate, direction = [0], 0, 0
    for row, value in enumerate(voltage.tolist()):
        change = value - float(voltage[candidate])
        if direction == 0:
            if abs(change) > least:
                candidate, direction = row, 1 if change > 0 else -1
        elif change * direction >= 0:
            candidate = row
        elif abs(change) > least:
            turns.append(candidate)
            candidate, direction = row, -direction
    return [*turns, len(voltage) - 1]


def _voltage(
    names: list[str], columns: LoopColumns, header: list[str], values: Array, reading: Reading, source: str
) -> tuple[int, Array]:
    if columns.pair is not None:
        chosen = signal_column(f"u[{columns.pair}]", header, values, reading, source, required=True)
        assert chosen is not None
        return columns.pair, chosen
    found = {n: signal_column(n, header, values, reading, source) for n in names if n == "u" or n.startswith("u[")}
    if not found:
        raise InputError("column 'u[1]'", "is missing" + suggestion("u[1]", header), source=source)
    changing = {n: v for n, v in found.items() if v is not None and np.ptp(v) > 0}
    if len(changing) != 1:
        rule = f"must be chosen with --pair: {', '.join(changing)} change" if changing else "must change"
        raise InputError("column 'u[1]'" if not changing else "the voltage", rule, source=source)
    [(name, voltage)] = changing.items()
    return int(name[2:-1] or 1) if name.startswith("u[") and name[2:-1].isdigit() else 1, voltage


def _response(
    names: list[str],
    columns: LoopColumns,
    header: list[str],
    values: Array,
    reading: Reading,
    source: str,
    voltage: Array,
) -> tuple[str, Array]:
    wanted = [columns.sensor] if columns.sensor else [n for n in names if n.startswith(("y_pi[", "y_pm["))]
    found = {n: signal_column(n, header, values, reading, source, required=bool(columns.sensor)) for n in wanted}
    moving = {n: v for n, v in found.items() if v is not None and np.ptp(v) > 0}
    if not moving:
        rule = "must change" if found else "is missing; y_pi[k] are deflections in m, y_pm[k] strains"
        raise InputError("column of a sensor", rule, source=source)
    return max(moving.items(), key=lambda item: abs(float(np.corrcoef(voltage, item[1])[0, 1])))


def _require_loops(voltage: Array, turns: list[int], source: str) -> None:
    if len(turns) < 5:
        last = turns[-2]
        raise InputError(
            f"row {last + 2}",
            "is the last turning point of the voltage: it must turn at least three times, through its range",
            len(turns) - 2,
            source=source,
        )


def _require_units(voltage: Array, sensor: str, response: Array, source: str) -> None:
    span = float(np.ptp(voltage))
    if span < SMALLEST_RANGE:
        row = int(np.argmax(voltage)) + 2
        hint = f" (in kV? then --map u=COLUMN*1000, {1000 * span:g} V)" if 1000 * span >= SMALLEST_RANGE else ""
        raise InputError(
            f"row {row}", f"the voltage must span at least {SMALLEST_RANGE:g} V{hint}", span, source=source
        )
    limit = LARGEST_RESPONSE[sensor[:4]]
    row = int(np.argmax(np.abs(response)))
    if abs(response[row]) > limit:
        unit = ("m", "mm") if sensor.startswith("y_pi") else ("m/m", "µm/m")
        factor = 1e-3 if sensor.startswith("y_pi") else 1e-6
        hint = f"in {unit[1]}? then --map {sensor}=COLUMN*{factor:g}"
        raise InputError(
            f"row {row + 2}, {sensor}",
            f"must be within {limit:g} {unit[0]} ({hint})",
            float(response[row]),
            source=source,
        )


def _require_following(time: Array, voltage: Array, response: Array, sensor: str, source: str) -> None:
    """The response follows the voltage, not only the time."""
    trend = np.column_stack([np.ones_like(time), time - time[0]])
    both = np.column_stack([trend, voltage])
    left = [float(np.sum((response - A @ np.linalg.lstsq(A, response, rcond=None)[0]) ** 2)) for A in (trend, both)]
    share = 1.0 - left[1] / left[0] if left[0] > 0 else 0.0
    if not share > FOLLOWS:
        row = int(np.argmax(np.abs(response - np.mean(response)))) + 2
        raise InputError(
            f"row {row}, {sensor}",
            f"the response drifts or is noise: the voltage must explain more than {FOLLOWS:.0%} of what a trend leaves",
            round(share, 3),
            source=source,
        )


def _require_unsaturated(voltage: Array, response: Array, sensor: str, source: str) -> None:
    """No extreme value of the response holds while the voltage moves on: that is a sensor at its end."""
    for extreme in (float(np.max(response)), float(np.min(response))):
        at = np.flatnonzero(response == extreme)
        runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        for run in runs:
            if len(run) >= 5 and np.ptp(voltage[run]) > FLAT * np.ptp(voltage):
                raise InputError(
                    f"row {run[0] + 2}, {sensor}",
                    f"is saturated: {len(run)} rows have one value while the voltage moves by "
                    f"{float(np.ptp(voltage[run])):.4g} V",
                    extreme,
                    source=source,
                )
