"""Loops of a Bouc-Wen element with creep: a structure of hysteresis that the project's operators do not have.

x = k v + q v^2 - b, b' = a v' - beta |v'| b - gamma v' |b| + delta |v'| (R. Bouc 1967, Y. K. Wen 1976; the last term is
the asymmetry of Zhu and Wang 2012); every change of x goes on as 1 % of it in each decade of time after 50 ms. The
file plant/identification/mfc_loops.csv is written by `python -m tests.oracles.bouc_wen`.
"""

from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array

FILE = Path(__file__).parents[2] / "plant/identification/mfc_loops.csv"
STEP = 0.02  # s
METRES = -1e-5  # m/V
NOISE = 2e-4  # standard deviation, of the stroke


def bouc_wen(voltage: Array, step: float = STEP, substeps: int = 20) -> Array:
    """Response (n,) in V to voltages (n,) from 0 V on, joined by lines."""
    k, q, a, beta, gamma, delta = 0.9, 2e-5, 0.22, 2.2e-3, 0.6e-3, 0.02
    b, before, x = 0.0, 0.0, np.empty(len(voltage))
    for row, v in enumerate(voltage.tolist()):
        change = (v - before) / substeps
        for _ in range(substeps):
            b += a * change - beta * abs(change) * b - gamma * change * abs(b) + delta * abs(change)
        before = v
        x[row] = k * v + q * v * v - b
    grown = 0.01 * np.log10(1.0 + step * np.arange(len(x)) / 0.05)
    response: Array = x + np.convolve(np.diff(x, prepend=0.0), grown)[: len(x)]
    return response


def loops(step: float = STEP) -> Array:
    """Voltages (n,): loops of several amplitudes, the largest first, then two smaller ones off the middle."""
    turn = np.arange(0.0, 4.0, step) / 4.0
    parts = [a * np.sin(2 * np.pi * turn) for a in (1000, 1000, 1000, 700, 850, 450, 300, 1000, 400)]
    for centre, amplitude in ((500, 300), (-400, 350)):
        last = parts[-1][-1]
        parts += [last + (centre - last) * np.arange(0.0, 1.0, step), centre + amplitude * np.sin(2 * np.pi * turn)]
    return np.concatenate(parts)


def text() -> str:
    """The file of measured loops, with noise."""
    voltage = np.round(loops(), 2)
    response = METRES * bouc_wen(voltage)
    response += np.random.default_rng(1).normal(0.0, NOISE * np.ptp(response), len(response))
    rows = (f"{STEP * k:.2f},{v:.2f},{y:.4e}" for k, (v, y) in enumerate(zip(voltage, response, strict=True)))
    return "\n".join(["time,u[1],y_pi[1]", *rows, ""])


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
    print(FILE)
