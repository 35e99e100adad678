"""States of all instances of a simulation, in memory and as bytes that any process can restore."""

import json
import zlib
from collections import deque
from collections.abc import Mapping
from typing import Any
from weakref import WeakSet

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance

_MAGIC = b"flexbeams snapshot 1\n"


class HeldStates:
    """States in the memory of the units, by instance; they are released once nothing refers to them."""

    def __init__(self, handles: dict[str, Any], released: deque[dict[str, Any]]) -> None:
        self.handles, self._released = handles, released

    def __del__(self) -> None:
        self._released.append(self.handles)  # the simulation frees them between two of its calls


class UnitStates:
    """Saves and restores the states of instances."""

    def __init__(self, instances: Mapping[str, UnitInstance]) -> None:
        self._instances = instances
        self._released: deque[dict[str, Any]] = deque()
        self._taken: WeakSet[HeldStates] = WeakSet()

    def require_savable(self) -> None:
        """InputError for an instance whose unit cannot save and serialise its state."""
        for name, instance in self._instances.items():
            abilities = instance.description.coSimulation
            if not (abilities.canGetAndSetFMUstate and abilities.canSerializeFMUstate):
                rule = "cannot save its state (canGetAndSetFMUstate, canSerializeFMUstate in its modelDescription.xml)"
                raise InputError(f"instance.{name}", rule)

    def take(self) -> HeldStates:
        """The present states."""
        self.free_released()
        states = HeldStates({name: i.call("getFMUstate") for name, i in self._instances.items()}, self._released)
        self._taken.add(states)
        return states

    def took(self, states: HeldStates) -> bool:
        """Whether states are of these instances."""
        return states in self._taken

    def put(self, states: HeldStates) -> None:
        """Sets all instances to states taken here."""
        self.free_released()
        for name, handle in states.handles.items():
            self._instances[name].call("setFMUstate", handle)

    def to_bytes(self, states: HeldStates) -> dict[str, bytes]:
        """The states serialised by their units."""
        return {name: self._instances[name].call("serializeFMUstate", h) for name, h in states.handles.items()}

    def from_bytes(self, parts: Mapping[str, bytes]) -> HeldStates:
        """States of serialised ones; InputError for bytes that a unit refuses."""
        handles: dict[str, Any] = {}
        states = HeldStates(handles, self._released)
        for name, part in parts.items():
            try:
                handles[name] = self._instances[name].call("deSerializeFMUstate", part)
            except UnitFailure as failure:
                raise InputError("snapshot", f"is refused: {failure}") from None
        return states

    def free_all(self) -> None:
        """Frees all states, before the instances end."""
        self.free_released()
        for states in list(self._taken):
            self._free(states.handles)
            states.handles = {}
        self._taken.clear()

    def free_released(self) -> None:
        """Frees the states to which nothing refers any longer."""
        while self._released:
            self._free(self._released.popleft())

    def _free(self, handles: Mapping[str, Any]) -> None:
        for name, handle in handles.items():
            self._instances[name].call("freeFMUstate", handle)


def pack_snapshot(header: Mapping[str, Any], parts: Mapping[str, bytes]) -> bytes:
    """A snapshot: a line that names the format, the checksum of what follows, a line of JSON, the parts."""
    described = {**header, "parts": {name: len(part) for name, part in parts.items()}}
    content = json.dumps(described).encode() + b"\n" + b"".join(parts.values())
    return _MAGIC + zlib.crc32(content).to_bytes(4, "little") + content


def unpack_snapshot(data: bytes) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Header and parts of a snapshot; InputError for other bytes."""
    start = len(_MAGIC) + 4
    if not data.startswith(_MAGIC) or zlib.crc32(data[start:]).to_bytes(4, "little") != data[len(_MAGIC) : start]:
        raise InputError("snapshot", "must be the unchanged bytes of a snapshot")
    line, _, rest = data[start:].partition(b"\n")
    header = json.loads(line)
    parts = {}
    for name, size in header.pop("parts").items():
        parts[name], rest = rest[:size], rest[size:]
    return header, parts
