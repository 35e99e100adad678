"""What the planner of a design can do, for people."""

from typing import Any


def motion_fact(summary: dict[str, Any]) -> tuple[str, str]:
    """A title and a line: the loss of digits of the paper's series, or what the transitions of splines are worth."""
    if "flatness_cancellation" in summary:
        return "flatness series", f"terms cancel by a factor {summary['flatness_cancellation']:.3g} over the transition"
    rows = zip(*(summary[f"transition_{name}"] for name in ("times", "peaks", "ripples")), strict=True)
    listed = ", ".join(f"{time:.3g} s ({peak:.3f}, {100 * ripple:.1g} %)" for time, peak, ripple in rows)
    return "transitions (largest voltage over that at rest, ripple after the end on the design's own plant)", listed
