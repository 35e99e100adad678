"""Libraries compiled once in a session: equal sources and commands give equal bytes, as test_native_build shows."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from flexbeams.fmus.packaging.compilers import Compiler, Platform
from tests.helpers import made_once

compile_anew = Compiler.build


def compile_once(
    compiler: Compiler,
    library: Path,
    sources: Sequence[Path],
    includes: Sequence[Path],
    platform: Platform,
    definitions: Sequence[str] = (),
    processor: str = "",
) -> None:
    """Compiler.build, which takes the library of an earlier call where all that it depends on is equal."""
    digest = hashlib.sha256(
        repr((compiler, library.name, platform, definitions, processor, [s.name for s in sources])).encode()
    )
    headers = {header for folder in (*includes, *(s.parent for s in sources)) for header in folder.glob("*.h")}
    for file in (*sources, *sorted(headers, key=lambda header: (header.name, header))):
        digest.update(f"{file.name} {file.stat().st_size} ".encode() + file.read_bytes())

    def build(folder: Path) -> None:
        compile_anew(compiler, folder / library.name, sources, includes, platform, definitions, processor)

    kept = made_once(f"compiled/{digest.hexdigest()[:32]}", build)
    library.write_bytes((kept / library.name).read_bytes())
