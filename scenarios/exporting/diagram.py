"""A system diagram: blocks in a row from left to right, their connectors, and ways of connections around blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

PITCH = 5.0  # between connectors of a block, in units of the diagram (mm)
LANE = 2.0  # between ways side by side, at most
WIDTH, GAP, MARGIN = 60.0, 60.0, 20.0

Wire = tuple[str, str, str, str]  # block, output, block, input
Way = list[tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Block:
    """A block with its lower left and its upper right corner, and (x, y) of its connectors within 0 ... 1."""

    corners: tuple[float, float, float, float]
    connectors: dict[str, tuple[float, float]]

    def place(self, connector: str) -> tuple[float, float]:
        """Where a connector stands in the diagram."""
        x1, y1, x2, y2 = self.corners
        x, y = self.connectors[connector]
        return x1 + x * (x2 - x1), y1 + y * (y2 - y1)


@dataclass(frozen=True, kw_only=True)
class Diagram:
    """All blocks, the points between the ends of connections that are not straight, and the canvas around them."""

    corners: tuple[float, float, float, float]
    blocks: dict[str, Block]
    ways: dict[Wire, Way]


def arrange(ports: Mapping[str, tuple[Sequence[str], Sequence[str]]], wires: Sequence[Wire] = ()) -> Diagram:
    """Blocks by name, with inputs on the left and outputs on the right, in the order given.

    Straight lines join neighbours; connections to blocks further right pass above the blocks in between, those back
    to the left below, each in a lane of its own.
    """
    order = list(ports)
    around = [w for w in wires if order.index(w[2]) != order.index(w[0]) + 1]
    margin = MARGIN + LANE * len(around)
    highest = PITCH * max(max(len(inputs), len(outputs), 3) for inputs, outputs in ports.values())
    middle, blocks, left = margin + highest / 2, {}, margin
    for name, (inputs, outputs) in ports.items():
        half = PITCH * max(len(inputs), len(outputs), 3) / 2
        blocks[name] = Block(
            corners=(left, middle - half, left + WIDTH, middle + half),
            connectors={
                n: (x, 1 - (k - 0.5) / len(names))
                for x, names in ((0.0, inputs), (1.0, outputs))
                for k, n in enumerate(names, 1)
            },
        )
        left += WIDTH + GAP
    return Diagram(
        corners=(0.0, 0.0, left - GAP + margin, highest + 2 * margin),
        blocks=blocks,
        ways=_ways(around, order, blocks, middle, highest / 2),
    )


def _ways(
    around: Sequence[Wire], order: list[str], blocks: Mapping[str, Block], middle: float, half: float
) -> dict[Wire, Way]:
    """Four corners for each connection; inside one another, so that those of a pair of blocks do not cross."""

    def sorted_by(side: int) -> list[Wire]:
        chosen = [w for w in around if (order.index(w[2]) > order.index(w[0])) == (side > 0)]
        return sorted(
            chosen, key=lambda w: (abs(order.index(w[2]) - order.index(w[0])), -side * blocks[w[0]].place(w[1])[1])
        )

    pitch = min(LANE, 0.45 * GAP / max(len(around), 1))  # each of the ends has its half of a gap
    ways, used = {}, 0
    for side in (1, -1):
        for k, wire in enumerate(sorted_by(side), 1):
            start, end = blocks[wire[0]].place(wire[1]), blocks[wire[2]].place(wire[3])
            out, back = start[0] + (used + k) * pitch, end[0] - (used + k) * pitch
            lane = middle + side * (half + PITCH + k * LANE)
            ways[wire] = [(out, start[1]), (out, lane), (back, lane), (back, end[1])]
        used += len(ways)
    return ways
