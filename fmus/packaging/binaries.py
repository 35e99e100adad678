"""Folders of a unit's binaries, and the universal binary for macOS.

Each platform has the folder that FMI 2.0.4 and 3.0 name after CPU and system. FMI 2.0's own folders name no CPU, and
hosts look there whatever their CPU: `darwin64` holds code for both, `linux64` that for x86_64, or for ARM where there
is no other.
"""

import struct
from collections.abc import Mapping, Sequence

from flexbeams.fmus.packaging.compilers import Platform

_FAT_MAGIC = 0xCAFEBABE
_MACH_O_64 = 0xFEEDFACF  # little-endian
_ALIGNMENT = {0x01000007: 12, 0x0100000C: 14}  # x86_64, arm64: page size as a power of two


def binary_entries(unit: str, binaries: Mapping[Platform, bytes]) -> dict[str, bytes]:
    """Entries of an FMU, path to content, for the libraries of a unit by platform."""
    entries = {f"binaries/{p.name}/{unit}{p.suffix}": binary for p, binary in binaries.items()}
    shared: dict[str, dict[str, bytes]] = {}
    for p, binary in binaries.items():
        shared.setdefault(f"binaries/{p.fmi2_folder}/{unit}{p.suffix}", {})[p.name] = binary
    for path, by_name in shared.items():
        slices = [by_name[name] for name in sorted(by_name, reverse=True)]  # x86_64 first
        several = len(slices) > 1 and path.endswith(".dylib")
        entries[path] = universal_binary(slices) if several else slices[0]
    return entries


def universal_binary(slices: Sequence[bytes]) -> bytes:
    """A Mach-O file for several CPUs: a header that lists the slices, which stay as they are, signatures included."""
    header = struct.pack(">II", _FAT_MAGIC, len(slices))
    offset, body = len(header) + 20 * len(slices), b""
    for content in slices:
        magic, cpu, subtype = struct.unpack_from("<III", content)
        if magic != _MACH_O_64:
            raise ValueError("a slice must be a 64-bit Mach-O file")
        padding = -(offset + len(body)) % (1 << _ALIGNMENT[cpu])
        header += struct.pack(">IIIII", cpu, subtype, offset + len(body) + padding, len(content), _ALIGNMENT[cpu])
        body += bytes(padding) + content
    return header + body
