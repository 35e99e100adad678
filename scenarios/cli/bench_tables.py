"""Tables of `flexbeams bench` for the terminal."""

from typing import Any

from rich.table import Table

from flexbeams.scenarios.cli.tables import console

_VARIANTS = {"bare": "bare C", "fmi": "FMI functions", "runner": "runner", "numpy": "numpy"}


def show_bench(figures: dict[str, Any]) -> None:
    """Costs, real-time figures, growth, and each target with its verdict."""
    out = console()
    steps = figures["steps"]
    out.print(
        f"[bold]{figures['scenario']}, {steps} steps of {1e6 * figures['step_s']:g} µs[/]; least times "
        f"and median ratios of {figures['rounds']} interleaved rounds, compiler {figures['compiler']}",
        soft_wrap=True,
    )
    for table in (
        _loops(figures["loops"], steps),
        _transitions(figures["transitions"]),
        _plant_forms(figures["plant_forms"]),
        _growth(figures["growth"]),
        _targets(figures["targets"]),
    ):
        out.print(table)
    out.print(_callers(figures["callers"]), soft_wrap=True)
    r = figures["real_time"]
    durations = ", ".join(f"{name} {1e6 * r[name]:.1f} µs" for name in ("median", "p99", "p99.99", "max"))
    out.print(
        f"one closed-loop step, of {r['steps']}: {durations}; {r['over_limit']} above {1e6 * r['limit']:g} µs",
        soft_wrap=True,
    )


def _callers(costs: dict[str, Any]) -> str:
    """The cost of a step that Python code asks for, on one line."""
    text = (
        f"one step from Python: {costs['simulation']:.2f} µs with a law of one's own, {costs['overhead']:.2f} µs of "
        f"this beyond the units ({costs['units']:.2f} µs)"
    )
    if costs["environment"] is None:
        return text
    each = f"{costs['environment']:.2f} µs, {1e6 / costs['environment']:,.0f} a second"
    return f"{text}; of the environment flexbeams/Tracking-v0: {each}"


def show_samples(figures: dict[str, Any]) -> None:
    """What a sample of a study costs, beside the stepping loop of a run."""
    table = _titled(f"{figures['study']}, {figures['steps']} steps", "", "processor time, ms", "x run", "a core-second")
    names = {
        "run": "stepping loop of a run",
        "units": "sample through the FMI units",
        "batch": "sample through the batch kernel",
    }
    for key, name in names.items():
        cost = figures[key]
        table.add_row(name, f"{1e3 * cost['seconds']:.2f}", f"{cost['ratio']:.3f}", f"{1 / cost['seconds']:.0f}")
    console().print(table)


def show_masters(figures: dict[str, Any]) -> None:
    """Seconds of each master beside the runner's, and how far they agree."""
    out = console()
    out.print(
        f"[bold]{figures['scenario']}.ssp, {figures['steps']} steps of {1e6 * figures['step_s']:g} µs[/]; least "
        "times, each master in a process of its own on one core",
        soft_wrap=True,
    )
    table = _titled(
        "s for these steps, x runner", "master", "coupling", "deviation", "recorded", "x", "silent", "x", "loading"
    )
    for m in figures["masters"]:
        figures_of = (
            ("deviation", ".1e"),
            ("recorded_s", ".3f"),
            ("recorded_ratio", ".1f"),
            ("silent_s", ".3f"),
            ("silent_ratio", ".1f"),
            ("loading_s", ".2f"),
        )
        table.add_row(
            f"{m['name']} {m['version']}",
            m["coupling"],
            *("" if m[key] is None else format(m[key], form) for key, form in figures_of),
        )
    out.print(table)
    out.print(
        f"recorded: {figures['signals']} signals at every step; deviation: largest difference of a signal from "
        "the runner's with that coupling, relative to the signal's largest value. Where no loading is given, the "
        "other times include it.",
        soft_wrap=True,
    )
    if figures["missing"]:
        out.print(f"not installed, or failed: {', '.join(figures['missing'])}", soft_wrap=True)


def _titled(title: str, first: str, *others: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column(first)
    for heading in others:
        table.add_column(heading, justify="right")
    return table


def _loops(loops: list[dict[str, Any]], steps: int) -> Table:
    table = _titled("loops", "loop", "", f"s for {steps} steps", "µs a step", "x bare")
    for loop in loops:
        for variant, title in _VARIANTS.items():
            cost = loop[variant]
            ratio = "" if cost["ratio"] is None else f"{cost['ratio']:.2f}"
            table.add_row(
                loop["name"] if variant == "bare" else "",
                title,
                f"{cost['seconds']:.4f}",
                f"{cost['us_per_step']:.3f}",
                ratio,
                end_section=variant == "numpy",
            )
    return table


def _transitions(transitions: list[dict[str, Any]]) -> Table:
    table = _titled(
        "step of the feedforward with transitions in progress",
        "transitions",
        "FMI functions, µs",
        "bare C, µs",
        "x bare",
    )
    for t in transitions:
        table.add_row(
            str(t["transitions"]), f"{t['fmi_us_per_step']:.2f}", f"{t['bare_us_per_step']:.2f}", f"{t['ratio']:.2f}"
        )
    return table


def _plant_forms(forms: list[dict[str, Any]]) -> Table:
    table = _titled(
        "the plant's modal form beside the dense one, FMI functions", "cost", "modal, µs", "dense, µs", "x dense"
    )
    for f in forms:
        table.add_row(f["cost"], f"{f['modal_us']:.2f}", f"{f['dense_us']:.2f}", f"{f['ratio']:.3f}")
    return table


def _growth(growth: list[dict[str, Any]]) -> Table:
    table = _titled(
        "growth: µs a step through the FMI functions (bare C), x bare",
        "beams",
        "plant's states",
        "plant",
        "x",
        "modes kept a beam",
        "reduced states",
        "controller",
        "x",
    )
    for g in growth:
        cells = [f"{g[u]['fmi_us_per_step']:.2f} ({g[u]['bare_us_per_step']:.2f})" for u in ("plant", "controller")]
        ratios = [f"{g[u]['ratio']:.2f}" for u in ("plant", "controller")]
        table.add_row(
            str(g["beams"]),
            str(g["states"]),
            cells[0],
            ratios[0],
            str(g["reduced_modes"]),
            str(g["reduced_states"]),
            cells[1],
            ratios[1],
        )
    return table


def _targets(targets: list[dict[str, Any]]) -> Table:
    table = _titled("targets", "figure", "measured", "at most", "")
    for t in targets:
        unit = {"us": "µs"}.get(t["unit"], t["unit"])
        table.add_row(
            t["name"],
            f"{t['measured']:.2f} {unit}",
            f"{t['limit']:g} {unit}",
            "[green]met[/]" if t["met"] else "[red bold]missed[/]",
        )
    return table


def show_identification(figures: dict[str, Any]) -> None:
    """Processor time of identifications."""
    table = Table("structure", "parameters", "rows", "CPU time, s", "evaluations", "within 2 %", title="Identification")
    for f in figures["fits"]:
        cells = (f["parameters"], f["rows"], f"{f['cpu_s']:.1f}", f["evaluations"], f["found"])
        table.add_row(f["structure"], *map(str, cells))
    console().print(table)
