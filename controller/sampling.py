"""The sample time against the retained modes."""

from collections.abc import Callable

import numpy as np

from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ReducedModel
from flexbeams.plant.errors import DesignError


def sampling_warnings(
    reduced: ReducedModel, options: DesignOptions, reduce_to: Callable[[int], ReducedModel]
) -> list[str]:
    """A line where a retained mode lies above a third of the Nyquist frequency.

    Raises DesignError where one lies above the sampling frequency, beyond which voltages cannot act on it, and names
    the largest reduced_modes that fits; `reduce_to` gives the model for other values of it.
    """
    fastest, sampling = fastest_mode(reduced), 2 * np.pi / options.sample_time
    if fastest > sampling:
        raise DesignError(
            f"sample_time = {options.sample_time:g} s is too long for the retained mode at {fastest:.4g} rad/s: the "
            f"Nyquist frequency is {sampling / 2:.4g} rad/s and the sampling frequency {sampling:.4g} rad/s; "
            f"{_fitting(options.reduced_modes, sampling, reduce_to)}, or a sample time of at most "
            f"{np.floor(2e4 * np.pi / fastest) / 1e4:g} s"
        )
    if fastest > sampling / 6:
        return [
            f"the retained mode at {fastest:.4g} rad/s lies above a third of the Nyquist frequency, "
            f"{sampling / 6:.4g} rad/s, of sample_time = {options.sample_time:g} s"
        ]
    return []


def fastest_mode(reduced: ReducedModel) -> float:
    """Largest magnitude of the eigenvalues, rad/s."""
    return float(np.max(np.abs(np.linalg.eigvals(reduced.A))))


def _fitting(reduced_modes: int, sampling: float, reduce_to: Callable[[int], ReducedModel]) -> str:
    for modes in range(reduced_modes - 1, 0, -1):
        try:
            if fastest_mode(reduce_to(modes)) <= sampling:
                return f"reduced_modes = {modes} fits"
        except DesignError:
            continue
    return "no reduced_modes fits"
