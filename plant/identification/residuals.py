"""Weighted residuals of all experiments and their exact Jacobian in the coordinates of the search."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.modal import ModalDerivative, ModalForm
from flexbeams.plant.identification.sensitivity import Drive, Prediction, drive_of, modal_system, predict
from flexbeams.plant.identification.space import ParameterSpace


@dataclass(frozen=True, kw_only=True)
class SensorModel:
    """What is known of the sensors, and which of it is fitted as well; n_all sensors."""

    deviations: Array  # (n_all,): standard deviation of the noise, which weighs the residuals, m or 1
    delays: Array  # (n_all,), s, >= 0: known, or the start of the fit
    fit_delays: bool = False  # one for each sensor
    fit_offsets: bool = False  # one for each sensor and experiment


@dataclass(frozen=True, kw_only=True)
class Unknowns:
    """Where the unknowns are in the vector of the search, and the physical size of a unit of each.

    Parameters come first (units: see ParameterSpace), then delays, then offsets and loads of each experiment.
    """

    delays: slice
    offsets: tuple[slice, ...]
    starts: tuple[slice, ...]
    units: Array  # (size,), 1 for parameters
    lower: Array  # (size,)
    upper: Array  # (size,)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.units)


class Residuals:
    """Residuals (predicted less measured, each over its sensor's deviation), priors last, and their Jacobian.

    Rows are grouped by experiment, then by sensor. Every `stride`-th row of the data counts; the prediction
    itself takes all inputs.
    """

    def __init__(
        self,
        model: BeamModel,
        experiments: Sequence[Experiment],
        space: ParameterSpace,
        sensors: SensorModel,
        *,
        stride: int = 1,
    ) -> None:
        self.model, self.space, self.sensors, self.stride = model, space, sensors, stride
        self.drives = tuple(drive_of(experiment, model) for experiment in experiments)
        self.unknowns = self._unknowns()
        self.data_rows = sum(len(drive.rows) * self.rows_of(drive.experiment) for drive in self.drives)

    def rows_of(self, experiment: Experiment) -> int:
        """Rows of each sensor of an experiment that count."""
        return len(range(experiment.first_counted, experiment.rows, self.stride))

    def sensor_blocks(self) -> dict[int, list[slice]]:
        """Rows of the residuals that belong to each sensor, one slice an experiment."""
        blocks: dict[int, list[slice]] = {}
        position = 0
        for drive in self.drives:
            rows = self.rows_of(drive.experiment)
            for sensor in drive.experiment.sensors:
                blocks.setdefault(sensor, []).append(slice(position, position + rows))
                position += rows
        return blocks

    def predictions(self, x: Array, *, derivatives: bool = False) -> list[Prediction]:
        """The prediction of each experiment at x; DesignError where the parameters have no modal form."""
        values = self.space.values(x[: len(self.space.names)])
        delays = self.delays(x)
        systems = self._systems(values, derivatives)
        return [
            predict(
                *systems[drive.experiment.uncoupled],
                drive,
                delays=delays[list(drive.experiment.sensors)],
                start=self.loads(x, k),
                stride=self.stride,
            )
            for k, drive in enumerate(self.drives)
        ]

    def residuals(self, x: Array) -> Array:
        """The residuals (data_rows + p,) at x."""
        parts = []
        for k, prediction in enumerate(self.predictions(x)):
            parts.append(
                self._weighted(k, prediction.outputs + self.offsets(x, k)[:, None] - self._measured(k)).ravel()
            )
        return np.concatenate([*parts, x[: len(self.space.names)] / self.space.deviation])

    def jacobian(self, x: Array) -> Array:
        """Derivatives of the residuals (data_rows + p, size) at x, column by column in memory."""
        p, unknowns = len(self.space.names), self.unknowns
        transposed = np.zeros((unknowns.size, self.data_rows + p))
        slopes = self.space.slopes(x[:p])
        position = 0
        for k, prediction in enumerate(self.predictions(x, derivatives=True)):
            sensors, rows = prediction.outputs.shape
            block = slice(position, position + sensors * rows)
            position = block.stop
            columns = prediction.parameters * (slopes * self._felt_by(k))[:, None, None]
            transposed[:p, block] = self._weighted(k, columns).reshape(p, -1)
            starts = self._weighted(k, prediction.start).reshape(-1, sensors * rows)
            transposed[unknowns.starts[k], block] = starts * unknowns.units[unknowns.starts[k], None]
            by_sensor = transposed[:, block].reshape(-1, sensors, rows)
            weights = 1 / self.sensors.deviations[list(self.drives[k].experiment.sensors)]
            for s, sensor in enumerate(self.drives[k].experiment.sensors):
                if self.sensors.fit_delays:
                    at = unknowns.delays.start + sensor
                    by_sensor[at, s] = prediction.delay[s] * weights[s] * unknowns.units[at]
                if self.sensors.fit_offsets:
                    at = unknowns.offsets[k].start + s
                    by_sensor[at, s] = weights[s] * unknowns.units[at]
            transposed[:, block] = by_sensor.reshape(-1, sensors * rows)
        transposed[np.arange(p), self.data_rows + np.arange(p)] = 1 / self.space.deviation
        return transposed.T

    def with_loads(self, x: Array) -> Array:
        """x (size,) with the offsets and loads, in which the prediction is linear, that fit the data best."""
        linear = np.concatenate([np.r_[s] for s in (*self.unknowns.offsets, *self.unknowns.starts)]).astype(int)
        if len(linear) == 0:
            return x
        x = x.copy()
        x[linear] = 0
        columns = self.jacobian(x)[:, linear]
        x[linear] = -np.linalg.lstsq(columns, self.residuals(x), rcond=None)[0]
        return x

    def delays(self, x: Array) -> Array:
        """Delays (n_all,) of the sensors at x, s."""
        if not self.sensors.fit_delays:
            return self.sensors.delays
        at = self.unknowns.delays
        return np.maximum(self.sensors.delays + x[at] * self.unknowns.units[at], 0.0)

    def offsets(self, x: Array, experiment: int) -> Array:
        """Offsets (n_s,) of the sensors in one experiment."""
        at = self.unknowns.offsets[experiment]
        fitted: Array = x[at] * self.unknowns.units[at]
        return fitted if len(fitted) else np.zeros(len(self.drives[experiment].rows))

    def loads(self, x: Array, experiment: int) -> Array | None:
        """Released tip forces (r,) in N and impulses (r,) in N s of an experiment that starts freely."""
        at = self.unknowns.starts[experiment]
        return None if at.start == at.stop else x[at] * self.unknowns.units[at]

    def _felt_by(self, experiment: int) -> Array:
        """1 for the parameters (p,) that an experiment can feel, 0 for springs that were taken off."""
        off = self.drives[experiment].experiment.uncoupled
        return np.array([0.0 if off and name.startswith("spring[") else 1.0 for name in self.space.names])

    def _systems(
        self, values: dict[str, float], derivatives: bool
    ) -> dict[bool, tuple[ModalForm, list[ModalDerivative]]]:
        """Modal systems with the springs attached (False) and taken off (True), those that the data need."""
        free = list(self.space.names) if derivatives else []
        loose = {name: 0.0 for name in values if name.startswith("spring[")}
        systems = {}
        for uncoupled in {drive.experiment.uncoupled for drive in self.drives}:
            systems[uncoupled] = modal_system(self.model, {**values, **(loose if uncoupled else {})}, free)
        return systems

    def _measured(self, number: int) -> Array:
        experiment = self.drives[number].experiment
        return experiment.outputs[experiment.first_counted :: self.stride].T

    def _weighted(self, experiment: int, values: Array) -> Array:
        """Values (..., n_s, rows) over the sensors' deviations."""
        weighted: Array = values / self.sensors.deviations[list(self.drives[experiment].experiment.sensors), None]
        return weighted

    def _unknowns(self) -> Unknowns:
        units, lower, upper = [np.ones(len(self.space.names))], [self.space.lower], [self.space.upper]

        def append(count: int, unit: Array | float, low: Array | float = -np.inf) -> slice:
            start = sum(len(part) for part in units)
            units.append(np.broadcast_to(unit, count).astype(float))
            lower.append(np.broadcast_to(low, count).astype(float))
            upper.append(np.full(count, np.inf))
            return slice(start, start + count)

        step = self.drives[0].experiment.step
        all_sensors = len(self.sensors.deviations) if self.sensors.fit_delays else 0
        delays = append(all_sensors, step, -self.sensors.delays[:all_sensors] / step)
        offsets, starts = [], []
        for drive in self.drives:
            outputs = drive.experiment.outputs
            sizes = np.sqrt(np.mean(outputs**2, axis=0)) + self.sensors.deviations[list(drive.experiment.sensors)]
            offsets.append(
                append(
                    len(drive.rows) if self.sensors.fit_offsets else 0,
                    sizes[: len(drive.rows)] if self.sensors.fit_offsets else 1.0,
                )
            )
            starts.append(append(*self._load_units(drive)))
        return Unknowns(
            delays=delays,
            offsets=tuple(offsets),
            starts=tuple(starts),
            units=np.concatenate(units),
            lower=np.concatenate(lower),
            upper=np.concatenate(upper),
        )

    def _load_units(self, drive: Drive) -> tuple[int, Array | float]:
        """Number of unknown loads, and loads that move the sensors about as much as was measured."""
        tips = len(self.model.structure.beam)
        if drive.experiment.start == "rest":
            return 0, 1.0
        form, _ = modal_system(self.model, self.space.values(np.zeros(len(self.space.names))), [])
        unit = predict(form, [], drive, start=np.zeros(2 * tips)).start
        weights = 1 / self.sensors.deviations[list(drive.experiment.sensors), None]
        moved = np.sqrt(np.mean((unit * weights) ** 2, axis=(1, 2)))
        measured = np.sqrt(np.mean((drive.experiment.outputs.T * weights) ** 2))
        units: Array = measured / np.maximum(moved, 1e-300)
        return 2 * tips, units
