"""documentation/index.html of a unit: equations, signals, timing, picture; one file that refers to no other."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

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
"""


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """What a unit computes: paragraphs, formulas where a line starts with =, headings where it starts with #."""

    equations: str
    timing: str
    wiring: str = ""  # HTML, of a unit with parts
    clock: str = "The design's sample time is {:g} s."
    generated: str = "<code>tables.c</code> is what the design wrote"


_CHAPTERS = {
    "BeamPlant": Chapter(
        equations="""
Euler-Bernoulli beams, clamped at one end, with tip masses, springs between adjacent tips and pairs of piezoelectric
patches; a Galerkin approximation of their weak form, equations (13) to (15) of the paper:
= M ddot q + D dot q + K q = L u + F f
q are the generalised coordinates, u the voltages of the patch pairs and f the forces on the tips. Each matrix is a sum
of physical parameters times constant matrices of the geometry, so every parameter can be set before the
initialisation ends. With the factors of K and M the state's norm is the mechanical energy E:
= K = R_K R_K^T ; M = R_M R_M^T ; x = (R_K^T q , R_M^T dot q) ; E = x^T x / 2
= dot x = A x + B v ; v = (u , f)
A step of any length h is exact, for inputs that are held and for inputs with a constant derivative:
= x(t+h) = e^{A h} x(t) + (∫_0^h e^{A s} d s) B v(t) + (∫_0^h (h−s) e^{A s} d s) B dot v(t)
Outputs are the deflections y_pi at the points of interest, and the strains y_pm at the gauges: half the thickness
times the curvature, averaged over the gauge:
= y_pi = C_pi q ; y_pm = C_pm q + σ n_k
nₖ is white noise of variance 1, new at each sample time, a function of seed, sample and gauge only; σ is
strain_noise_std.
""",
        timing="""
The step size is free and does not change the result: each new one costs a matrix exponential, the last four are kept.
Outputs after a step are those at its end. Derivatives set with fmi2SetRealInputDerivatives (order 1) hold for the next
step.
""",
    ),
    "FlatnessFeedforward": Chapter(
        equations="""
The reduced model is flat, equations (31) to (38) of the paper: voltages and states follow from derivatives of the flat
output ξ.
= u_ff = sum_i c_i ξ^{(i)} ; x_ref = sum_i X_i ξ^{(i)} ; y_ref = H_pi x_ref + D_pi u_ff
A changed target starts a transition; transitions add, so that a new one may start while others are under way:
= ξ(t) = ξ_0 + sum_k Δξ_k Θ((t−t_k) / T_k)
= Θ(τ) = ∫_0^τ θ(s) d s / ∫_0^1 θ(s) d s ; θ(s) = exp(−(s (1−s))^{−g})
Derivatives of Θ are exact: they come from power series. A transition takes transition_time, or as much longer as it
takes to keep the whole motion within voltage_limit. A target that needs more than that at rest is refused: one line in
the log, target_refused is true, the target before is held.
""",
        timing="""
A target set before a step starts its transition at the beginning of that step. Outputs after a step are those at its
end plus preview, which undoes the delay between this unit and the plant. At most eight transitions are under way at
once; a further one starts when one has ended.
""",
    ),
    "TrackingController": Chapter(
        equations="""
A steady-state Kalman filter, equation (42) of the paper, a linear-quadratic regulator (44) and integral action (45):
= x_est(k+1) = A_d x_est(k) + B_d u(k) + L (y_pm(k) − H_pm x_est(k) − D_pm u(k))
= w(k) = u_ff(k) + K (x_ref(k) − x_est(k)) + z(k) ; u(k) = min(max(w(k) , −u_max) , u_max)
= z(k+1) = z(k) + k_I G_0^+ (H_pi (x_ref − x_est) + D_pi (u_ff − u))
G₀⁺ is the pseudo-inverse of the static gain from voltages to deflections: that gain is negative, a positive
factor alone would destabilise. A voltage at its limit u_max = voltage_limit does not integrate further out. With
feedback off, the feedforward's voltages pass through.
""",
        timing="""
The unit runs on its own clock, whose period is the sample time of the design. The voltages after a step
are for the time at its end, computed from the measurement at its start: one sample of delay is part of the
design. Ticks inside a longer step see the inputs held; a step shorter than the period holds some ticks or none.
""",
    ),
    "SignalSource": Chapter(
        equations="""
Outputs are functions of time, set by the parameters. A pulse is half a sine with the integral I over the duration T; a
chirp has amplitude a and a frequency that runs from f_0 to f_1, linearly or as a power of time:
= p(t) = (π I / (2 T)) sin(π (t−t_0) / T)
= c(t) = a sin(2 π ∫_{t_0}^t f(s) d s) ; f(s) = f_0 + (f_1 − f_0) (s−t_0) / T ; f(s) = f_0 (f_1 / f_0)^{(s−t_0) / T}
Targets hold from their times on. Pseudo-random levels hold for a while each: +a and −a by a maximum-length sequence, or
evenly distributed by the counter-based generator Philox 4x64. The rows of a table are held or joined by lines. A time
counts as reached from 1 ns before on.
""",
        timing="""
Outputs after a step, and after the initialisation, are those of its end: a master that exchanges values before each
step gives the other units the signals of the step's start. A master that passes on new values within a step
(Gauss-Seidel) must step this unit last; stepped first, every signal comes one step early. A time
that is a multiple of the step size up to the rounding of the host's clock is taken as that multiple.
""",
    ),
}


def chapter_of(unit: str) -> Chapter:
    """The chapter of a unit with mathematics of its own."""
    return _CHAPTERS[unit]


def documentation_page(interface: Interface, picture: bytes, chapter: Chapter | None = None) -> str:
    """The page in UTF-8 text; `picture` is model.png. The chapter is that of the interface's unit."""
    chapter = chapter or chapter_of(interface.unit_name)
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
        "<p>A refused call returns fmi2Error and writes one line that names function, variable and value; no step is "
        "done until fmi2Reset or fmi2SetFMUstate. Categories of the log:</p>",
        table(("category", "lines"), LOG_CATEGORIES.items()),
        "<h2>Contents</h2>",
        "<p>The unit needs nothing but itself. <code>sources</code> holds all of it in strict C99; "
        f"{chapter.generated}, the other files are the same for every design. Compile with "
        "<code>-std=c99 -O2 -ffp-contract=off</code> to get the results of the binaries.</p>",
        *(
            [f"<p>Design <code>{escape(str(design))}</code>: units of different designs do not fit together.</p>"]
            if design
            else []
        ),
        "<p>Paper: A. Kater, T. Meurer, Motion planning and tracking control for coupled flexible beam structures, "
        "Control Engineering Practice 84 (2019). Licence: <code>documentation/licenses/LICENSE</code>.</p>",
    ]
    return html_page(title, parts)


def html_page(title: str, parts: Iterable[str]) -> str:
    """A page of the units' style from pieces of HTML, of which empty ones are left out."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(filter(None, parts)) + "\n</body>\n</html>\n"
    )


def _paragraphs(text: str) -> list[str]:
    parts: list[str] = []
    for line in text.strip().splitlines():
        if line.startswith("= "):
            parts.append(formula(line[2:]))
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
    lines += ["<tr>" + "".join(f"<td>{escape(_shown(cell))}</td>" for cell in row) + "</tr>" for row in rows]
    return "\n".join([*lines, "</table>"])


def _array_row(variables: Sequence[Variable]) -> list[object]:
    first, last = variables[0], variables[-1]
    name = first.name if first is last else f"{first.name} … {last.name}"
    starts = list(dict.fromkeys(_shown(v.start) for v in variables))
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


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)
