"""Picture and page of a closed loop: its parts as blocks, their wires, the chapters of their units."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.documents.documentation import documentation_page, table
from flexbeams.fmus.documents.picture import BLUE, LIGHT_BLUE, array_labels, blank_picture, png_bytes
from flexbeams.fmus.interface.variables import Interface

Wires = Sequence[tuple[str, str]]  # arrays by <part>.<array>: output, input

_LEFT, _RIGHT, _WIDTH, _HEIGHT = 2.1, 7.3, 9.4, 4.0  # of the unit within the picture, inches
_ARROW = 0.4  # length of an input's arrow, inches

_COUPLINGS = {
    "jacobi": "All parts take the values of t_k, then all step (Jacobi).",
    "gauss-seidel": "A part takes the newest values of those before it, then steps (Gauss-Seidel).",
}
_CUTS = {
    "jacobi": ", so that this changes nothing but the last digits",
    "gauss-seidel": "; the values that a part passes to those after it are then those of the cut",
}


def wiring_page(
    interface: Interface,
    picture: bytes,
    chapter: Chapter,
    parts: Mapping[str, str],
    chapters: Mapping[str, Chapter],
    wires: Wires,
    coupling: str,
) -> str:
    """The page in UTF-8 text; `picture` is model.png.

    `chapter` is that of the loop, a template of its timing; `parts` has units by part, `chapters` theirs by unit.
    """
    wiring = ["<h2>Wiring</h2>", table(("part", "unit"), parts.items())]
    if wires:
        wiring.append(table(("output", "input"), wires))
    open_inputs = ", ".join(f"<code>{name}</code>" for name in array_labels(interface, "input")) or "none"
    wiring.append(
        f"<p>Inputs that no output feeds are inputs of the unit: {open_inputs}. The host drives them; there "
        "are no signals inside. Inputs and outputs have the names that they have in their parts where "
        "these differ; other variables are called &lt;part&gt;.&lt;variable&gt;.</p>"
    )
    timing = chapter.timing.format(
        step=interface.step_size,
        order=", ".join(parts),
        coupling=_COUPLINGS[coupling] if len(parts) > 1 else "",
        cut=_CUTS[coupling] if wires else "",
    )
    headed = [
        (f"# {unit}: {', '.join(name for name, other in parts.items() if other == unit)}", chapters[unit])
        for unit in dict.fromkeys(parts.values())
    ]
    return documentation_page(
        interface,
        picture,
        replace(
            chapter,
            equations="\n".join(f"{head}\n{part.equations.strip()}" for head, part in headed),
            timing=timing + "\n".join(f"{head}\n{part.timing.strip()}" for head, part in headed),
            wiring="\n".join(wiring),
        ),
    )


def loop_picture(interface: Interface, parts: Mapping[str, str], wires: Wires) -> bytes:
    """A PNG of 940 x 400 pixels, `parts` has units by part; equal arguments give equal bytes with one matplotlib."""
    canvas, axes = blank_picture(_WIDTH, _HEIGHT)
    _box(axes, _LEFT, 0.3, _RIGHT - _LEFT, _HEIGHT - 0.6, "white")
    axes.text((_LEFT + _RIGHT) / 2, _HEIGHT - 0.55, interface.unit_name, ha="center", fontsize=13, color=BLUE)
    pitch = (_RIGHT - _LEFT) / len(parts)
    width = 0.68 * pitch
    middles = {name: _LEFT + pitch * (k + 0.5) for k, name in enumerate(parts)}
    for name, unit in parts.items():
        _draw_part(axes, name, unit, middles[name], width)
    order = list(middles)
    for (start, end), names in _pairs(wires).items():
        _draw_wire(axes, middles[start], middles[end], width, order.index(end) - order.index(start), names)
    for causality, edge, side, align in (("input", _LEFT, -1, "right"), ("output", _RIGHT, 1, "left")):
        _draw_ports(axes, array_labels(interface, causality), edge, side, align)
    return png_bytes(canvas)


def _draw_part(axes: Any, name: str, unit: str, middle: float, width: float) -> None:
    _box(axes, middle - width / 2, 1.6, width, 0.8, LIGHT_BLUE)
    for text, height, size in ((name, 2.12, 10.0), (unit, 1.82, 8.0)):
        fitting = _fitting(size, text, width)
        axes.text(middle, height, text, ha="center", va="center", color=BLUE, fontsize=fitting)


def _draw_ports(axes: Any, names: Sequence[str], edge: float, side: int, align: str) -> None:
    """Arrows at an edge of the unit, with the names of its arrays outside."""
    arrow = {"arrowstyle": "-|>", "color": BLUE, "shrinkA": 0, "shrinkB": 0}
    for k, name in enumerate(names, 1):
        height = 0.3 + (_HEIGHT - 0.6) * (1 - k / (len(names) + 1))
        tail, head = sorted((edge, edge + side * _ARROW))
        axes.annotate("", (head, height), (tail, height), arrowprops=arrow)
        size = _fitting(8.0, name, _WIDTH - _RIGHT - _ARROW - 0.1)
        axes.text(edge + side * (_ARROW + 0.05), height, name, ha=align, va="center", fontsize=size)


def _fitting(size: float, text: str, width: float) -> float:
    """The size of a font, at most this one, for which a text is not wider than `width` (inches)."""
    return min(size, 115 * width / len(text))


def _pairs(wires: Wires) -> dict[tuple[str, str], list[str]]:
    """Names of the outputs by the two parts that they join."""
    pairs: dict[tuple[str, str], list[str]] = {}
    for source, to in wires:
        start, _, name = source.partition(".")
        pairs.setdefault((start, to.partition(".")[0]), []).append(name)
    return {pair: list(dict.fromkeys(names)) for pair, names in pairs.items()}


def _box(axes: Any, left: float, bottom: float, width: float, height: float, colour: str) -> None:
    from matplotlib.patches import FancyBboxPatch

    axes.add_patch(
        FancyBboxPatch(
            (left, bottom),
            width,
            height,
            boxstyle="round,pad=0.0,rounding_size=0.08",
            linewidth=1.4,
            edgecolor=BLUE,
            facecolor=colour,
        )
    )


def _draw_wire(axes: Any, start: float, end: float, width: float, blocks: int, names: list[str]) -> None:
    """Straight to the next block, above others to the right, below to the left; `blocks` is how far, with its sign."""
    arrow = {"arrowstyle": "-|>", "color": BLUE, "shrinkA": 0, "shrinkB": 0}
    if blocks == 1:
        axes.annotate("", (end - width / 2, 2.0), (start + width / 2, 2.0), arrowprops=arrow)
        axes.text((start + end) / 2, 2.08, "\n".join(names), ha="center", va="bottom", fontsize=7)
        return
    side = 1 if blocks > 0 else -1
    edge, rise = 2.0 + 0.4 * side, 0.28 + 0.12 * abs(blocks)
    left, right = start + 0.2 * width, end - 0.2 * width
    turned = edge + side * rise
    axes.plot([left, left, right], [edge, turned, turned], color=BLUE, linewidth=1.2)
    axes.annotate("", (right, edge), (right, turned), arrowprops=arrow)
    axes.text(
        (left + right) / 2,
        turned + 0.05 * side,
        ", ".join(names),
        ha="center",
        va="bottom" if side > 0 else "top",
        fontsize=7,
    )
