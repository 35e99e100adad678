"""Deflections at rest that the voltages reach, and the voltages that hold them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexbeams.controller.voltage_limits import VoltageLimits
from flexbeams.plant.basis import Array

# Singular values of the static gain below this fraction of the largest deflection per volt anywhere on the beams count
# as zero: such a direction takes a thousand times the voltage, and Galerkin's errors are as large
RANK_TOLERANCE = 1e-3
IDLE = 1e-9  # singular values of G_0^+ below this fraction of the largest are those that RANK_TOLERANCE made zero


@dataclass(frozen=True, kw_only=True)
class Reach:
    """The range of the static gain G (n_pi, n_u) within RANK_TOLERANCE."""

    inverse: Array  # G_0^+ (n_u, n_pi), V/m: voltages of the nearest reachable deflections, in the sum of squares
    unreachable: Array  # I - G G_0^+ (n_pi, n_pi): part of a target that no voltages reach; zero where there is none
    rank: int
    condition: float  # ratio of the largest to the smallest singular value that counts; 1 for rank 0
    unmoved: tuple[int, ...]  # points of interest, counted from 1, that no pair moves

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types."""
        return {"static_rank": self.rank, "static_condition": self.condition}

    def warnings(self, nearest: bool) -> list[str]:
        """Lines about points that no pair moves, and about points that do not move independently."""
        fate = "are replaced by the nearest reachable ones" if nearest else "are refused"
        lines = [f"point_of_interest[{k}] is moved by no patch pair: targets there {fate}" for k in self.unmoved]
        moved = len(self.unreachable) - len(self.unmoved)
        if self.rank < moved:
            lines.append(
                f"the patch pairs move {moved} points of interest in {self.rank} independent "
                f"way{'s' if self.rank > 1 else ''} only: other targets {fate}"
            )
        return lines


def reach_of(gain: Array, largest_deflection: float) -> Reach:
    """The reach of a static gain (n_pi, n_u), m/V; `largest_deflection`: of the beams anywhere, m/V."""
    sigma = np.linalg.svd(gain, compute_uv=False)
    scale = max(float(sigma[0]), largest_deflection)
    cut = RANK_TOLERANCE * scale
    rank = int(np.count_nonzero(sigma > cut))
    points = len(gain)
    if rank == 0:
        inverse = np.zeros(gain.T.shape)
    else:
        inverse = np.asarray(np.linalg.pinv(gain, rcond=cut / float(sigma[0])), dtype=np.float64)
    unreachable = np.zeros((points, points)) if rank == points else np.eye(points) - gain @ inverse
    unmoved = np.flatnonzero(np.max(np.abs(gain), axis=1) <= cut)
    unreachable[unmoved] = np.eye(points)[unmoved]
    return Reach(
        inverse=inverse,
        unreachable=unreachable,
        rank=rank,
        condition=float(sigma[0] / sigma[rank - 1]) if rank else 1.0,
        unmoved=tuple(int(k) + 1 for k in unmoved),
    )


def idle_voltages(inverse: Array) -> Array:
    """An orthonormal basis (n_u, k) of the voltages that move nothing at rest; k = 0 where the pairs are independent.

    `inverse` (n_u, n_pi) is G_0^+.
    """
    from scipy.linalg import null_space  # which takes longer to load than a run that does not ask

    basis: Array = null_space(inverse.T, rcond=IDLE)
    return basis


def voltages_within(limits: VoltageLimits, voltages: Array, idle: Array) -> Array | None:
    """Voltages (n_u,) within the limits that hold what `voltages` (n_u,) hold; None where there are none.

    Of voltages + N z, with N the `idle_voltages` (n_u, k), those furthest from the limits, by a linear program.
    """
    one = np.ones((len(idle), 1))
    rows = np.vstack([np.hstack([idle, one]), np.hstack([-idle, one])])
    room = np.concatenate([limits.highest - voltages, voltages - limits.lowest])
    distance = np.append(np.zeros(idle.shape[1]), 1.0)
    from scipy.optimize import linprog

    found = linprog(-distance, A_ub=rows, b_ub=room, bounds=(None, None))
    if not found.success or found.x[-1] < 0.0:
        return None
    held: Array = voltages + idle @ found.x[:-1]
    return held
