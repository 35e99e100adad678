"""Residuals as noise: how many neighbours say the same."""

import numpy as np

from flexbeams.plant.basis import Array

_LONGEST_LAG = 0.2  # of the rows


def correlation_length(r: Array) -> float:
    """1 + 2 sum of the squared autocorrelations beyond what white noise shows, at least 1, in rows.

    Squares count oscillations as well as drifts. A decay rho^k has (1 + rho^2) / (1 - rho^2).
    """
    n = len(r)
    spectrum = np.abs(np.fft.rfft(r, 2 * n)) ** 2
    correlation = np.fft.irfft(spectrum)[: max(2, int(_LONGEST_LAG * n))]
    if correlation[0] <= 0:
        return 1.0
    squares = (correlation[1:] / correlation[0]) ** 2
    return max(1.0, 1 + 2 * float(np.sum(squares - 1 / n)))
