"""Share of the time that a unit's voltages were held at a limit, from its recorded flag `saturated`."""

from collections.abc import Mapping

FLAG = ".saturated"  # end of a column's name
SHARE = ".saturated.share"  # end of a metric's name


def saturation_lines(metrics: Mapping[str, float | None]) -> list[str]:
    """A line for each instance that was saturated, from the metrics of a run."""
    shares = {name.removesuffix(SHARE): share for name, share in metrics.items() if name.endswith(SHARE)}
    return [f"{owner}: saturated for {_percent(share)} % of the time" for owner, share in shares.items() if share]


def _percent(share: float) -> str:
    """Two digits, and no 100 for what is less."""
    percent = 100 * share
    return f"{percent:.2g}" if percent < 99 else f"{percent:g}" if percent == 100 else ">99"
