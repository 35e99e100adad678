"""Complains of text files with stray white space, CR LF, conflict markers or no line end, and of large files."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

LARGEST = 1_000_000  # bytes
THIRD_PARTY = re.compile(r"\.min\.(js|css)$|LICENSE$|native/headers/")  # as their authors wrote them


def faults(path: Path) -> Iterator[str]:
    content = path.read_bytes()
    if len(content) > LARGEST:
        yield f"{path}: {len(content)} bytes, more than {LARGEST}"
    if b"\0" in content or THIRD_PARTY.search(path.as_posix()):
        return
    if content and (not content.endswith(b"\n") or content.endswith(b"\n\n")):
        yield f"{path}: must end with one line end"
    for number, line in enumerate(content.split(b"\n"), 1):
        if line != line.rstrip():
            yield f"{path}:{number}: white space at the end of the line"
        if re.match(rb"(<{7}|>{7}) ", line):
            yield f"{path}:{number}: a conflict marker"


def main() -> int:
    found = [fault for name in sys.argv[1:] if Path(name).is_file() for fault in faults(Path(name))]
    print(*found, sep="\n", end="\n" if found else "")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
