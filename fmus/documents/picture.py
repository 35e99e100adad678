"""model.png: a unit as a block with its inputs and outputs."""

import io

from flexbeams.fmus.interface.variables import Interface


def model_picture(interface: Interface) -> bytes:
    """A PNG of 480 x 320 pixels; equal interfaces give equal bytes with one version of matplotlib."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    figure = Figure(figsize=(4.8, 3.2), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, 4.8)
    axes.set_ylim(0.0, 3.2)
    axes.add_patch(
        FancyBboxPatch(
            (1.35, 0.4),
            2.1,
            2.4,
            boxstyle="round,pad=0.0,rounding_size=0.12",
            linewidth=1.6,
            edgecolor="#1f3a5f",
            facecolor="#eaf1f8",
        )
    )
    words = "".join(f"\n{letter}" if letter.isupper() else letter for letter in interface.unit_name).strip()
    axes.text(2.4, 1.6, words, ha="center", va="center", fontsize=14, color="#1f3a5f", linespacing=1.3)
    for names, tail, head, place, align in (
        (signals(interface, "input"), 0.85, 1.32, 0.78, "right"),
        (signals(interface, "output"), 3.48, 3.95, 4.02, "left"),
    ):
        for k, name in enumerate(names, 1):
            height = 0.4 + 2.4 * (1 - k / (len(names) + 1))
            axes.annotate("", (head, height), (tail, height), arrowprops={"arrowstyle": "-|>", "color": "#1f3a5f"})
            axes.text(place, height, name, ha=align, va="center", fontsize=10)
    buffer = io.BytesIO()
    canvas.print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def signals(interface: Interface, causality: str) -> list[str]:
    """The arrays of a causality with their lengths: y_pm[6]."""
    return [
        f"{name}[{len(span)}]" if len(span) > 1 or "[" in interface.variables[span.start].name else name
        for name, span in interface.arrays.items()
        if interface.variables[span.start].causality == causality
    ]
