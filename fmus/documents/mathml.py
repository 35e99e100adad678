"""Formulas in a line of text as MathML."""

import re
from html import escape

_TOKEN = re.compile(
    r"\s+|(?P<number>\d+(\.\d+)?)|(?P<name>[^\W\d_]+)|(?P<script>[_^])|(?P<brace>[{}])"
    r"|(?P<operator>\S)"
)
_DOTS = {"dot": "&#x02D9;", "ddot": "&#x00A8;"}


def formula(text: str) -> str:
    """A formula on a line of its own.

    Names, numbers and operators are written as they are; _ and ^ precede a subscript and a superscript; braces form a
    group; dot and ddot precede a name; ; separates two formulas: dot x_k = A^{-1} x_k ; y = C x.
    """
    return f'<math display="block">{_row(_tokens(text))}</math>'


def _tokens(text: str) -> list[tuple[str, str]]:
    return [(match.lastgroup, match.group()) for match in _TOKEN.finditer(text) if match.lastgroup]


def _row(tokens: list[tuple[str, str]]) -> str:
    """The tokens up to the closing brace of the row; removes them from the list."""
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
        if text in _DOTS:
            return f'<mover accent="false">{_item(tokens)}<mo>{_DOTS[text]}</mo></mover>'
        return "<mo>&#x2211;</mo>" if text == "sum" else f"<mi>{escape(text)}</mi>"
    if text == ";":
        return '<mspace width="2em"/>'
    return f"<mo>{escape(text)}</mo>"
