"""Byte layout of a saved FMU state: a header with checks, then the parts; little-endian, no pointers."""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.python.checks import TERMINATED
from flexbeams.fmus.python.clock import Clock

LARGEST_INTEGER = 2**31 - 1  # of FMI
STATE_MAGIC = b"flxbeams"
STATE_VERSION = 2
# magic, version, CRC-32 of all that follows it, length, digest of unit and data, phase
STATE_HEADER = struct.Struct("<8sIIQ32sQ")


def pack_state(digest: bytes, phase: int, parts: Sequence[bytes]) -> bytes:
    """The parts, their sizes and the header as one string of bytes."""
    sizes = struct.pack(f"<{len(parts)}Q", *map(len, parts))
    body = sizes + b"".join(parts)
    header = STATE_HEADER.pack(STATE_MAGIC, STATE_VERSION, 0, STATE_HEADER.size + len(body), digest, phase)
    checked = header[16:] + body
    return header[:12] + struct.pack("<I", zlib.crc32(checked)) + checked


def unpack_state(state: object, digest: bytes, parts: int) -> tuple[int, list[bytes]]:
    """Phase and parts; ValueError where the bytes are not an intact state of the unit with this digest."""
    if not isinstance(state, bytes) or len(state) < STATE_HEADER.size or state[:8] != STATE_MAGIC:
        raise ValueError("must be one that this unit saved, got something else")
    _, version, crc, length, origin, phase = STATE_HEADER.unpack_from(state)
    if version != STATE_VERSION:
        raise ValueError(f"must have version {STATE_VERSION}, got {version}")
    if length != len(state) or crc != zlib.crc32(state[16:]):
        raise ValueError(f"must be complete and unchanged, got {len(state)} damaged bytes")
    if origin != digest:
        raise ValueError("must be of the same unit and design, got that of another")
    position = STATE_HEADER.size + 8 * parts
    contents = []
    for size in struct.unpack_from(f"<{parts}Q", state, STATE_HEADER.size):
        contents.append(state[position : position + size])
        position += size
    return phase, contents


def little_endian(array: NDArray[Any]) -> bytes:
    """The numbers of an array, the same bytes on every machine."""
    return array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()


def unpack_arrays(like: Sequence[NDArray[Any]], parts: Sequence[bytes]) -> list[NDArray[Any]]:
    """Arrays of the same types and shapes as some others; ValueError where the parts do not fit them."""
    if [len(part) for part in parts] != [array.nbytes for array in like]:
        raise ValueError("must have arrays of the same sizes")
    return [
        np.frombuffer(part, array.dtype.newbyteorder("<")).reshape(array.shape)
        for array, part in zip(like, parts, strict=True)
    ]


def is_plausible(
    variables: Sequence[dict[str, Any]], phase: int, arrays: Sequence[NDArray[Any]], *, failed: bool
) -> bool:
    """Whether a unit can have saved this: the clock's fields, the values, then its state arrays.

    The clock and the variable time agree, what can be set is within its bounds, Integers and Booleans are such; all is
    finite unless a step failed.
    """
    clock = Clock()
    clock.fields[:] = arrays[0]
    values = arrays[1].tolist()
    return (
        phase <= TERMINATED
        and clock.is_valid()
        and values[0] == clock.start + clock.elapsed
        and all(_is_possible(variable, value) for variable, value in zip(variables, values, strict=True))
        and (failed or all(np.isfinite(array).all() for array in arrays))
    )


def _is_possible(variable: dict[str, Any], value: float) -> bool:
    """Whether a variable can have this value."""
    if variable["type"] == "Boolean":
        return value in (0.0, 1.0)
    if variable["type"] == "Integer" and not (abs(value) <= LARGEST_INTEGER and value.is_integer()):
        return False
    if variable["type"] == "String" or variable["causality"] not in ("input", "parameter"):
        return True
    largest = sys.float_info.max
    return bool(variable.get("minimum", -largest) <= value <= variable.get("maximum", largest))
