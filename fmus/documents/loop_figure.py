"""A picture of the loop of an actuator's first channel and of its inverse, from a unit's start values."""

from itertools import pairwise

import numpy as np

from flexbeams.fmus.interface.variables import Interface
from flexbeams.plant.actuator.inverse import invert, voltage_for
from flexbeams.plant.actuator.operators import Operators, Reals, hysteresis, move_plays, with_linear_part

SIZE, MARGIN, GAP = 250.0, 44.0, 60.0  # of a box, px
POINTS = 60  # of a branch
INNER = 0.4  # amplitude of the smaller loop, of the limit


def loop_figure(interface: Interface) -> str:
    """SVG: u_eff over u without creep, and the inverse, for a loop through the whole range and one within."""
    operators, limit = _first_channel(interface), _limit(interface)
    corners = limit * np.array([0.0, 1.0, -1.0, 1.0, 0.0, INNER, -INNER, INNER])
    voltage = np.concatenate([np.linspace(a, b, POINTS) for a, b in pairwise(corners)])
    inverse = invert(operators)
    forward, backward = np.zeros_like(operators.play_weight), np.zeros_like(operators.play_weight)
    effective, command = [], []
    for v in voltage:
        move_plays(operators, forward, np.array([v]))
        h = hysteresis(operators, forward)
        effective.append(float(h[0]))
        found = voltage_for(operators, inverse, backward, h)
        move_plays(operators, backward, found)
        command.append(float(found[0]))
    reach = 1.05 * max(limit, float(np.max(np.abs(effective))))
    width, height = 2 * (SIZE + MARGIN) + GAP, SIZE + 2 * MARGIN
    boxes = [
        _box(MARGIN, voltage, np.array(effective), reach, "u in V", "h in V: hysteresis without creep"),
        _box(MARGIN + SIZE + GAP, np.array(effective), np.array(command), reach, "h in V", "u in V: the inverse"),
    ]
    return (
        f'<figure><svg viewBox="0 0 {width:g} {height:g}" style="max-width: 44rem; width: 100%" role="img" '
        f'aria-label="Loop of channel 1 and its inverse" font-size="12" fill="currentColor">{"".join(boxes)}</svg>'
        "<figcaption>Channel 1 with the start values: from the demagnetised state through the whole range, then "
        "a smaller loop.</figcaption></figure>"
    )


def _row(interface: Interface, name: str) -> Reals:
    """Start values of a parameter's first channel, (1, operators)."""
    variables = [interface.variables[k] for k in interface.references(name)]
    channels = len(interface.references("linear_weight"))
    starts = np.array([float(v.start or 0.0) for v in variables])
    return starts.reshape(channels, -1)[:1]


def _first_channel(interface: Interface) -> Operators:
    return Operators(
        play_threshold=with_linear_part(0.0, _row(interface, "play_threshold")),
        play_weight=with_linear_part(_row(interface, "linear_weight")[:, 0], _row(interface, "play_weight")),
        dead_zone_threshold=_row(interface, "dead_zone_threshold"),
        dead_zone_slope=_row(interface, "dead_zone_slope"),
        creep_time=_row(interface, "creep_time"),
        creep_weight=_row(interface, "creep_weight"),
    )


def _limit(interface: Interface) -> float:
    low, high, supply = (float(_row(interface, n)[0, 0]) for n in ("face_minimum", "face_maximum", "supply"))
    return min(high - supply, supply - low)


def _box(left: float, x: Reals, y: Reals, reach: float, x_name: str, y_name: str) -> str:
    """A square box from -reach to reach with a line, its axes through 0."""
    middle, scale = SIZE / 2, SIZE / (2 * reach)
    top = MARGIN
    points = " ".join(
        f"{left + middle + a * scale:.1f},{top + middle - b * scale:.1f}"
        for a, b in zip(x.tolist(), y.tolist(), strict=True)
    )
    end = 10.0 ** np.floor(np.log10(reach))
    mark = middle + end * scale
    return (
        f'<rect x="{left:g}" y="{top:g}" width="{SIZE:g}" height="{SIZE:g}" fill="none" stroke="currentColor" '
        f'stroke-opacity="0.4"/><path d="M{left:g} {top + middle:g}h{SIZE:g}M{left + middle:g} {top:g}v{SIZE:g}" '
        f'stroke="currentColor" stroke-opacity="0.25" fill="none"/>'
        f'<polyline points="{points}" fill="none" stroke="#3b7dd8" stroke-width="1.6"/>'
        f'<text x="{left:g}" y="{top - 8:g}">{y_name}</text>'
        f'<text x="{left + SIZE:g}" y="{top + SIZE + 30:g}" text-anchor="end">{x_name}</text>'
        f'<text x="{left + mark:.1f}" y="{top + SIZE + 14:g}" text-anchor="middle">{end:g}</text>'
        f'<text x="{left - 4:g}" y="{top + SIZE - mark + 4:.1f}" text-anchor="end">{end:g}</text>'
    )
