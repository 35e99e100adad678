"""Files compiled once in a session: equal sources and commands give equal bytes, as test_native_build shows."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from flexbeams.fmus.packaging.compilers import Compiler, Platform
from tests.helpers import made_once

compile_anew = Compiler.make


def compile_once(
    compiler: Compiler,
    out: Path,
    options: Sequence[str],
    definitions: Sequence[str],
    includes: Sequence[Path],
    inputs: Sequence[Path | str],
    platform: Platform,
    processor: str = "",
) -> None:
    """Compiler.make, which takes the file of an earlier call where all that it depends on is equal."""
    files = [file for file in inputs if isinstance(file, Path)]
    what = (compiler, out.name, options, definitions, platform, processor, [file.name for file in files])
    digest = hashlib.sha256(repr(what).encode())
    headers = {header for folder in (*includes, *(s.parent for s in files)) for header in folder.glob("*.h")}
    for file in (*files, *(sorted(headers, key=lambda header: (header.name, header)))):
        if "CODE_ONLY" in definitions and file.name.endswith("_tables.h"):
            continue  # which such code does not include
        digest.update(f"{file.name} {file.stat().st_size} ".encode() + file.read_bytes())

    def make(folder: Path) -> None:
        compile_anew(compiler, folder / out.name, options, definitions, includes, inputs, platform, processor)

    kept = made_once(f"compiled/{digest.hexdigest()[:32]}", make)
    out.write_bytes((kept / out.name).read_bytes())
