"""Data that a finished fit contradicts: exchanged or inverted sensors are refused, other misfits become warnings."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.channels import exchanged
from flexbeams.plant.identification.estimate import Search, Settings
from flexbeams.plant.identification.experiment import Experiment, sensor_names
from flexbeams.plant.identification.method import Identification
from flexbeams.plant.identification.quality import Fit, fits_of

BAD = 0.3  # residual over signal, rms, from which another place or sign of a sensor is tried
BETTER = 0.35  # residual with that over the residual without, below which it is the explanation
MISFIT = 0.03  # residual over signal of a point of interest beyond which a warning is given
EVALUATIONS = 15  # of each stage of a repeated fit
AT_BOUND = 1e-6  # in the coordinates of the search


def require_consistent(result: Identification, notify: Callable[[str], None] = lambda text: None) -> None:
    """InputError where two sensors exchanged, or one with the other sign, would fit the data far better.

    A gauge shows it in the finished fit, since gauges in doubt have a small weight. Points of interest bend the whole
    fit, so that it is repeated with each change of them; `notify` receives that in one line.
    """
    if result.estimate.interrupted:
        return
    names = sensor_names(result.structure)
    fits = [fit for fit in fits_of(result) if not fit.held_back]
    measured, predicted = _signals(fits, len(names))
    left = {s: _relative(measured[s], predicted[s]) for s in measured}
    for change in _changes([s for s in measured if left[s] > BAD], names):
        if any(len(measured[a]) != len(measured[b]) for a, b in change.items()):
            continue
        sign = -1.0 if len(change) == 1 else 1.0
        now = float(np.hypot.reduce([left[s] for s in change]))
        other = float(np.hypot.reduce([_relative(measured[a], sign * predicted[b]) for a, b in change.items()]))
        if other < BETTER * now:
            raise _explained(change, names, now / max(other, 1e-9))
    points = [s for s in measured if s < len(result.structure.point_of_interest)]
    if len(points) and float(np.median([left[s] for s in points])) > BAD:
        notify("other places and signs of the points of interest, since the fit is far from the data")
        _require_no_better_fit(result, points, names)


def _changes(sensors: Sequence[int], names: Sequence[str]) -> Iterator[dict[int, int]]:
    """Sensors to take another one's place, and one sensor to itself for a change of sign."""
    yield from ({a: b, b: a} for a, b in combinations(sensors, 2) if names[a][:4] == names[b][:4])
    yield from ({s: s} for s in sensors)


def _require_no_better_fit(result: Identification, points: Sequence[int], names: Sequence[str]) -> None:
    """Repeats the fit to thinned rows with each change of the points."""
    space = result.estimate.residuals.space
    experiments = [drive.experiment for drive in result.estimate.residuals.drives]
    sensors = result.estimate.residuals.sensors
    settings = Settings(
        delays=sensors.delays,
        fit_delays=sensors.fit_delays,
        fit_offsets=sensors.fit_offsets,
        evaluations=EVALUATIONS,
    )

    def misfit(change: dict[int, int]) -> float:
        search = Search(result.model, [_changed(e, change) for e in experiments], settings)
        return search.misfit(search.coarse(space, np.zeros(len(space.names))))

    now = misfit({})
    for change in _changes(points, names):
        other = misfit(change)
        if other < BETTER * now:
            raise _explained(change, names, now / max(other, 1e-9))


def _changed(experiment: Experiment, change: dict[int, int]) -> Experiment:
    """The experiment with two sensors exchanged, or one with the other sign."""
    at = {sensor: k for k, sensor in enumerate(experiment.sensors)}
    if not set(change) <= set(at):
        return experiment
    outputs = experiment.outputs.copy()
    for a, b in change.items():
        outputs[:, at[a]] = (-1.0 if a == b else 1.0) * experiment.outputs[:, at[b]]
    return replace(experiment, outputs=outputs)


def _explained(change: dict[int, int], names: Sequence[str], better: float) -> InputError:
    first, second = next(iter(change.items()))
    if first != second:
        return exchanged(names[first], names[second], better)
    name = names[first]
    return InputError(
        f"column {name!r}",
        f"has the wrong sign, it seems: the other sign explains the data {better:.0f} times better; try "
        f"--map '{name}={name}*-1'",
    )


def warnings_of(result: Identification, fits: Sequence[Fit]) -> list[str]:
    """What speaks against a fit, one line each: large residuals of deflections, and parameters at their bounds."""
    return [*_misfits(result, fits), *_bounds(result)]


def _misfits(result: Identification, fits: Sequence[Fit]) -> Iterator[str]:
    names = sensor_names(result.structure)
    points = set(names[: len(result.structure.point_of_interest)])
    for fit in fits:
        relative = fit.relative_by_sensor(names)
        listed = [f"{100 * r:.0f} % of {name}" for name, r in relative.items() if name in points and r > MISFIT]
        if listed:
            yield (
                f"{fit.name}: the fit leaves {', '.join(listed)}; if that is not noise, geometry, sensors or the start "
                f"do not belong to these data"
            )


def _bounds(result: Identification) -> Iterator[str]:
    space = result.estimate.residuals.space
    x = result.estimate.x[: len(space.names)]
    at = (x - space.lower < AT_BOUND) | (space.upper - x < AT_BOUND)
    for name in np.array(space.names)[at]:
        yield f"{name} ends at its bound; its interval does not hold"


def _signals(fits: Sequence[Fit], sensors: int) -> tuple[dict[int, Array], dict[int, Array]]:
    """Measured and predicted values of each sensor over all experiments."""
    measured: dict[int, Array] = {}
    predicted: dict[int, Array] = {}
    for sensor in range(sensors):
        columns = [(f, f.experiment.sensors.index(sensor)) for f in fits if sensor in f.experiment.sensors]
        if columns:
            measured[sensor] = np.concatenate([f.measured[:, k] for f, k in columns])
            predicted[sensor] = np.concatenate([f.predicted[:, k] for f, k in columns])
    return measured, predicted


def _relative(measured: Array, predicted: Array) -> float:
    return float(np.linalg.norm(measured - predicted) / max(float(np.linalg.norm(measured)), 1e-300))
