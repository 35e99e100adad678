"""Text from files and names: made fit to be displayed, and whether it is a number."""

import re
import unicodedata

MAX_QUOTED = 80  # characters of a file's content in a message

# Control characters, formatting ones (text direction, zero width), lone surrogates, line and paragraph separators
_HIDDEN = ("Cc", "Cf", "Cs", "Zl", "Zp")

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)


def is_decimal(text: str) -> bool:
    """Whether a text is a decimal number; 1_000 and digits of other scripts, which float() takes, are none."""
    return _NUMBER.fullmatch(text) is not None


def printable(text: str, keep: str = "") -> str:
    """The text with escapes, such as \\x1b, in place of characters that control the display; those of `keep` stay."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        character if character in keep or unicodedata.category(character) not in _HIDDEN else _escaped(character)
        for character in text
    )


def quoted(value: object) -> str:
    """The value as Python writes it, cut to MAX_QUOTED characters."""
    return shortened(printable(repr(value)))


def shortened(text: str) -> str:
    """The text cut to MAX_QUOTED characters in its middle: the end of a path is its file."""
    half = MAX_QUOTED // 2
    return text if len(text) <= MAX_QUOTED else f"{text[: half - 2]} ... {text[3 - half :]}"


def _escaped(character: str) -> str:
    return character.encode("unicode_escape", "surrogatepass").decode()
