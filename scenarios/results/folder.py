"""A folder of results: one run writes into it at a time, and replaces only what an earlier run wrote there.

summary.json lists the files of a run with their SHA-256 hashes. While a run writes, it says so and lists both the files
that are being replaced and the new ones: the files of a run that was killed are known to the next one. The rows of a
long run are in results.partial.npy until its files are written.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from os.path import lexists
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from flexbeams.plant.archive import remove_file, whole_file, write_whole
from flexbeams.plant.errors import InputError
from flexbeams.plant.locks import Lock
from flexbeams.plant.versions import installed_version

SUMMARY = "summary.json"
PARTIAL = "results.partial.npy"
SCHEMA_VERSION = 1  # of summary.json
CLAIM = ("unfinished", "replaced", "partial", "files")  # entries that say what a folder holds and is being written
_IN_THE_WAY = "is in the way and was not written by flexbeams; move it, or choose another folder with --out"


class HashedFile:
    """A file being written, with the hash of its content."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._hash = file, hashlib.sha256()
        self.closed = False  # pyarrow asks

    def write(self, content: bytes) -> int:
        """Appends the content."""
        self._hash.update(content)
        return self._file.write(content)

    def tell(self) -> int:
        """Bytes written."""
        return self._file.tell()

    def flush(self) -> None:
        """Hands what was written to the system."""
        self._file.flush()

    def hexdigest(self) -> str:
        """The hash of what was written."""
        return self._hash.hexdigest()


class ResultFolder:
    """The folder `path`, created and locked; a context manager that releases it.

    Raises InputError for a folder that cannot be written to, or that another run writes to.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            rule = f"cannot be made a folder for results: {error.strerror}"
            raise InputError("", rule, source=str(path)) from None
        self._lock: Lock | None = None
        with suppress(OSError):  # a file system without locks
            self._lock = Lock(path)
        if self._lock is not None and not self._lock.held:
            raise InputError("", "is in use by another run; wait for it, or use --out", source=str(path))
        self.earlier: dict[str, Any] = {}  # summary of an earlier run
        self._earlier: dict[str, str] = {}  # files of an earlier run with their hashes
        self._files: dict[str, str] = {}
        self._head: dict[str, Any] = {}
        self._partial = False  # whether there is, or was, a file of rows

    def __enter__(self) -> "ResultFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._lock is not None:
            self._lock.release()

    def require_free(self, names: Iterable[str]) -> dict[str, Any]:
        """The summary of an earlier run, empty without one; InputError where a file is in the way.

        Files of these names, and those that the earlier run lists, must be as that run wrote them.
        """
        self.earlier = summary = self._read_summary()
        replaced, written = summary.get("replaced", {}), summary.get("files", {})
        listed = [name for name in {**replaced, **written} if Path(name).name == name]
        self._partial = summary.get("partial") == PARTIAL
        if lexists(self.path / PARTIAL) and not self._partial:
            raise InputError("", _IN_THE_WAY, source=str(self.path / PARTIAL))
        for name in dict.fromkeys([*names, *listed]):
            path = self.path / name
            if name == SUMMARY or not lexists(path):
                continue
            if name not in listed:
                raise InputError("", _IN_THE_WAY, source=str(path))
            self._earlier[name] = _hash(path.read_bytes()) if path.is_file() else ""
            if self._earlier[name] not in (replaced.get(name), written.get(name)):
                rule = "is in the way and was changed after a run wrote it; move it, or use --out"
                raise InputError("", rule, source=str(path))
        return summary

    def begin(self, head: Mapping[str, Any]) -> None:
        """Marks the folder as being written to by a run; `head` are entries of its summary."""
        self._head = dict(head)
        self._write_claim()

    def begin_rows(self, head: Mapping[str, Any]) -> Path:
        """The file for the rows of a long run, which begins; see `begin`."""
        self._partial = True
        self.begin(head)
        return self.path / PARTIAL

    def write(self, path: Path, content: bytes) -> None:
        """Writes a file of the run into the folder."""
        with self.writing(path) as file:
            file.write(content)

    @contextmanager
    def writing(self, path: Path) -> Iterator["HashedFile"]:
        """A file of the run to write into the folder."""
        with whole_file(path) as file:
            hashed = HashedFile(file)
            yield hashed
            self._files[path.name] = hashed.hexdigest()
            self._write_claim()

    def keep(self, names: Sequence[str]) -> bool:
        """Makes files of the earlier run files of this one, as they are.

        False, and nothing, where one is missing or was changed since `require_free`.
        """
        paths = [self.path / name for name in names]
        if any(not path.is_file() or _hash(path.read_bytes()) != self._earlier.get(path.name) for path in paths):
            return False
        self._files |= {name: self._earlier[name] for name in names}
        self._write_claim()
        return True

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Removes files of the earlier run that this one does not have, and writes summary.json."""
        for name in [*self._earlier, *([PARTIAL] if self._partial else [])]:
            if name not in self._files:
                remove_file(self.path / name)
        self._write_summary({**_stamp(), **summary, "files": self._files})

    def _write_claim(self) -> None:
        lists = {"replaced": self._earlier, "files": self._files}
        rows = {"partial": PARTIAL} if self._partial else {}
        self._write_summary({**_stamp(), **self._head, "complete": False, "unfinished": True, **lists, **rows})

    def _write_summary(self, summary: Mapping[str, Any]) -> None:
        write_whole(self.path / SUMMARY, (json.dumps(summary, indent=2) + "\n").encode())

    def _read_summary(self) -> dict[str, Any]:
        path = self.path / SUMMARY
        try:
            summary = json.loads(path.read_bytes())
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, RecursionError):
            summary = None
        if not isinstance(summary, dict) or not _is_ours(summary):
            rule = "is in the way and not that of a run of this version; move it, or choose another folder with --out"
            raise InputError("", rule, source=str(path))
        return summary


def _stamp() -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, "flexbeams": installed_version("flexbeams")}


def _is_ours(summary: dict[str, Any]) -> bool:
    tables = (summary.get("files"), summary.get("replaced", {}), summary.get("drawings", {}))
    return "flexbeams" in summary and all(
        isinstance(table, dict) and all(isinstance(content_hash, str) for content_hash in table.values())
        for table in tables
    )


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
