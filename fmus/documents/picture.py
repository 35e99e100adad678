"""model.png: a unit as a block with its inputs and outputs."""

import io
from typing import Any

from flexbeams.fmus.interface.variables import Interface

BLUE, LIGHT_BLUE = "#1f3a5f", "#eaf1f8"
_WIDTH, _HEIGHT = 4.8, 3.2  # inches


def model_picture(interface: Interface) -> bytes:
    """A PNG of 480 x 320 pixels; equal interfaces give equal bytes with one version of matplotlib."""
    from matplotlib.patches import FancyBboxPatch

    canvas, axes = blank_picture(_WIDTH, _HEIGHT)
    axes.add_patch(
        FancyBboxPatch(
            (1.35, 0.4),
            2.1,
            2.4,
            boxstyle="round,pad=0.0,rounding_size=0.12",
            linewidth=1.6,
            edgecolor=BLUE,
            facecolor=LIGHT_BLUE,
        )
    )
    words = "".join(f"\n{letter}" if letter.isupper() else letter for letter in interface.unit_name).strip()
    axes.text(2.4, 1.6, words, ha="center", va="center", fontsize=14, color=BLUE, linespacing=1.3)
    for causality, tail, head, label, align in (
        ("input", 0.85, 1.32, 0.78, "right"),
        ("output", 3.48, 3.95, 4.02, "left"),
    ):
        names = array_labels(interface, causality)
        for k, name in enumerate(names, 1):
            height = 0.4 + 2.4 * (1 - k / (len(names) + 1))
            axes.annotate("", (head, height), (tail, height), arrowprops={"arrowstyle": "-|>", "color": BLUE})
            axes.text(label, height, name, ha=align, va="center", fontsize=10)
    return png_bytes(canvas)


def blank_picture(width: float, height: float) -> tuple[Any, Any]:
    """A canvas of this size in inches at 100 dpi, and axes whose units are inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    return canvas, axes


def png_bytes(canvas: Any) -> bytes:
    """The picture as PNG, without the name of the software that drew it."""
    buffer = io.BytesIO()
    canvas.print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def array_labels(interface: Interface, causality: str) -> list[str]:
    """The arrays of a causality with their lengths: y_pm[6]."""
    return [
        f"{name}[{len(span)}]" if len(span) > 1 or "[" in interface.variables[span.start].name else name
        for name, span in interface.arrays.items()
        if interface.variables[span.start].causality == causality
    ]
