"""Processor time and memory of each command for chains of beams, and how they grow: `python -m tests.chain_commands`.

Every command works on files in a folder of its own with an empty cache; one that fails ends the measurement.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.structure import Structure
from tests.helpers import LOOP_WIRES, python_environment
from tests.oracles.chains import chain_of_beams

SCENARIO = """title = "Chain"
structure = "chain.toml"
stop_time = 6.0
[design]
basis = "{basis}"
planner = "{planner}"
verify = "{verify}"
[instance.feedforward]
unit = "FlatnessFeedforward"
start.preview = 2e-4
[instance.controller]
unit = "TrackingController"
[instance.plant]
unit = "BeamPlant"
{wires}[[input]]
to = "feedforward.y_target"
targets = [{{ time = 0.5, value = {target} }}]
"""
COMMANDS = {
    "design": ("design", "--scenario", "chain_scenario.toml", "--json"),
    "run": ("run", "chain_scenario.toml", "--no-report", "--out", "results"),
    "run again": ("run", "chain_scenario.toml", "--no-report", "--out", "results"),
    "export ssp": ("export", "chain_scenario.toml", "--format", "ssp", "-o", "chain.ssp"),
    "export closed loop": ("export", "chain_scenario.toml", "--format", "closed-loop", "-o", "chain.fmu"),
    "validate": ("validate", "chain.ssp", "chain.fmu"),
}


def structure_text(structure: Structure) -> str:
    """The structure as a TOML file."""
    lines = []
    for kind, parts in asdict(structure).items():
        for part in parts if isinstance(parts, list | tuple) else []:
            lines += [f"[[{kind}]]", *(f"{key} = {_value(value)}" for key, value in part.items() if value is not None)]
    return "\n".join(lines) + "\n"


def _value(value: object) -> str:
    return str(list(value)) if isinstance(value, tuple) else repr(value)


def measure(beams: int, basis: str, planner: str, verify: str) -> Iterator[tuple[str, float, float]]:
    """Name, processor time (s) and largest resident memory (MB) of each command."""
    structure = chain_of_beams(beams)
    model = beam_model(structure, "clamped_free", 10)
    gain = static_gains(model, model.assemble())[0]
    target = (gain @ (300 * np.cos(np.arange(gain.shape[1])))).tolist()
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder)
        (files / "chain.toml").write_text(structure_text(structure), encoding="utf-8")
        text = SCENARIO.format(basis=basis, planner=planner, verify=verify, wires=LOOP_WIRES, target=target)
        (files / "chain_scenario.toml").write_text(text, encoding="utf-8")
        environment = python_environment(FLEXBEAMS_CACHE=str(files / "cache"))
        for name, arguments in COMMANDS.items():
            log = (files / "log").open("w+")
            process = subprocess.Popen(
                [sys.executable, "-m", "flexbeams", *arguments], cwd=files, env=environment, stdout=log, stderr=log
            )
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode != 0:
                raise SystemExit(f"{name} of {beams} beams: {(files / 'log').read_text()[-2000:]}")
            yield name, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> None:
    """Prints a row for each command: s and MB for each number of beams, exponents from the first to the last."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beams", type=int, nargs="+", default=[1, 3, 5, 10, 12, 13, 20])
    parser.add_argument("--basis", default="clamped_free", choices=["clamped_free", "segment"])
    parser.add_argument("--planner", default="paper", choices=["paper", "multi_input"])
    parser.add_argument("--verify", default="exact", choices=["exact", "design"])
    options = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = {name: [] for name in COMMANDS}
    for beams in options.beams:
        for name, seconds, memory in measure(beams, options.basis, options.planner, options.verify):
            rows[name].append((seconds, memory))
            print(f"# {beams} beams, {name}: {seconds:.1f} s, {memory:.0f} MB", file=sys.stderr, flush=True)
    print(f"| command | {' | '.join(map(str, options.beams))} | growth |")
    for name, costs in rows.items():
        cells = " | ".join(f"{seconds:.1f} s, {memory:.0f} MB" for seconds, memory in costs)
        ratio = np.log(options.beams[-1] / options.beams[0]) or 1.0
        exponents = np.log(np.array(costs[-1]) / np.array(costs[0])) / ratio
        print(f"| {name} | {cells} | r^{exponents[0]:.1f}, r^{exponents[1]:.1f} |")


if __name__ == "__main__":
    main()
