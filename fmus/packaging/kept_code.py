"""Compiled code of units in the user's cache: it is the same for every design, only the tables are compiled anew."""

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from flexbeams.fmus.packaging.cache import is_sound, keep, toolchain_key
from flexbeams.fmus.packaging.compilers import FLAGS, Compiler, Platform
from flexbeams.plant.errors import InputError


def code_object(
    source: Path,
    includes: Sequence[Path],
    tool: Compiler,
    platform: Platform,
    definitions: Sequence[str],
    root: Path | None,
) -> Path:
    """The object file, beside `source`, of a unit's one C file without its tables.

    It is copied from the cache `root`, or made and kept there; a cache that cannot be used is left alone. Raises
    BuildError where the tool fails.
    """
    compiled = source.with_suffix(".o")
    what = [toolchain_key(tool.name), platform.name, platform.target, *platform.flags, *FLAGS, *definitions]
    digest = hashlib.sha256("\n".join(what).encode())
    for file in (source, *(header for folder in includes for header in sorted(folder.glob("*.h")))):
        digest.update(file.read_bytes())
    kept = root / "code" / f"{source.stem}-{platform.name}-{digest.hexdigest()[:16]}.o" if root else None
    if root and kept and is_sound(kept, root):
        compiled.write_bytes(kept.read_bytes())
        return compiled
    tool.compile(compiled, source, includes, platform, [*definitions, "CODE_ONLY"])
    if root and kept:
        with suppress(InputError, OSError):
            keep(kept, compiled.read_bytes(), root)
    return compiled
