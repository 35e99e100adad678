"""Outputs of an experiment and their exact derivatives with respect to parameters, delays and unknown starts."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.modal import (
    ComplexArray,
    ModalDerivative,
    ModalForm,
    modal_derivative,
    modal_form,
    reciprocal_distances,
)
from flexbeams.plant.identification.response import Channel, ModeResponses, mode_responses

_RANK = 1e-12  # singular values of the inputs below this share of the largest are rounding


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Outputs of one experiment and their derivatives; p parameters, n_s sensors."""

    outputs: Array  # (n_s, rows), m or 1
    parameters: Array  # (p, n_s, rows), per unit of each parameter
    delay: Array  # (n_s, rows), with respect to each sensor's delay, per s
    start: Array  # (2 r, n_s, rows), per N of released tip force, then per N s of impulse; (0, ...) at rest


@dataclass(frozen=True, kw_only=True)
class Drive:
    """The inputs of an experiment as functions of time, ready for prediction."""

    experiment: Experiment
    channels: tuple[Channel, ...]  # directions (n_u + r,)
    rows: Array  # (n_s, n): sensor = rows q


def drive_of(experiment: Experiment, model: BeamModel) -> Drive:
    """The drive of an experiment: as few channels as its inputs have rank, since the cost grows with channels."""
    tips = len(model.structure.beam)
    forces = np.zeros((experiment.rows, tips)) if experiment.forces is None else experiment.forces
    rest = np.zeros(tips + experiment.voltages.shape[1])
    if experiment.rest_voltages is not None:
        rest[:-tips] = experiment.rest_voltages
    values = np.vstack([rest, np.hstack([experiment.voltages, forces])])
    _, sizes, directions = np.linalg.svd(np.linalg.qr(values, mode="r"))
    rank = max(1, int(np.sum(sizes > _RANK * sizes[0])))
    signals = values @ directions[:rank].T
    channels = [
        Channel(direction=direction, signal=signal[1:].copy(), rest=float(signal[0]))
        for direction, signal in zip(directions[:rank], signals.T, strict=True)
    ]
    if experiment.start == "free":
        nothing, still = np.zeros(experiment.rows), np.zeros(len(rest))
        channels.append(Channel(direction=still, signal=nothing, rest=1.0))
        channels.append(Channel(direction=still, signal=nothing, impulse=1.0))
    sensors = np.vstack([model.deflection, model.strain])
    return Drive(experiment=experiment, channels=tuple(channels), rows=sensors[list(experiment.sensors)])


def modal_system(
    model: BeamModel, values: dict[str, float], free: list[str]
) -> tuple[ModalForm, list[ModalDerivative]]:
    """The modal form of all parameters `values` and its derivatives with respect to the `free` ones.

    Raises DesignError as modal_form does.
    """
    form = modal_form(model, values)
    terms = {term.parameter: term for term in model.terms}
    reciprocal = reciprocal_distances(form)
    return form, [modal_derivative(form, terms[name], reciprocal) for name in free]


def predict(
    form: ModalForm,
    derivatives: list[ModalDerivative],
    drive: Drive,
    *,
    delays: Array | None = None,
    start: Array | None = None,
    stride: int = 1,
) -> Prediction:
    """Outputs and derivatives for one modal form, of every `stride`-th row that counts.

    `delays` (n_s,) in s, >= 0, are those of the sensors; `start` (2 r,) are the released tip forces in N and the
    impulses in N s of a free start.
    """
    sensors, rows = len(drive.rows), len(range(drive.experiment.first_counted, drive.experiment.rows, stride))
    delays = np.zeros(sensors) if delays is None else delays
    channels = _with_start(drive, start)
    loads = 2 * len(form.model.structure.beam) if drive.experiment.start == "free" else 0
    outputs, delay = np.empty((sensors, rows)), np.empty((sensors, rows))
    parameters, starts = np.empty((len(derivatives), sensors, rows)), np.empty((loads, sensors, rows))
    for value in np.unique(delays):
        group = np.flatnonzero(delays == value)
        part = _predict_group(form, derivatives, channels, drive, group, float(value), stride)
        outputs[group], delay[group] = part.outputs, part.delay
        parameters[:, group], starts[:, group] = part.parameters, part.start
    return Prediction(outputs=outputs, parameters=parameters, delay=delay, start=starts)


def _with_start(drive: Drive, start: Array | None) -> list[Channel]:
    """The channels with the directions of a free start filled in."""
    channels = list(drive.channels)
    if drive.experiment.start == "rest":
        return channels
    voltages = drive.experiment.voltages.shape[1]
    tips = len(channels[0].direction) - voltages
    halves = np.zeros((2, tips)) if start is None else np.reshape(start, (2, tips))
    for k, half in enumerate(halves):
        channels[k - 2] = replace(channels[k - 2], direction=np.concatenate([np.zeros(voltages), half]))
    return channels


def _predict_group(
    form: ModalForm,
    derivatives: list[ModalDerivative],
    channels: list[Channel],
    drive: Drive,
    group: NDArray[np.intp],
    delay: float,
    stride: int,
) -> Prediction:
    """The prediction of the sensors `group`, which share one delay."""
    whole = mode_responses(form, channels, drive.experiment.step, delay, slopes=bool(derivatives))
    responses = whole.every(drive.experiment.first_counted, stride)
    rate = form.poles[:, None, None] * responses.z + responses.signals  # dz/dt
    sensor_rows = drive.rows[group]
    directions = np.stack([channel.direction for channel in channels], axis=1)  # (m, c)
    shapes = sensor_rows @ form.right[:, form.kept]  # (s, k)
    inputs = form.inputs[form.kept] @ directions  # (k, c)
    weighted = form.weights * shapes  # (s, k)
    residues = weighted[:, :, None] * inputs
    z = _features(responses.z)
    outputs = _coefficients(residues) @ z
    delayed = -_coefficients(residues) @ _features(rate)
    count, sensors, rows = len(derivatives), len(group), z.shape[1]
    blocks = [
        np.hstack([_coefficients(part) for part in _parts(form, derivative, sensor_rows, directions, weighted, inputs)])
        for derivative in derivatives
    ]
    parameters = np.empty((0, rows))
    if blocks:
        parameters = np.vstack(blocks) @ np.vstack([z, _features(responses.slope), _features(responses.pairs)])
    return Prediction(
        outputs=outputs,
        delay=delayed,
        parameters=parameters.reshape(count, sensors, rows),
        start=_start_derivatives(form, drive, responses, weighted),
    )


def _parts(
    form: ModalForm,
    derivative: ModalDerivative,
    sensor_rows: Array,
    directions: Array,
    weighted: ComplexArray,
    inputs: ComplexArray,
) -> list[ComplexArray]:
    """Coefficients (s, k, c) of one derivative for z, for dz/dlambda and for the near pairs."""
    bending = form.weights * (sensor_rows @ derivative.bending)
    residue = weighted[:, :, None] * (derivative.mixing @ directions) - bending[:, :, None] * inputs
    slope = (weighted * derivative.shift)[:, :, None] * inputs
    pairs = np.empty((len(sensor_rows), len(form.pairs), directions.shape[1]), dtype=complex)
    for p, ((i, j), (forward, backward)) in enumerate(zip(form.pairs, derivative.coupling, strict=True)):
        pairs[:, p] = forward * np.outer(weighted[:, i], inputs[j]) + backward * np.outer(weighted[:, j], inputs[i])
    return [residue, slope, pairs]


def _start_derivatives(form: ModalForm, drive: Drive, responses: ModeResponses, weighted: ComplexArray) -> Array:
    """Derivatives (2 r, s, rows) with respect to the unknown loads of a free start."""
    sensors, rows = len(weighted), responses.z.shape[2]
    if drive.experiment.start == "rest":
        return np.empty((0, sensors, rows))
    tips = form.inputs[form.kept, drive.experiment.voltages.shape[1] :]  # (k, r)
    derivatives = [
        _coefficients(weighted[:, :, None] * tips[:, j, None, None].swapaxes(0, 1))
        @ _features(responses.z[:, [channel]])
        for channel in (-2, -1)
        for j in range(tips.shape[1])
    ]
    return np.stack(derivatives)


def _features(responses: ComplexArray) -> Array:
    """Real and imaginary parts of responses (k, c, rows) as rows (2 k c, rows)."""
    flat = responses.reshape(-1, responses.shape[-1])
    return np.vstack([flat.real, flat.imag])


def _coefficients(residues: ComplexArray) -> Array:
    """Coefficients (s, k, c) as rows (s, 2 k c), so that their product with _features is the real part."""
    flat = residues.reshape(len(residues), -1)
    return np.hstack([flat.real, -flat.imag])
