"""Exports of a library for macOS, reduced to those of FMI.

zig's linker exports `__mh_dylib_header` and `___dso_handle` of every library. Names are taken out of the exports trie,
which keeps its place and size; in a signed library the hashes of the changed pages follow. Nothing else changes.
"""

import hashlib
import struct
from collections.abc import Mapping

from flexbeams.fmus.errors import BuildError

_DYLD_INFO, _EXPORTS_TRIE, _SIGNATURE = 0x80000022, 0x80000033, 0x1D
_SHA256 = 2
_FMI = "_fmi2"  # begin of the names


def fmi_exports(library: bytes) -> bytes:
    """The 64-bit Mach-O library with FMI's functions as its only exports.

    Raises BuildError where its signature is of another kind than zig's.
    """
    (start, size), signature = _places(library)
    exports = _read(library[start : start + size], 0, "") if size else {}
    kept = {name: entry for name, entry in exports.items() if name.startswith(_FMI)}
    if kept == exports:
        return library
    trie = _write(kept)
    if len(trie) > size:
        raise BuildError("the exports of a library for macOS do not fit into their place")
    content = bytearray(library)
    content[start : start + size] = trie.ljust(size, b"\0")
    if signature is not None:
        _hash_pages(content, signature)
    return bytes(content)


def _places(library: bytes) -> tuple[tuple[int, int], int | None]:
    """Offset and size of the exports trie, and the offset of the signature, if any."""
    trie, signature, offset = (0, 0), None, 32
    for _ in range(struct.unpack_from("<I", library, 16)[0]):
        command, size = struct.unpack_from("<II", library, offset)
        if command in (_DYLD_INFO, _EXPORTS_TRIE):
            trie = struct.unpack_from("<II", library, offset + (40 if command == _DYLD_INFO else 8))
        elif command == _SIGNATURE:
            (signature,) = struct.unpack_from("<I", library, offset + 8)
        offset += size
    return trie, signature


def _read(trie: bytes, at: int, name: str) -> dict[str, bytes]:
    """What the trie has on each name below a node."""
    size, at = _number(trie, at)
    found = {name: bytes(trie[at : at + size])} if size else {}
    children, at = trie[at + size], at + size + 1
    for _ in range(children):
        end = trie.index(0, at)
        child, after = _number(trie, end + 1)
        found |= _read(trie, child, name + trie[at:end].decode())
        at = after
    return found


def _number(data: bytes, at: int) -> tuple[int, int]:
    """An ULEB128 number, and where the next byte is."""
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        shift, at = shift + 7, at + 1
        if data[at - 1] < 0x80:
            return value, at


def _encoded(value: int) -> bytes:
    """A number as ULEB128."""
    low, rest = value & 0x7F, value >> 7
    return bytes([low | 0x80]) + _encoded(rest) if rest else bytes([low])


def _write(entries: Mapping[str, bytes]) -> bytes:
    """A trie: nodes with what there is on their name, and edges to children, each after its parent."""
    nodes: list[tuple[bytes, list[tuple[str, int]]]] = []

    def add(names: list[str], prefix: str) -> int:
        number = len(nodes)
        edges: list[tuple[str, int]] = []
        nodes.append((entries.get(prefix, b""), edges))
        rest = [name for name in names if name != prefix]
        while rest:
            group = [name for name in rest if name[len(prefix)] == rest[0][len(prefix)]]
            common = _common(group)
            edges.append((common[len(prefix) :], add(group, common)))
            rest = rest[len(group) :]
        return number

    add(sorted(entries), "")
    offsets = [0] * len(nodes)
    while True:
        encoded = [
            _encoded(len(entry))
            + entry
            + bytes([len(edges)])
            + b"".join(edge.encode() + b"\0" + _encoded(offsets[child]) for edge, child in edges)
            for entry, edges in nodes
        ]
        places = [sum(map(len, encoded[:k])) for k in range(len(encoded))]
        if places == offsets:
            return b"".join(encoded)
        offsets = places


def _common(names: list[str]) -> str:
    """The longest beginning of all names, which are sorted."""
    first, last = names[0], names[-1]
    k = 0
    while k < min(len(first), len(last)) and first[k] == last[k]:
        k += 1
    return first[:k]


def _hash_pages(content: bytearray, signature: int) -> None:
    """Computes the page hashes of an ad-hoc signature again."""
    count = struct.unpack_from(">I", content, signature + 8)[0]
    for k in range(count):
        kind, place = struct.unpack_from(">II", content, signature + 12 + 8 * k)
        if kind:  # not the code directory
            continue
        directory = signature + place
        hashes, _, _, slots, limit = struct.unpack_from(">IIIII", content, directory + 16)
        size, method, _, page = struct.unpack_from(">BBBB", content, directory + 36)
        if method != _SHA256:
            raise BuildError(f"the signature of a library for macOS must have SHA-256 hashes, got kind {method}")
        for slot in range(slots):
            begin = slot << page
            digest = hashlib.sha256(content[begin : min(begin + (1 << page), limit)]).digest()
            content[directory + hashes + size * slot : directory + hashes + size * (slot + 1)] = digest
