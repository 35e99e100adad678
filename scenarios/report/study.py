"""The page of a study: failures, distributions, worst runs, sensitivity, parallel coordinates, failure boundaries."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.scenarios.report.boundaries import boundary_charts, boundary_rows
from flexbeams.scenarios.report.charts import axis, chart
from flexbeams.scenarios.report.page import float32, render
from flexbeams.scenarios.results.display import display_unit, limits, number

BINS = 30  # of a histogram
MAX_LINES = 500  # of the parallel coordinates
COORDINATES = 8  # inputs among them, the most important ones
MAX_FAILURES = 50  # that are listed
BAR = 150  # px, of an index of 1


@dataclass(frozen=True, kw_only=True)
class PageInput:
    """An input of the runs."""

    name: str
    unit: str
    nominal: float
    group: str
    values: Array  # (runs,)


@dataclass(frozen=True, kw_only=True)
class PageMeasure:
    """A measure with its sensitivity: (group, first, low, high, total, low, high), the most important group first."""

    name: str
    unit: str
    minimum: float | None
    maximum: float | None
    values: Array  # (runs,), NaN where a run failed
    worst: Sequence[int]  # indices of runs
    estimator: str
    left_out: int
    indices: Sequence[tuple[str, float, float, float, float | None, float | None, float | None]]

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Which runs break a limit."""
        low = -np.inf if self.minimum is None else self.minimum
        high = np.inf if self.maximum is None else self.maximum
        return np.asarray((self.values < low) | (self.values > high), dtype=bool)

    @property
    def limited(self) -> bool:
        """Whether it has a limit."""
        return self.minimum is not None or self.maximum is not None


@dataclass(frozen=True, kw_only=True)
class StudyPage:
    """What the page shows."""

    title: str
    description: str
    facts: Sequence[tuple[str, str]]
    runs: NDArray[np.int64]  # (runs,) their numbers
    failures: Sequence[tuple[int, str]]  # number and reason
    inputs: Sequence[PageInput]
    measures: Sequence[PageMeasure]
    links: Mapping[int, str]  # of the full runs that are there, by number
    command: str  # that makes the full run of a number


def write_study_page(page: StudyPage, path: Path) -> None:
    """Writes the page; it needs no other file but the full runs that it links to."""
    write_whole(path, study_html(page).encode("utf-8", "replace"))


def study_html(page: StudyPage) -> str:
    """The page; equal results give equal bytes."""
    limited = [m for m in page.measures if m.limited]
    outside = int(np.count_nonzero(np.any([m.outside for m in limited], axis=0))) if limited else 0
    return render(
        "study.html.j2",
        title=page.title,
        description=page.description,
        facts=page.facts,
        count=len(page.runs),
        failed=len(page.failures),
        outside=outside,
        has_limits=bool(limited),
        failures=list(page.failures)[:MAX_FAILURES],
        measures=[_measure(page, m) for m in page.measures],
        boundaries=boundary_rows(page.inputs, page.measures),
        limited=[m.name for m in limited],
        command=page.command,
        data={
            "charts": {
                "distributions": [_histogram(m) for m in page.measures if np.isfinite(m.values).any()],
                "boundaries": boundary_charts(page.inputs, page.measures),
            },
            "parallel": _parallel(page),
        },
    )


def _measure(page: StudyPage, measure: PageMeasure) -> dict[str, Any]:
    values = measure.values[np.isfinite(measure.values)]
    quantiles = np.quantile(values, (0.05, 0.5, 0.95)) if len(values) else [np.nan] * 3
    share = np.count_nonzero(measure.outside)
    return {
        "name": measure.name,
        "quantiles": [number(float(q), measure.unit) for q in quantiles],
        "limit": limits(measure.minimum, measure.maximum, measure.unit),
        "outside": f"{share} ({100 * share / max(len(values), 1):.1f} %)" if measure.limited else "",
        "breaks": bool(share),
        "worst": [
            {
                "run": int(page.runs[k]),
                "value": number(float(measure.values[k]), measure.unit),
                "link": page.links.get(int(page.runs[k]), ""),
            }
            for k in measure.worst
        ],
        "estimator": measure.estimator,
        "left_out": measure.left_out,
        "indices": [_index(*entry) for entry in measure.indices],
        "totals": bool(measure.indices) and measure.indices[0][4] is not None,
    }


def _index(
    group: str, first: float, low: float, high: float, total: float | None, below: float | None, above: float | None
) -> dict[str, Any]:
    def bar(value: float, start: float, end: float) -> dict[str, Any]:
        def place(x: float) -> float:
            return round(BAR * min(max(x, 0.0), 1.0), 1)

        shown = [round(100 * x) for x in (value, start, end)]
        text = f"{shown[0]} % ({shown[1]} to {shown[2]})"
        return {"width": place(value), "start": place(start), "end": place(end), "text": text}

    has_total = total is not None and below is not None and above is not None
    return {
        "group": group,
        "first": bar(first, low, high),
        "total": bar(total, below, above) if has_total else None,  # type: ignore[arg-type]
    }


def _histogram(measure: PageMeasure) -> dict[str, Any]:
    """Numbers of runs in bins, as the outline of bars; limits are marked."""
    unit, factor = display_unit(measure.unit, measure.values)
    values = factor * measure.values[np.isfinite(measure.values)]
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-9 * max(abs(low), abs(high), 1e-300):  # all equal but for rounding
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    counts, edges = np.histogram(values, bins=BINS, range=(low, high))
    x = np.repeat(edges, 2)
    y = np.concatenate([[0.0], np.repeat(counts, 2).astype(float), [0.0]])
    drawn = chart(
        measure.name,
        ({**axis(f"in {unit}" if unit else "value"), "short": unit or "value"}, x),
        axis("runs"),
        {"runs": y},
    )
    drawn["marks"] = [factor * v for v in (measure.minimum, measure.maximum) if v is not None]
    drawn["fill"] = True
    return drawn


def _parallel(page: StudyPage) -> dict[str, Any]:
    """Lines through the most important inputs and the measures, at most MAX_LINES: the worst of each measure first."""
    ranks: dict[str, float] = {}
    for measure in page.measures:
        for group, first, _, _, total, _, _ in measure.indices:
            ranks[group] = max(ranks.get(group, 0.0), first if total is None else total)
    ordered = sorted(page.inputs, key=lambda i: -ranks.get(i.group, 0.0))[:COORDINATES]
    complete = np.flatnonzero(np.all([np.isfinite(m.values) for m in page.measures], axis=0))
    worst = [k for m in page.measures for k in m.worst if k in complete]
    spread = complete[np.unique(np.linspace(0, len(complete) - 1, MAX_LINES).astype(int))] if len(complete) else []
    chosen = np.array(list(dict.fromkeys([*worst, *np.asarray(spread, dtype=int).tolist()]))[:MAX_LINES], dtype=int)
    owners = {i.name.partition(".")[0] for i in ordered}
    labels = [i.name.partition(".")[2] if len(owners) == 1 else i.name for i in ordered]
    axes: list[dict[str, Any]] = [
        {"label": label, "unit": i.unit, "values": float32(i.values[chosen])}
        for label, i in zip(labels, ordered, strict=True)
    ]
    for measure in page.measures:
        unit, factor = display_unit(measure.unit, measure.values)
        axes.append(
            {
                "label": measure.name,
                "unit": unit,
                "values": float32(factor * measure.values[chosen]),
                "outside": measure.outside[chosen].astype(int).tolist(),
                "limited": measure.limited,
            }
        )
    return {"axes": axes, "inputs": len(ordered), "runs": page.runs[chosen].tolist()}
