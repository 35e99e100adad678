"""Random third-party units, wired at random by scenario and by SSP, against a plain evaluation in Python.

FLEXBEAMS_WIRINGS=100000 runs as many systems instead of the 500 of the usual tests, in blocks of BLOCK for each test.
"""

import json
import os
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.recording import Recording
from tests.scenarios.test_foreign_packages import Shop
from tests.units.foreign.unit import ForeignUnit, ForeignVariable

pytestmark = [pytest.mark.native, pytest.mark.usefixtures("known_designs")]

SYSTEMS = int(os.environ.get("FLEXBEAMS_WIRINGS", "500"))
BLOCK = 100  # systems of one test
STEP, STEPS = 0.01, 6
TYPES = ("Real", "Real", "Integer", "Boolean", "Enumeration")
UNITS = ("", "m", "mm", "V")
FACTORS = {("m", "mm"): 1000.0, ("mm", "m"): 0.001}
TAKEN = {"Real": ("Real", "Integer"), "Integer": ("Integer", "Enumeration")}
STEMS = ("u", "x", "der(z)", 'a,"b"', "1st.part", "size-2", "gain", "time", "K")
OWNERS = ("a", "b", "c", "d")
PACKAGE_OWNERS = ("1st", "my unit", "b.c", "b")


@dataclass
class Part:
    """A unit of a system with what each output is of an input: (input, gain); None is the clock."""

    unit: ForeignUnit
    rules: dict[str, tuple[str, float] | None]
    sources: dict[str, tuple[str, str]] = field(default_factory=dict)  # (owner, output) by input
    constants: dict[str, float] = field(default_factory=dict)  # by input

    def variable(self, name: str) -> ForeignVariable:
        return next(v for v in self.unit.variables if v.name == name)

    def named(self, causality: str) -> list[ForeignVariable]:
        return [v for v in self.unit.variables if v.causality == causality]


def part(draw: random.Random) -> Part:
    """A unit with arrays and scalars in any order, and value references in any order from 0 for each type."""
    names = [f"{stem}[{k}]" for stem in draw.sample(STEMS, 1) for k in range(1, 4)]
    names += draw.sample([s for s in STEMS if not names[0].startswith(s)], 3)
    used = {
        "Real": draw.sample(range(60), 20),
        "Integer": draw.sample(range(60), 20),
        "Boolean": draw.sample(range(60), 20),
    }
    inputs = []
    for name in names:
        kind = "Real" if "[" in name else draw.choice(TYPES)
        start = {"Real": "0.5", "Integer": "3", "Boolean": draw.choice(("true", "false")), "Enumeration": "2"}[kind]
        reference = used["Integer" if kind == "Enumeration" else kind].pop()
        si = draw.choice(UNITS) if kind == "Real" else ""
        inputs.append(
            ForeignVariable(name=name, type=kind, causality="input", reference=reference, start=start, unit=si)
        )
    outputs, rules, lines, needs = [], {}, [], {}
    for k, source in enumerate(inputs):
        name, kind = f"out {k}", source.type
        reference = used["Integer" if kind == "Enumeration" else kind].pop()
        gain = 1.0 if kind in ("Enumeration", "Boolean") else float(draw.choice((-2, 1, 3, 4)))
        si = draw.choice(UNITS) if kind == "Real" else ""
        outputs.append(ForeignVariable(name=name, type=kind, causality="output", reference=reference, unit=si))
        letter = {"Real": "R", "Boolean": "B"}.get(kind, "I")
        lines.append(f"map {letter} {reference} {source.reference} {gain}")
        rules[name], needs[name] = (source.name, gain), [source.name]
    clock = ForeignVariable(name="clock", type="Real", causality="output", reference=used["Real"].pop())
    lines.append(f"clock {clock.reference}")
    variables = [*inputs, *outputs, clock]
    draw.shuffle(variables)
    dependencies = {**needs, "clock": []} if draw.random() < 0.5 else None
    return Part(
        unit=ForeignUnit(variables=variables, rules=lines, dependencies=dependencies), rules={**rules, "clock": None}
    )


def fits(start: ForeignVariable, end: ForeignVariable) -> bool:
    if start.type not in TAKEN.get(end.type, (end.type,)):
        return False
    one, other = (start.unit, end.unit) if start.type == end.type == "Real" else ("", "")
    return not one or not other or one == other or (one, other) in FACTORS


def system(draw: random.Random, names: tuple[str, ...], constants: bool) -> tuple[dict[str, Part], bool]:
    """Parts by name, without loops, and whether a connection joins what does not fit."""
    parts = {name: part(draw) for name in draw.sample(names, draw.randint(2, 4))}
    order = draw.sample(list(parts), len(parts))  # of evaluation; the system lists them in another one
    wrong = False
    for k, name in enumerate(order):
        for v in parts[name].named("input"):
            offers = [(o, w) for o in order[:k] for w in parts[o].named("output")]
            fitting = [(o, w) for o, w in offers if fits(w, v)]
            chance = draw.random()
            if fitting and chance < 0.6:
                owner, w = draw.choice(fitting)
                parts[name].sources[v.name] = (owner, w.name)
            elif offers and chance > 0.99 and len(fitting) < len(offers):
                owner, w = draw.choice([pair for pair in offers if pair not in fitting])
                parts[name].sources[v.name], wrong = (owner, w.name), True
            elif constants and chance > 0.8:
                parts[name].constants[v.name] = float(
                    draw.choice((0, 1)) if v.type == "Boolean" else draw.choice((1, 2))
                )
    return parts, wrong


def number(text: str) -> float:
    return float({"true": "1", "false": "0"}.get(text, text))


def expected(parts: dict[str, Part], seidel: bool) -> dict[str, list[float]]:
    """Every output at each step, by <owner>.<output>, as FMI's coupling has it."""
    values: dict[tuple[str, str], float] = {}
    inputs = {
        (name, v.name): p.constants.get(v.name, number(str(v.start)))
        for name, p in parts.items()
        for v in p.named("input")
    }
    rows: dict[str, list[float]] = {}

    def take(name: str) -> None:
        for target, (owner, output) in parts[name].sources.items():
            if (owner, output) in values:
                start, end = parts[owner].variable(output), parts[name].variable(target)
                real = start.type == end.type == "Real"
                inputs[name, target] = values[owner, output] * (
                    FACTORS.get((start.unit, end.unit), 1.0) if real else 1.0
                )

    def give(name: str, time: float) -> None:
        for output, rule in parts[name].rules.items():
            boolean = parts[name].variable(output).type == "Boolean"
            source = time if rule is None else inputs[name, rule[0]]
            values[name, output] = 1.0 - source if boolean else source * (1.0 if rule is None else rule[1])

    def record() -> None:
        for (name, output), value in values.items():
            rows.setdefault(f"{name}.{output}", []).append(value)

    for _ in parts:  # values settle: there are no loops
        for name in parts:
            take(name)
            give(name, 0.0)
    record()
    for step in range(STEPS):
        time = step * STEP + STEP
        for name in parts:
            take(name)
            if seidel:
                give(name, time)
        if not seidel:
            for name in parts:
                give(name, time)
        record()
    return rows


def scenario(folder: Path, parts: dict[str, Part], seidel: bool, settings: Settings) -> Callable[[], Recording]:
    text = f'title = "random"\nstructure = "single_beam"\nstop_time = {STEPS * STEP}\nstep = {STEP}\n'
    text += f'coupling = "{"gauss-seidel" if seidel else "jacobi"}"\n'
    for name, p in parts.items():
        p.unit.write(folder / f"{name}.fmu")
        text += f'[instance.{name}]\nfmu = "{name}.fmu"\n'
    for name, p in parts.items():
        for target, (owner, output) in p.sources.items():
            text += f"[[connection]]\nfrom = {json.dumps(f'{owner}.{output}')}\nto = {json.dumps(f'{name}.{target}')}\n"
        for target, value in p.constants.items():
            text += f"[[input]]\nto = {json.dumps(f'{name}.{target}')}\nconstant = {value}\n"
    (folder / "case.toml").write_text(text)
    return lambda: run_scenario(folder / "case.toml", settings).recording


def package(shop: Shop, parts: dict[str, Part], seidel: bool, settings: Settings) -> Callable[[], Recording]:
    def attribute(name: str) -> str:
        return escape(name, {'"': "&quot;"})

    wires = "".join(
        f'<ssd:Connection startElement="{owner}" startConnector="{attribute(output)}" endElement="{name}" '
        f'endConnector="{attribute(target)}"/>'
        for name, p in parts.items()
        for target, (owner, output) in p.sources.items()
    )
    path = shop.package({n: (p.unit, "") for n, p in parts.items()}, wires, stop=repr(STEPS * STEP))
    chosen = Settings(build_folder=settings.build_folder, coupling="gauss-seidel" if seidel else "jacobi")
    return lambda: run_package(path, chosen).recording


@pytest.mark.parametrize("first", range(0, SYSTEMS, BLOCK))
def test_random_systems_agree_with_a_plain_evaluation(first: int, tmp_path: Path, run_folder: Path) -> None:
    """Or they are refused in one line, exactly where a connection joins what does not fit."""
    settings = Settings(build_folder=run_folder / "build/fmus", record_animation=False)
    shop = Shop(tmp_path, settings.build_folder)
    seeds, refused = range(first, min(first + BLOCK, SYSTEMS)), 0
    for seed in seeds:
        draw = random.Random(seed)
        by_package, seidel = seed % 2 == 1, draw.random() < 0.5
        parts, wrong = system(draw, PACKAGE_OWNERS if by_package else OWNERS, constants=not by_package)
        run = (package(shop, parts, seidel, settings)) if by_package else scenario(tmp_path, parts, seidel, settings)
        if wrong:
            refused += 1
            with pytest.raises(InputError, match=r"^[^\n]*(joins types that differ|cannot be converted)[^\n]*$"):
                run()
            continue
        recording = run()
        rows = expected(parts, seidel)
        assert set(recording.columns) == set(rows), seed
        for column, values in zip(recording.columns, recording.values.T, strict=True):
            assert np.array_equal(values, rows[column]), (seed, column, values, rows[column])
    assert refused < len(seeds) / 2
    assert refused or first or len(seeds) < BLOCK
