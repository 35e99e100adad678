"""What a Mach-O library says of itself: CPU, oldest system, exported names, and whether its signature holds."""

import hashlib
import struct
from dataclasses import dataclass

X86_64, ARM64 = 0x01000007, 0x0100000C
_DYLD_INFO, _EXPORTS_TRIE, _BUILD_VERSION, _SIGNATURE = 0x80000022, 0x80000033, 0x32, 0x1D


@dataclass(frozen=True)
class Library:
    """One library for one CPU."""

    cpu: int
    oldest_macos: tuple[int, int]
    exports: list[str]
    signed: bool  # with page hashes that are those of the content


def universal(content: bytes) -> dict[int, bytes]:
    """The slices of a universal binary by CPU."""
    magic, count = struct.unpack_from(">II", content)
    assert magic == 0xCAFEBABE
    slices = {}
    for k in range(count):
        cpu, _, offset, size, alignment = struct.unpack_from(">IIIII", content, 8 + 20 * k)
        assert offset % (1 << alignment) == 0
        assert offset + size <= len(content)
        slices[cpu] = content[offset : offset + size]
        assert struct.unpack_from("<II", slices[cpu])[1] == cpu
    return slices


def read_library(content: bytes) -> Library:
    """A library from its load commands."""
    magic, cpu, _, kind, count = struct.unpack_from("<IIIII", content)
    assert (magic, kind) == (0xFEEDFACF, 6)
    offset, exports, oldest, signed = 32, [], (0, 0), False
    for _ in range(count):
        command, size = struct.unpack_from("<II", content, offset)
        if command == _BUILD_VERSION:
            packed = struct.unpack_from("<I", content, offset + 12)[0]
            oldest = packed >> 16, packed >> 8 & 0xFF
        elif command == _DYLD_INFO:
            start, length = struct.unpack_from("<II", content, offset + 40)
            exports = _names(content[start : start + length], 0, "")
        elif command == _EXPORTS_TRIE:
            start, length = struct.unpack_from("<II", content, offset + 8)
            exports = _names(content[start : start + length], 0, "")
        elif command == _SIGNATURE:
            start, length = struct.unpack_from("<II", content, offset + 8)
            signed = _signature_holds(content, start)
            assert start + length == len(content)
        offset += size
    return Library(cpu, oldest, sorted(exports), signed)


def _names(trie: bytes, at: int, name: str) -> list[str]:
    """Names below a node of the exports trie."""
    if not trie:
        return []
    size, at = _number(trie, at)
    names, at = [name] * (size > 0), at + size
    children, at = trie[at], at + 1
    for _ in range(children):
        end = trie.index(0, at)
        edge = trie[at:end].decode()
        child, at = _number(trie, end + 1)
        names += _names(trie, child, name + edge)
    return names


def _number(data: bytes, at: int) -> tuple[int, int]:
    """An ULEB128 number, and where the next byte is."""
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if data[at - 1] < 0x80:
            return value, at


def _signature_holds(content: bytes, start: int) -> bool:
    """Whether the pages have the hashes of the ad-hoc signature's code directory."""
    magic, _, count = struct.unpack_from(">III", content, start)
    assert magic == 0xFADE0CC0
    directory = next(
        start + place
        for kind, place in (struct.unpack_from(">II", content, start + 12 + 8 * k) for k in range(count))
        if kind == 0
    )
    hashes, _, _, slots, limit = struct.unpack_from(">IIIII", content, directory + 16)
    size, kind, _, page = struct.unpack_from(">BBBB", content, directory + 36)
    assert (size, kind, limit) == (32, 2, start)
    pages = [content[k : min(k + (1 << page), limit)] for k in range(0, limit, 1 << page)]
    stored = content[directory + hashes : directory + hashes + 32 * slots]
    return b"".join(hashlib.sha256(page).digest() for page in pages) == stored
