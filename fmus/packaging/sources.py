"""What files made by this project depend on: its own sources."""

import hashlib
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parents[2]


def sources_digest(*packages: str) -> str:
    """Hash of the Python and C sources of some of the packages plant, controller and fmus."""
    return hashlib.sha256("".join(map(_package_digest, packages)).encode()).hexdigest()


@cache
def _package_digest(package: str) -> str:
    digest = hashlib.sha256()
    for path in sorted(p for p in (_ROOT / package).rglob("*") if p.suffix in (".py", ".c", ".h")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
