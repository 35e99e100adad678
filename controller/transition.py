"""The smooth transition Theta of (37) and its derivatives, by power series: no differences, no quadrature online."""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array

NODES = 256  # intervals of the table of Theta over the transition
LOWEST_ORDER = 1.2  # below, theta is too narrow for that table
_NEGLIGIBLE = 600.0  # p^-g - 4^g beyond which theta and its derivatives are negligible beside their maxima
_LOCAL_TERMS = 16  # terms that extrapolate Theta from a node to its neighbourhood to rounding


@dataclass(frozen=True, kw_only=True)
class TransitionSeries:
    """Taylor coefficients of Theta in powers of (tau' - tau) / unit: no factor of them leaves the range of doubles."""

    coefficients: Array  # Theta^(i)(tau) unit^i / i!, i = 0 ... order
    unit: float  # 1, at most tau (1 - tau)


@dataclass(frozen=True, kw_only=True)
class Transition:
    """Theta(tau) = integral of exp(-(tau (1 - tau))^-g) over [0, tau], normalised to Theta(1) = 1, tau = t/T.

    The integrand is scaled as exp(4^g - (tau (1 - tau))^-g), of maximum 1: the unscaled one underflows for g > 4.7.
    """

    exponent: float  # g
    norm: float  # integral of exp(4^g - (tau (1 - tau))^-g) over [0, 1]
    table: Array  # Theta at i / NODES, (NODES + 1,)

    def series(self, tau: float, order: int) -> TransitionSeries:
        """Taylor coefficients of Theta at tau, i = 0 ... order.

        Coefficients of p^-g, p = tau (1 - tau), and of exp(-p^-g) follow by the recurrences of J. C. P. Miller
        and of the exponential; theta = Theta' gives all except the first, which is the nearest table value
        extrapolated by the same series. Near the ends, where p^-g is large, the unit shrinks so that the recurrences
        grow no faster than exp(order).
        """
        terms = max(order, _LOCAL_TERMS)
        coefficients = np.zeros(terms + 1)
        coefficients[0] = 0.0 if tau < 0.5 else 1.0
        g, p0, p1 = self.exponent, tau * (1 - tau), 1 - 2 * tau
        if p0 <= (4**g + _NEGLIGIBLE) ** (-1 / g):
            return TransitionSeries(coefficients=coefficients[: order + 1], unit=1.0)
        first = p0**-g
        shrink = min(1.0, terms / (g * first))
        down, across, unit = p1 * shrink, p0 * shrink**2, p0 * shrink
        power = [first, -g * down * first]
        for k in range(2, terms):
            power.append((-(g + k - 1) * down * power[-1] + (2 * g + k - 2) * across * power[-2]) / k)
        # -k power[k], backwards, so that each step of the exponential's recurrence is one product
        slope = -np.arange(terms - 1, 0, -1) * np.array(power[terms - 1 : 0 : -1])
        theta = np.zeros(terms)
        theta[0] = np.exp(4**g - first) / self.norm
        for k in range(1, terms):
            theta[k] = (slope[terms - 1 - k :] @ theta[:k]) / k
        index = np.arange(1, terms + 1)
        coefficients[1:] = unit * theta / index
        node = round(tau * NODES)
        back = (node / NODES - tau) / unit
        coefficients[0] = self.table[node] - coefficients[1:] @ back**index
        return TransitionSeries(coefficients=coefficients[: order + 1], unit=unit)


def transition_of_order(gevrey_order: float) -> Transition:
    """The transition of Gevrey order alpha = 1 + 1/g of section 4.4, g = 1/(alpha - 1).

    A beam's parameterisation converges for alpha < 2. ValueError unless LOWEST_ORDER <= alpha < 2: beyond, the
    transition's ends become so steep that voltages have spikes there.
    """
    if not LOWEST_ORDER <= gevrey_order < 2:
        raise ValueError(f"gevrey_order must be >= {LOWEST_ORDER} and < 2, got {gevrey_order}")
    exponent = 1 / (gevrey_order - 1)
    points, weights = np.polynomial.legendre.leggauss(24)
    tau = (np.arange(NODES)[:, None] + (points + 1) / 2) / NODES
    theta = np.exp(4**exponent - (tau * (1 - tau)) ** -exponent)
    rising = np.concatenate([[0.0], np.cumsum(theta @ weights / (2 * NODES))])
    norm = 2 * rising[NODES // 2]
    left = rising[: NODES // 2 + 1] / norm  # Theta(tau) + Theta(1 - tau) = 1 exactly
    return Transition(exponent=exponent, norm=float(norm), table=np.concatenate([left, 1 - left[-2::-1]]))
