"""Version information of Windows libraries, which the file's properties show there.

It is written in the binary format of a compiled resource (.res, VS_VERSIONINFO of the Windows documentation), which
linkers take as it is: a compiler for resource scripts is a program that zig would build first, half a minute of work.
"""

import struct
from collections.abc import Sequence

from flexbeams.fmus.interface.variables import Interface

_SIGNATURE, _STRUCTURE = 0xFEEF04BD, 0x10000  # of VS_FIXEDFILEINFO
_WINDOWS, _LIBRARY = 0x40004, 2  # VOS_NT_WINDOWS32, VFT_DLL
_VERSION_INFO, _ENGLISH, _UNICODE = 16, 0x409, 1200  # resource type, language, code page
_MEMORY = 0x30  # moveable and pure, as resource compilers set it


def version_resource(interface: Interface, file: str, version: str) -> bytes:
    """The compiled resource for the library `file` of a unit."""
    numbers = [int(n) if n.isdecimal() else 0 for n in version.split(".")[:4]]
    major, minor, patch, build = [*numbers, 0, 0, 0, 0][:4]
    numbered = (major << 16 | minor, patch << 16 | build)
    fixed = struct.pack("<13I", _SIGNATURE, _STRUCTURE, *numbered, *numbered, 0, 0, _WINDOWS, _LIBRARY, 0, 0, 0)
    texts = {
        "CompanyName": "flexbeams contributors",
        "FileDescription": f"{interface.unit_name}, FMI 2.0 co-simulation unit",
        "FileVersion": version,
        "InternalName": interface.unit_name,
        "LegalCopyright": "flexbeams contributors, BSD-2-Clause",
        "OriginalFilename": file,
        "ProductName": "flexbeams",
        "ProductVersion": version,
    }
    strings = [_text(name, text) for name, text in texts.items()]
    table = _block(f"{_ENGLISH:04X}{_UNICODE:04X}", children=strings, kind=1)
    translation = _block("Translation", struct.pack("<2H", _ENGLISH, _UNICODE))
    information = _block(
        "VS_VERSION_INFO",
        fixed,
        children=[
            _block("StringFileInfo", children=[table], kind=1),
            _block("VarFileInfo", children=[translation], kind=1),
        ],
    )
    return _entry(b"", 0, 0, 0, 0) + _entry(information, _VERSION_INFO, 1, _MEMORY, _ENGLISH)


def _entry(data: bytes, kind: int, name: int, memory: int, language: int) -> bytes:
    """A resource whose type and name are numbers; the first one of a file is empty."""
    header = struct.pack("<2I4HI2H2I", len(data), 32, 0xFFFF, kind, 0xFFFF, name, 0, memory, language, 0, 0)
    return _aligned(header + data)


def _text(name: str, text: str) -> bytes:
    """A block with a text; its length counts characters with the final 0."""
    return _block(name, _utf16(text), kind=1, length=len(_utf16(text)) // 2)


def _block(
    key: str, value: bytes = b"", *, kind: int = 0, length: int | None = None, children: Sequence[bytes] = ()
) -> bytes:
    """A node of VS_VERSIONINFO: lengths, kind (0 for numbers, 1 for text), key, value and the nodes below it."""
    body = _aligned(b"\0" * 6 + _utf16(key)) + value
    for child in children:
        body = _aligned(body) + child
    return struct.pack("<3H", len(body), len(value) if length is None else length, kind) + body[6:]


def _utf16(text: str) -> bytes:
    return f"{text}\0".encode("utf-16-le")


def _aligned(content: bytes) -> bytes:
    return content + b"\0" * (-len(content) % 4)
