"""The smooth transition Theta of (37) and its derivatives, by power series: no differences, no quadrature online."""

from dataclasses import dataclass, field

import numpy as np

from plant.basis import Array

NODES = 256           # intervals of the table of Theta over the transition
_NEGLIGIBLE = 600.0   # exponent below which theta and all its derivatives vanish beside their maxima


@dataclass(frozen=True)
class Transition:
    """Theta(tau) = integral of exp(-(tau (1 - tau))^-g) over [0, tau], normalised to Theta(1) = 1, tau = t/T.

    `gevrey_order` is alpha = 1 + 1/g of section 4.4: g = 1/(alpha - 1). A beam's parameterisation converges for
    alpha < 2; alpha > 1 is required, ValueError otherwise.
    """

    gevrey_order: float = 1.9
    exponent: float = field(init=False)            # g
    table: Array = field(init=False, repr=False)   # Theta at i / NODES, (NODES + 1,)
    norm: float = field(init=False)                # integral of theta over [0, 1]

    def __post_init__(self) -> None:
        if not 1 < self.gevrey_order < np.inf:
            raise ValueError(f"gevrey_order must be finite and > 1, got {self.gevrey_order}")
        object.__setattr__(self, "exponent", 1 / (self.gevrey_order - 1))
        points, weights = np.polynomial.legendre.leggauss(24)
        tau = (np.arange(NODES)[:, None] + (points + 1) / 2) / NODES
        pieces = np.exp(-((tau * (1 - tau)) ** -self.exponent)) @ weights / (2 * NODES)
        rising = np.concatenate([[0.0], np.cumsum(pieces)])
        # Theta(tau) + Theta(1 - tau) = 1 exactly
        total = 2 * rising[NODES // 2]
        left = rising[:NODES // 2 + 1] / total
        object.__setattr__(self, "norm", float(total))
        object.__setattr__(self, "table", np.concatenate([left, 1 - left[-2::-1]]))

    def series(self, tau: float, order: int) -> Array:
        """Taylor coefficients Theta^(i)(tau) / i!, i = 0 ... order, with respect to tau; shape (order + 1,).

        Coefficients of p^-g, p = tau (1 - tau), and of exp(-p^-g) follow by the recurrences of J. C. P. Miller
        and of the exponential; theta = Theta' gives all but the first. That one is the table's nearest value
        carried here by the same series.
        """
        coefficients = np.zeros(order + 1)
        coefficients[0] = 0.0 if tau < 0.5 else 1.0
        p0, p1 = tau * (1 - tau), 1 - 2 * tau
        if p0 <= 0 or p0 ** -self.exponent > _NEGLIGIBLE:
            return coefficients
        g = self.exponent
        power, theta = np.zeros(order + 1), np.zeros(order + 1)
        power[0] = p0 ** -g
        theta[0] = np.exp(-power[0]) / self.norm
        weighted = np.zeros(order + 1)   # k times the k-th coefficient of p^-g
        for k in range(1, order):
            term = -(g + k - 1) * p1 * power[k - 1]
            if k > 1:
                term += (2 * g + k - 2) * power[k - 2]
            power[k] = term / (k * p0)
            weighted[k] = k * power[k]
            theta[k] = -(weighted[1:k + 1] @ theta[k - 1::-1]) / k if k > 0 else theta[0]
        index = np.arange(1, order + 1)
        coefficients[1:] = theta[:order] / index
        node = round(tau * NODES)
        back = node / NODES - tau
        coefficients[0] = self.table[node] - coefficients[1:] @ back ** index
        return coefficients
