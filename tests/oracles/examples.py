"""Structures of one, three and five beams in which no two parts are alike."""

from flexbeams.plant.structure import Beam, Patch, PointOfInterest, Spring, StrainGauge, Structure


def beam(number: int = 1, **changes: float) -> Beam:
    """A carbon-fibre beam; each `number` has other values."""
    values = {
        "length": 0.38 + 0.01 * number,
        "width": 0.045 + 0.001 * number,
        "thickness": 7.5e-4 + 5e-5 * (number % 3),
        "density": 1450.0 + 40 * number,
        "youngs_modulus": (43.0 + 11 * (number % 4)) * 1e9,
        "tip_mass": 0.018 + 0.004 * number,
        "viscous_damping": 0.03 + 0.004 * number,
        "structural_damping": 4e-3 - 3e-4 * number,
    }
    return Beam(**{**values, **changes})


def patch(number: int, on_beam: int, position: float, **changes: float) -> Patch:
    """A pair of macro-fibre patches; each `number` has other values."""
    values = {
        "length": 0.083 + 0.001 * number,
        "width": 0.024 + 0.001 * number,
        "thickness": 2.9e-4 + 5e-6 * number,
        "density": 5440.0 - 30 * number,
        "youngs_modulus": (30.0 + number) * 1e9,
        "viscous_damping": 0.01 + 0.005 * number,
        "structural_damping": 1e-3 + 5e-4 * number,
        "piezo_ratio": 23.0 + 0.6 * number,
        "electrode_distance": 5e-4,
    }
    return Patch(beam=on_beam, position=position, **{**values, **changes})


def gauge(on_beam: int, position: float, length: float = 0.006) -> StrainGauge:
    """A strain gauge."""
    return StrainGauge(beam=on_beam, position=position, length=length)


def point(on_beam: int, position: float) -> PointOfInterest:
    """A point of interest."""
    return PointOfInterest(beam=on_beam, position=position)


def single_beam(**changes: float) -> Structure:
    """One beam, one patch pair, two points of interest, three gauges (one of them across a patch edge)."""
    first = beam(1, **changes)
    return Structure(
        beam=[first],
        patch=[patch(1, 1, 0.02)],
        point_of_interest=[point(1, 0.2), point(1, first.length)],
        strain_gauge=[gauge(1, 0.05), gauge(1, 0.104, 0.012), gauge(1, 0.25, 0.0)],
    )


def three_beams() -> Structure:
    """The layout of the paper, patch pairs on beams 1, 2, 2, 3, with n_u = 4, n_pi = 5, n_pm = 6."""
    beams = [beam(1), beam(2), beam(3)]
    return Structure(
        beam=beams,
        patch=[patch(1, 1, 0.02), patch(2, 2, 0.025), patch(3, 2, 0.19), patch(4, 3, 0.015)],
        spring=[Spring(between=(1, 2), stiffness=6.7), Spring(between=(2, 3), stiffness=8.6)],
        point_of_interest=[
            point(1, beams[0].length),
            point(2, 0.17),
            point(2, beams[1].length),
            point(3, beams[2].length),
            point(3, 0.11),
        ],
        strain_gauge=[
            gauge(1, 0.06),
            gauge(2, 0.07),
            gauge(2, 0.23),
            gauge(3, 0.05),
            gauge(1, 0.22),
            gauge(3, 0.30, 0.01),
        ],
    )


def five_beams() -> Structure:
    """Five beams: touching patch pairs on the first, none on the third, one to the tip of the fifth, a chain with
    a gap; n_u = 6, n_pi = 2, n_pm = 4."""
    beams = [beam(j) for j in range(1, 6)]
    touching = [patch(1, 1, 0.02), patch(2, 1, 0.02 + patch(1, 1, 0.02).length)]
    return Structure(
        beam=beams,
        patch=[
            *touching,
            patch(3, 2, 0.0),
            patch(4, 4, 0.1),
            patch(5, 4, 0.02, length=0.05),
            patch(6, 5, 0.40, length=0.03),
        ],
        spring=[
            Spring(between=(3, 2), stiffness=5.0),
            Spring(between=(1, 2), stiffness=7.0),
            Spring(between=(4, 5), stiffness=9.0),
        ],
        point_of_interest=[point(3, beams[2].length), point(5, 0.4)],
        strain_gauge=[gauge(1, 0.104), gauge(2, 0.08), gauge(3, 0.1), gauge(5, 0.41)],
    )


def uncoupled_beams() -> Structure:
    """Three equal beams without springs: every singular value is threefold."""
    return Structure(
        beam=[beam(1)] * 3,
        patch=[patch(1, k, 0.02) for k in (1, 2, 3)],
        point_of_interest=[point(k, 0.39) for k in (1, 2, 3)],
        strain_gauge=[gauge(k, z) for k in (1, 2, 3) for z in (0.06, 0.2)],
    )


def equal_beams() -> Structure:
    """The layout of the paper with equal beams, springs and patch pairs: many nearly equal singular values."""
    return Structure(
        beam=[beam(1)] * 3,
        patch=[patch(1, k, z) for k, z in ((1, 0.02), (2, 0.02), (2, 0.16), (3, 0.02))],
        spring=[Spring(between=(k, k + 1), stiffness=6.0) for k in (1, 2)],
        point_of_interest=[point(k, z) for k, z in ((1, 0.39), (2, 0.24), (2, 0.39), (3, 0.39))],
        strain_gauge=[gauge(k, z) for k in (1, 2, 3) for z in (0.06, 0.2)],
    )
