"""Formulas written in a line of text, as MathML."""

import re
from html import escape

_TOKEN = re.compile(r"\s+|(?P<number>\d+(\.\d+)?)|(?P<name>[^\W\d_]+)|(?P<script>[_^])|(?P<brace>[{}])|(?P<operator>\S)")


def formula(text: str) -> str:
    """A formula on a line of its own.

    Names, numbers and operators as they stand, _ and ^ for what is below and above the name before, braces around
    what belongs together: x_{k+1} = A_d x_k + B_d u_k.
    """
    return f'<math display="block">{_row(_tokens(text))}</math>'


def _tokens(text: str) -> list[tuple[str, str]]:
    tokens = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise ValueError(f"formula {text!r} must be made of names, numbers and operators, got {text[position]!r}")
        if match.lastgroup:
            tokens.append((match.lastgroup, match.group()))
        position = match.end()
    return tokens


def _row(tokens: list[tuple[str, str]]) -> str:
    """All tokens up to the brace that closes the row, which are taken off the list."""
    items = []
    while tokens and tokens[0] != ("brace", "}"):
        item = _item(tokens)
        below = above = ""
        while tokens and tokens[0][0] == "script":
            script = tokens.pop(0)[1]
            below, above = (_item(tokens), above) if script == "_" else (below, _item(tokens))
        if below and above:
            item = f"<msubsup>{item}{below}{above}</msubsup>"
        elif below:
            item = f"<msub>{item}{below}</msub>"
        elif above:
            item = f"<msup>{item}{above}</msup>"
        items.append(item)
    return f"<mrow>{''.join(items)}</mrow>"


def _item(tokens: list[tuple[str, str]]) -> str:
    kind, text = tokens.pop(0)
    if kind == "brace":
        row = _row(tokens)
        tokens.pop(0)
        return row
    if kind == "number":
        return f"<mn>{text}</mn>"
    if kind == "name":
        return "<mo>&#x2211;</mo>" if text == "sum" else f"<mi>{escape(text)}</mi>"
    return f"<mo>{escape(text)}</mo>"
