"""Picture and page of a unit with parts: the parts as blocks, their wires, what each computes."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flexbeams.fmus.documents.documentation import Chapter, chapter_of, documentation_page, table
from flexbeams.fmus.documents.picture import signals
from flexbeams.fmus.interface.variables import Interface

Wires = Sequence[tuple[str, str]]  # arrays by <part>.<array>: output, input

_BLUE, _LIGHT = "#1f3a5f", "#eaf1f8"
_LEFT, _RIGHT, _WIDTH, _HEIGHT = 2.1, 7.3, 9.4, 4.0  # of the unit within the picture, inches
_ARROW = 0.4  # length of an input's arrow, inches

_TIMING = """
Inside, the parts step by {step:g} s, the step size of the unit, in the order {order}. {coupling}
A step of the host may have any size, its inputs are held over it; the unit takes no input derivatives. Steps that are
multiples of {step:g} s give, to the last digit, what the single units give under such a master. A step that ends in
between moves the parts up to its end; they exchange values at multiples of {step:g} s all the same{cut}. An integer
counts these.
"""
_COUPLINGS = {
    "jacobi": "All parts take the values of t_k, then all step (Jacobi).",
    "gauss-seidel": "A part takes the newest values of those before it, then steps (Gauss-Seidel).",
}
_CUTS = {
    "jacobi": ", so that this changes nothing but the last digits",
    "gauss-seidel": "; what a part passes on to those behind it is then of the time of the cut",
}


@dataclass(frozen=True, kw_only=True)
class Block:
    """A part."""

    name: str
    unit: str


def wiring_page(interface: Interface, picture: bytes, blocks: Sequence[Block], wires: Wires, coupling: str) -> str:
    """The page in UTF-8 text; `picture` is model.png."""
    units = dict.fromkeys(block.unit for block in blocks)
    wiring = ["<h2>Wiring</h2>", table(("part", "unit"), [(b.name, b.unit) for b in blocks])]
    if wires:
        wiring.append(table(("output", "input"), wires))
    open_inputs = ", ".join(f"<code>{name}</code>" for name in signals(interface, "input")) or "none"
    wiring.append(
        f"<p>Inputs that no output feeds are inputs of the unit: {open_inputs}. The host drives them; there "
        "are no signals inside. Variables are named after their parts.</p>"
    )
    timing = _TIMING.format(
        step=interface.step_size,
        order=", ".join(b.name for b in blocks),
        coupling=_COUPLINGS[coupling] if len(blocks) > 1 else "",
        cut=_CUTS[coupling] if wires else "",
    )
    return documentation_page(
        interface,
        picture,
        Chapter(
            equations="\n".join(f"# {_heading(unit, blocks)}\n{chapter_of(unit).equations.strip()}" for unit in units),
            timing=timing
            + "\n".join(f"# {_heading(unit, blocks)}\n{chapter_of(unit).timing.strip()}" for unit in units),
            wiring="\n".join(wiring),
            clock="",
            generated="<code>tables.c</code> and <code>part_1.c</code> and so on, one for each part, are what the "
            "design wrote",
        ),
    )


def loop_picture(interface: Interface, blocks: Sequence[Block], wires: Wires) -> bytes:
    """A PNG of 940 x 400 pixels; equal arguments give equal bytes with one version of matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, _WIDTH)
    axes.set_ylim(0.0, _HEIGHT)
    _box(axes, _LEFT, 0.3, _RIGHT - _LEFT, _HEIGHT - 0.6, "white")
    axes.text((_LEFT + _RIGHT) / 2, _HEIGHT - 0.55, interface.unit_name, ha="center", fontsize=13, color=_BLUE)
    pitch = (_RIGHT - _LEFT) / len(blocks)
    width = 0.68 * pitch
    middles = {block.name: _LEFT + pitch * (k + 0.5) for k, block in enumerate(blocks)}
    for block in blocks:
        _box(axes, middles[block.name] - width / 2, 1.6, width, 0.8, _LIGHT)
        for text, height, size in ((block.name, 2.12, 10.0), (block.unit, 1.82, 8.0)):
            axes.text(
                middles[block.name],
                height,
                text,
                ha="center",
                va="center",
                color=_BLUE,
                fontsize=_fitting(size, text, width),
            )
    order = list(middles)
    for (start, end), names in _pairs(wires).items():
        _draw_wire(axes, middles[start], middles[end], width, order.index(end) - order.index(start), names)
    for causality, edge, side, align in (("input", _LEFT, -1, "right"), ("output", _RIGHT, 1, "left")):
        names = signals(interface, causality)
        for k, name in enumerate(names, 1):
            height = 0.3 + (_HEIGHT - 0.6) * (1 - k / (len(names) + 1))
            ends = sorted((edge, edge + side * _ARROW))
            axes.annotate(
                "",
                (ends[1], height),
                (ends[0], height),
                arrowprops={"arrowstyle": "-|>", "color": _BLUE, "shrinkA": 0, "shrinkB": 0},
            )
            axes.text(
                edge + side * (_ARROW + 0.05),
                height,
                name,
                ha=align,
                va="center",
                fontsize=_fitting(8.0, name, _WIDTH - _RIGHT - _ARROW - 0.1),
            )
    buffer = io.BytesIO()
    canvas.print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _fitting(size: float, text: str, width: float) -> float:
    """The size of a font, at most this one, for which a text is not wider than `width` (inches)."""
    return min(size, 115 * width / len(text))


def _heading(unit: str, blocks: Sequence[Block]) -> str:
    return f"{unit}: {', '.join(block.name for block in blocks if block.unit == unit)}"


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
            edgecolor=_BLUE,
            facecolor=colour,
        )
    )


def _draw_wire(axes: Any, start: float, end: float, width: float, blocks: int, names: list[str]) -> None:
    """Straight to the next block, above others to the right, below to the left; `blocks` is how far, with its sign."""
    arrow = {"arrowstyle": "-|>", "color": _BLUE, "shrinkA": 0, "shrinkB": 0}
    if blocks == 1:
        axes.annotate("", (end - width / 2, 2.0), (start + width / 2, 2.0), arrowprops=arrow)
        axes.text((start + end) / 2, 2.08, "\n".join(names), ha="center", va="bottom", fontsize=7)
        return
    side = 1 if blocks > 0 else -1
    edge, rise = 2.0 + 0.4 * side, 0.28 + 0.12 * abs(blocks)
    left, right = start + 0.2 * width, end - 0.2 * width
    turned = edge + side * rise
    axes.plot([left, left, right], [edge, turned, turned], color=_BLUE, linewidth=1.2)
    axes.annotate("", (right, edge), (right, turned), arrowprops=arrow)
    axes.text(
        (left + right) / 2,
        turned + 0.05 * side,
        ", ".join(names),
        ha="center",
        va="bottom" if side > 0 else "top",
        fontsize=7,
    )
