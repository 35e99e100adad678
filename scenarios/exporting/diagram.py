"""Layout of a system diagram: blocks in a row from left to right, their connectors, and routes around blocks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flexbeams.scenarios.exporting.links import Link

PITCH = 5.0  # between connectors of a block, in units of the diagram (mm)
LANE = 2.0  # between parallel routes, at most
WIDTH, GAP, MARGIN = 60.0, 60.0, 20.0

Route = list[tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Block:
    """A block with its lower left and its upper right corner, and (x, y) of its connectors within 0 ... 1."""

    corners: tuple[float, float, float, float]
    connectors: dict[str, tuple[float, float]]

    def position(self, connector: str) -> tuple[float, float]:
        """Coordinates of a connector in the diagram."""
        x1, y1, x2, y2 = self.corners
        x, y = self.connectors[connector]
        return x1 + x * (x2 - x1), y1 + y * (y2 - y1)


@dataclass(frozen=True, kw_only=True)
class Diagram:
    """All blocks, and the inner points of links that are not straight lines."""

    blocks: dict[str, Block]
    routes: dict[Link, Route]


def arrange(ports: Mapping[str, tuple[Sequence[str], Sequence[str]]], links: Sequence[Link] = ()) -> Diagram:
    """Blocks by name, with inputs on the left and outputs on the right, in the order given.

    Straight lines join neighbours; links to blocks further right pass above the blocks in between, links to the left
    below, each in a lane of its own.
    """
    order = list(ports)
    around = [link for link in links if order.index(link.end) != order.index(link.start) + 1]
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
        blocks=blocks,
        routes=_routes(around, order, blocks, middle, highest / 2),
    )


def _routes(
    around: Sequence[Link], order: list[str], blocks: Mapping[str, Block], middle: float, half: float
) -> dict[Link, Route]:
    """Four corners for each link, nested so that the routes between two blocks do not cross."""

    def nested(side: int) -> list[Link]:
        chosen = [link for link in around if (order.index(link.end) > order.index(link.start)) == (side > 0)]

        def key(link: Link) -> tuple[int, float]:
            distance = abs(order.index(link.end) - order.index(link.start))
            return distance, -side * blocks[link.start].position(link.output)[1]

        return sorted(chosen, key=key)

    pitch = min(LANE, 0.45 * GAP / max(len(around), 1))  # each end has its half of a gap
    routes, used = {}, 0
    for side in (1, -1):
        for k, link in enumerate(nested(side), 1):
            start, end = blocks[link.start].position(link.output), blocks[link.end].position(link.input)
            out, back = start[0] + (used + k) * pitch, end[0] - (used + k) * pitch
            lane = middle + side * (half + PITCH + k * LANE)
            routes[link] = [(out, start[1]), (out, lane), (back, lane), (back, end[1])]
        used += len(routes)
    return routes
