"""Byte layout of a saved FMU state: a header with checks, then the parts; little-endian, no pointers."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence

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
