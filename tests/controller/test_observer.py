"""The matrices of a tick against equations (42), (44) and (45) one by one."""

import numpy as np

from flexbeams.controller.observer import tick_matrices


def test_a_tick_is_the_equations_of_filter_and_regulator() -> None:
    """Random arrays of different sizes: m = 5, n_u = 3, n_pi = 2, n_pm = 4."""
    random = np.random.default_rng(3)
    sizes = {
        "A_d": (5, 5),
        "B_d": (5, 3),
        "H_pi": (2, 5),
        "D_pi": (2, 3),
        "H_pm": (4, 5),
        "D_pm": (4, 3),
        "estimator_gain": (5, 4),
        "feedback_gain": (3, 5),
        "static_inverse": (3, 2),
    }
    a = {name: random.normal(size=shape) for name, shape in sizes.items()}
    x, x_ref, u, u_ff, y = (random.normal(size=n) for n in (5, 5, 3, 3, 4))
    matrices = tick_matrices(a)
    predicted = a["A_d"] @ x + a["B_d"] @ u + a["estimator_gain"] @ (y - a["H_pm"] @ x - a["D_pm"] @ u)
    np.testing.assert_allclose(matrices.filter @ np.concatenate([x, u, y]), predicted, rtol=1e-12)
    error = a["H_pi"] @ (x_ref - x) + a["D_pi"] @ (u_ff - u)
    expected = [a["feedback_gain"] @ (x_ref - x), a["static_inverse"] @ error]
    np.testing.assert_allclose(
        matrices.regulator @ np.concatenate([x_ref - x, u_ff - u]), np.concatenate(expected), rtol=1e-12
    )
    np.testing.assert_allclose(matrices.estimates @ np.concatenate([x, u]), a["H_pi"] @ x + a["D_pi"] @ u, rtol=1e-12)
