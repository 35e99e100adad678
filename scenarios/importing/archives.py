"""Third-party FMUs and SSPs: checked before anything is written, extracted inside one folder and nowhere else."""

import os
import re
import stat
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from flexbeams.plant.errors import InputError

CHUNK = 1 << 20
_STORED_AS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)


MAX_SIZE = "FLEXBEAMS_MAX_SIZE"  # environment variable of the option --max-size, GB; child processes inherit it


def largest_size() -> int:
    """The largest uncompressed size of an archive, bytes."""
    return round(float(os.environ.get(MAX_SIZE, "1.073741824")) * 1e9)


@dataclass(kw_only=True)
class ExtractionBudget:
    """What may still be extracted; archives inside one another share one budget."""

    entries: int = 20_000
    size: int = field(default_factory=largest_size)  # bytes, uncompressed

    def check(self, path: Path) -> list[zipfile.ZipInfo]:
        """The entries of an archive; InputError where it breaks a rule."""
        source = str(path)
        try:
            with zipfile.ZipFile(path) as archive:
                entries = archive.infolist()
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
            raise InputError("", f"is not a readable archive: {error}", source=source) from None
        if len(entries) > self.entries:
            raise InputError("", f"must hold at most {self.entries} entries", len(entries), source=source)
        if (total := sum(e.file_size for e in entries)) > self.size:
            rule = f"must be at most {self.size} bytes when extracted (--max-size raises the limit)"
            raise InputError("", rule, total, source=source)
        seen: set[PurePosixPath] = set()
        for entry in entries:
            where = _checked_name(entry, source)
            if where in seen:
                raise InputError("", "must hold each entry once", entry.filename, source=source)
            seen.add(where)
        for where in seen:
            if any(parent in seen and not _is_folder(entries, parent) for parent in where.parents):
                raise InputError("", "must not hold a file and a folder of one name", str(where), source=source)
        self.entries -= len(entries)
        self.size -= total
        return entries

    def extract(self, path: Path, folder: Path, parts: tuple[str, ...] = ("",)) -> Path:
        """Extracts all entries to the new folder `folder`; InputError for an archive that breaks a rule or is damaged.

        Entries whose paths begin with none of `parts` are checked but not extracted.
        """
        entries = self.check(path)
        folder.mkdir(parents=True)
        try:
            with zipfile.ZipFile(path) as archive:
                for entry in entries:
                    if entry.filename.startswith(parts):
                        _write(archive, entry, folder)
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            OSError,
            NotImplementedError,
            ValueError,
            RuntimeError,
            MemoryError,
        ) as error:
            raise InputError("", f"cannot be extracted: {error}", source=str(path)) from None
        return folder


def _checked_name(entry: zipfile.ZipInfo, source: str) -> PurePosixPath:
    """Path of an entry, relative to the folder."""
    name, raw = entry.filename, entry.orig_filename
    path = PurePosixPath(name)
    if (
        not name
        or "\0" in raw
        or "\\" in raw
        or path.is_absolute()
        or re.match(r"[A-Za-z]:", name)
        or ".." in path.parts
        or not path.parts
    ):
        raise InputError("", "must hold entries with paths inside it, with / between folders", raw, source=source)
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        raise InputError("", "must hold files and folders only, no links", name, source=source)
    if entry.flag_bits & 0x1:
        raise InputError("", "must not be encrypted", name, source=source)
    if entry.compress_type not in _STORED_AS:
        raise InputError("", "must be compressed by a known method", name, source=source)
    return path


def _is_folder(entries: list[zipfile.ZipInfo], path: PurePosixPath) -> bool:
    return any(e.is_dir() and PurePosixPath(e.filename) == path for e in entries)


def _write(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> None:
    """Extracts one entry; one of another size than the archive states counts as damaged."""
    target = folder.joinpath(*PurePosixPath(entry.filename).parts)
    if entry.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    with archive.open(entry) as content, target.open("xb") as file:
        while chunk := content.read(CHUNK):
            written += len(chunk)
            if written > entry.file_size:
                raise zipfile.BadZipFile(f"{entry.filename} is longer than stated")
            file.write(chunk)
    if written != entry.file_size:
        raise zipfile.BadZipFile(f"{entry.filename} is shorter than stated")
