"""The user's cache of compiled code, which is checked before it is loaded.

Beside each file is its SHA-256 in <file>.sha256: what is damaged, empty or half written is made again. Files and
folders must belong to the user and not be writable by others, since the code inside runs.
"""

import hashlib
import os
import stat
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from flexbeams.fmus.packaging.compilers import compiler_version, host_name
from flexbeams.plant.archive import remove_file, write_whole
from flexbeams.plant.errors import InputError
from flexbeams.plant.versions import installed_version

VARIABLE = "FLEXBEAMS_CACHE"  # environment variable with the folder
_HASH = ".sha256"


def cache_folder(chosen: str | Path | None = None) -> Path:
    """The folder that is chosen, else that of the environment variable, else the user's."""
    if chosen or (chosen := os.environ.get(VARIABLE)):
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("flexbeams", appauthor=False)


@cache
def toolchain_key(compiler: str) -> str:
    """What compiled code depends on beside its sources: compiler, its version, platform and version of the package."""
    return f"{compiler} {compiler_version(compiler)} {host_name()} {installed_version('flexbeams')}"


def prepare_cache(root: Path) -> None:
    """Creates the cache, for its owner alone; InputError where it is not private or cannot be created."""
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = root.stat()
    except OSError as error:
        raise InputError("", f"cannot be the cache: {error.strerror}", source=str(root)) from None
    if os.name == "posix" and state.st_uid != os.getuid():
        rule = "must belong to the user who runs flexbeams: its code would run (choose another with --cache)"
        raise InputError("", rule, source=str(root))
    if os.name == "posix" and state.st_mode & 0o022:
        rule = f"must not be writable by others: its code would run (chmod go-w '{root}')"
        raise InputError("", rule, source=str(root))


def is_sound(file: Path, root: Path) -> bool:
    """Whether a file of the cache is complete, as it was written, and nobody else could change it."""
    try:
        folders = [folder for folder in file.parents if folder.is_relative_to(root)]
        if not all(_is_private(path) for path in (file, *folders)) or not stat.S_ISREG(file.lstat().st_mode):
            return False
        return _hash_file(file).read_text(encoding="ascii") == hashlib.sha256(file.read_bytes()).hexdigest()
    except (OSError, ValueError):
        return False


def prepare_folder(folder: Path, root: Path) -> None:
    """Creates a folder of the cache, and the ones around it, for their owner alone."""
    prepare_cache(root)
    for path in [*reversed(folder.relative_to(root).parents), folder.relative_to(root)]:
        target = root / path
        try:
            target.mkdir(mode=0o700, exist_ok=True)
            if not _is_private(target):
                target.chmod(0o700)
        except OSError as error:
            raise InputError("", f"cannot be written: {error.strerror}", source=str(target)) from None


def keep(file: Path, content: bytes, root: Path) -> None:
    """Writes a file into the cache with its hash."""
    prepare_folder(file.parent, root)
    remove_file(_hash_file(file))
    write_whole(file, content)
    record(file)


def record(file: Path) -> None:
    """Writes the hash of a file that has just been made."""
    write_whole(_hash_file(file), hashlib.sha256(file.read_bytes()).hexdigest().encode())


def cached_files(root: Path) -> Iterator[Path]:
    """The files that were written into the cache; others in its folder are not among them."""
    for beside in sorted(root.rglob(f"*{_HASH}")):
        if (file := beside.with_name(beside.name.removesuffix(_HASH))).is_file():
            yield file


def clear_cache(root: Path) -> int:
    """Removes the files that were written into the cache, and folders that are then empty; returns how many."""
    files = list(cached_files(root))
    for file in files:
        remove_file(file)
        remove_file(_hash_file(file))
        for folder in file.parents:
            if folder == root or not folder.is_relative_to(root):
                break
            with suppress(OSError):
                folder.rmdir()
    return len(files)


def _hash_file(file: Path) -> Path:
    return file.with_name(f"{file.name}{_HASH}")


def _is_private(path: Path) -> bool:
    state = path.stat()
    return os.name != "posix" or (state.st_uid == os.getuid() and not state.st_mode & 0o022)
