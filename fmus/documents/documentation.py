"""documentation/index.html of a unit: equations, signals, timing, picture; one file that refers to no other."""

import base64
from collections.abc import Iterable, Sequence
from html import escape

from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.documents.description import LOG_CATEGORIES
from flexbeams.fmus.documents.mathml import formula
from flexbeams.fmus.interface.variables import Interface, Variable

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
h1, h2 { color: #1f3a5f; line-height: 1.2 } h2 { margin-top: 2.2rem }
figure { margin: 1rem 0 } code { font-size: 0.9em }
table { border-collapse: collapse; font-size: 0.9rem; width: 100% } math { margin: 0.8rem 0; font-size: 1.15em }
th, td { border-bottom: 1px solid #d5dbe3; padding: 0.25rem 0.6rem; text-align: left; vertical-align: top }
th { background: #eaf1f8 } img { max-width: 100%; height: auto } summary { cursor: pointer; color: #1f3a5f }
body > div { overflow-x: auto; overflow-y: hidden }
td { overflow-wrap: anywhere } td:last-child { min-width: 14rem } img { background: #fff }
@media (max-width: 560px) { table { display: block; overflow-x: auto } td { min-width: 4rem } }
@media (prefers-color-scheme: dark) {
  body { color: #e8eaed; background: #14171b } h1, h2, summary { color: #9dc1f0 } a { color: #7fb0ff }
  th { background: #232a33 } th, td { border-color: #38404a }
}
"""


def documentation_page(interface: Interface, picture: bytes, chapter: Chapter) -> str:
    """The page in UTF-8 text; `picture` is model.png."""
    image = base64.b64encode(picture).decode()
    design = next((v.start for v in interface if v.name == "design_id"), "")
    arrays = [[interface.variables[k] for k in span] for span in interface.arrays.values()]
    title = escape(interface.unit_name)
    parts = [
        f"<h1>{title}</h1>",
        f"<p>{escape(interface.description)}.</p>",
        f'<figure><img src="data:image/png;base64,{image}" alt="{title} with its signals"></figure>',
        chapter.wiring,
        "<h2>Equations</h2>",
        *_paragraphs(chapter.equations),
        chapter.figure(interface) if chapter.figure else "",
        "<h2>Signals</h2>",
        table(("signal", "type", "causality", "unit", "start", "meaning"), map(_array_row, arrays)),
        f"<details><summary>All {len(interface.variables)} variables</summary>",
        table(
            ("reference", "variable", "variability", "minimum", "maximum", "nominal", "meaning"),
            (_variable_row(k, v) for k, v in enumerate(interface)),
        ),
        "</details>",
        "<h2>Timing</h2>",
        *_paragraphs(chapter.timing),
        f"<p>{chapter.clock.format(interface.step_size)} Outputs change in fmi2DoStep only.</p>",
        "<h2>Errors and log</h2>",
        "<p>A refused call returns fmi2Error and writes one line that names function, variable and value. Getters and "
        "setters that are refused change nothing; after any other refused call neither ends the initialisation nor "
        "is a step done until fmi2Reset or fmi2SetFMUstate. Categories of the log:</p>",
        table(("category", "lines"), LOG_CATEGORIES.items()),
        "<h2>Contents</h2>",
        "<p>The unit needs nothing but itself. <code>sources</code> holds all of it in strict C99: "
        f"<code>{title}.c</code>, the same for every design, and <code>{title}_tables.h</code>, the numbers of this "
        "one. Compile the first with <code>-std=c99 -O2 -ffp-contract=off</code> for the results of the binaries, with "
        "the headers of FMI 2.0, which come with the standard or the importing tool. Its functions are called "
        f"<code>{title}_fmi2Instantiate</code> and so on; <code>-DFMI2_OVERRIDE_FUNCTION_PREFIX</code> gives the plain "
        "names of a shared library. <code>CMakeLists.txt</code> builds either.</p>",
        *(
            [f"<p>Design <code>{escape(str(design))}</code>: units of different designs do not fit together.</p>"]
            if design
            else []
        ),
        f"<p>{escape(chapter.literature)} Licence: <code>documentation/licenses/LICENSE</code>.</p>",
    ]
    return html_page(title, parts)


def html_page(title: str, parts: Iterable[str]) -> str:
    """A page in the style of the units from pieces of HTML; empty pieces are left out."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta name="color-scheme" content="light dark"><title>{title}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(filter(None, parts)) + "\n</body>\n</html>\n"
    )


def _paragraphs(text: str) -> list[str]:
    parts: list[str] = []
    for line in text.strip().splitlines():
        if line.startswith("= "):
            parts.append(f"<div>{formula(line[2:])}</div>")
        elif line.startswith("# "):
            parts.append(f"<h3>{escape(line[2:])}</h3>")
        elif parts and parts[-1].startswith("<p>"):
            parts[-1] = parts[-1].replace("</p>", f" {escape(line)}</p>")
        else:
            parts.append(f"<p>{escape(line)}</p>")
    return parts


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table with a line of heads."""
    lines = ["<table>", "<tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td>{escape(_cell_text(cell))}</td>" for cell in row) + "</tr>" for row in rows]
    return "\n".join([*lines, "</table>"])


def _array_row(variables: Sequence[Variable]) -> list[object]:
    first, last = variables[0], variables[-1]
    name = first.name if first is last else f"{first.name} … {last.name}"
    starts = list(dict.fromkeys(_cell_text(v.start) for v in variables))
    causality = "tunable parameter" if first.variability == "tunable" else first.causality
    meaning = first.description if first is last else f"{first.description} …"
    return [name, first.type, causality, first.unit, ", ".join(starts), meaning]


def _variable_row(reference: int, variable: Variable) -> list[object]:
    return [
        reference,
        variable.name,
        variable.variability,
        variable.minimum,
        variable.maximum,
        variable.nominal,
        variable.description,
    ]


def _cell_text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)
