"""The sample time against the retained modes."""

import numpy as np

from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ReducedModel
from flexbeams.plant.errors import DesignError


def sampling_warnings(reduced: ReducedModel, options: DesignOptions, beams: int) -> list[str]:
    """A line where a retained mode lies above a third of the Nyquist frequency.

    Raises DesignError where one lies above the sampling frequency, beyond which voltages cannot act on it, and names
    the largest reduced_modes that fits.
    """
    modes = np.sort(np.abs(np.linalg.eigvals(reduced.A)))
    fastest, sampling = float(modes[-1]), 2 * np.pi / options.sample_time
    if fastest > sampling:
        fitting = int(np.count_nonzero(modes <= sampling) // (2 * beams))
        advice = f"reduced_modes = {fitting} fits" if fitting else "no reduced_modes fits"
        raise DesignError(
            f"sample_time = {options.sample_time:g} s is too long for the retained mode at {fastest:.4g} rad/s: the "
            f"Nyquist frequency is {sampling / 2:.4g} rad/s and the sampling frequency {sampling:.4g} rad/s; {advice}, "
            f"or a sample time of at most {2 * np.pi / fastest:.2g} s"
        )
    if fastest > sampling / 6:
        return [
            f"the retained mode at {fastest:.4g} rad/s lies above a third of the Nyquist frequency, "
            f"{sampling / 6:.4g} rad/s, of sample_time = {options.sample_time:g} s"
        ]
    return []
