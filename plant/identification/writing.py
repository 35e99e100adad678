"""The identified structure as a file: the start's text with new values, each with the mark of where it comes from."""

import re
from pathlib import Path

import tomlkit

from flexbeams.plant.archive import write_whole
from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.method import Identification, Parameter

_MARK = re.compile(r"^(paper|datasheet|assumed|fitted|known)\b(\s*\([^)]*\))?[;,]?")
ASSUMED = "assumed (undetermined by data)"


def mark_of(parameter: Parameter) -> str:
    """The comment behind a value: fitted with its 95 % half width, assumed, or known."""
    if parameter.status == "assumed":
        return ASSUMED
    if parameter.status == "known":
        return "known"
    return f"fitted (+-{196 * parameter.deviation:.2g} %)"


def identified_text(start: str, result: Identification) -> str:
    """The TOML text `start` with the identified values; comments and layout stay, marks of changed values do not.

    Values that the identification was not free to change keep their own mark.
    """
    document = tomlkit.parse(start)
    free = set(result.joint.names)
    for parameter in result.parameters:
        place, name = parameter.name.split("].")
        part, number = place.split("[")
        table = document[part][int(number) - 1]
        if parameter.name not in free and parameter.value == float(table[name]):
            continue
        entry = tomlkit.item(float(f"{parameter.value:.9g}") if parameter.status == "fitted" else parameter.value)
        remark = _remark(table[name].trivia.comment)
        table[name] = entry
        table[name].comment(mark_of(parameter) + (f"; {remark}" if remark else ""))
    return tomlkit.dumps(document)


def _remark(comment: str) -> str:
    """What a comment behind a value says beside the mark of its origin."""
    return _MARK.sub("", comment.lstrip("# "), count=1).strip()


def write_identified(start: Path, result: Identification, path: Path) -> None:
    """Writes the identified structure; InputError where the start cannot be read."""
    try:
        text = start.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=str(start)) from None
    write_whole(path, identified_text(text, result).encode())
