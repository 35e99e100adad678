"""Where the blocks of a system diagram and their connectors stand: blocks in a row from left to right."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

PITCH = 5.0     # between connectors of a block, in units of the diagram (mm)
WIDTH, GAP, MARGIN = 60.0, 60.0, 20.0


@dataclass(frozen=True, kw_only=True)
class Block:
    """A block with its lower left and its upper right corner, and (x, y) of its connectors within 0 ... 1."""

    corners: tuple[float, float, float, float]
    connectors: dict[str, tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Diagram:
    """All blocks and the canvas around them."""

    corners: tuple[float, float, float, float]
    blocks: dict[str, Block]


def arrange(ports: Mapping[str, tuple[Sequence[str], Sequence[str]]]) -> Diagram:
    """Blocks by name, with inputs on the left and outputs on the right, in the order given."""
    blocks, left, highest = {}, MARGIN, 0.0
    for name, (inputs, outputs) in ports.items():
        height = PITCH * max(len(inputs), len(outputs), 3)
        places = {n: (x, 1 - (k - 0.5) / len(names)) for x, names in ((0.0, inputs), (1.0, outputs))
                  for k, n in enumerate(names, 1)}
        blocks[name] = left, height, places
        left += WIDTH + GAP
        highest = max(highest, height)
    middle = MARGIN + highest / 2
    return Diagram(corners=(0.0, 0.0, left - GAP + MARGIN, highest + 2 * MARGIN), blocks={
        name: Block(corners=(x, middle - height / 2, x + WIDTH, middle + height / 2), connectors=places)
        for name, (x, height, places) in blocks.items()})
