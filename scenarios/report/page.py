"""Self-contained HTML pages: templates and scripts of the folder assets/, data embedded as compact text."""

import base64
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from flexbeams.plant.basis import Array

ASSETS = Path(__file__).parent / "assets"


def render(template: str, **context: Any) -> str:
    """The page of a template in assets/; values are escaped, except by `embedded` and `asset`."""
    return _environment().get_template(template).render(**context)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(ASSETS),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["asset"] = lambda name: Markup((ASSETS / name).read_text(encoding="utf-8"))
    environment.filters["embedded"] = embedded
    return environment


def embedded(data: Any) -> Markup:
    """JSON that cannot end the script element around it."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)


def float32(values: Array) -> str:
    """An array in single precision, little-endian, base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()


def int16(values: Array) -> dict[str, Any]:
    """An array as scaled integers, base64; the resolution is 1/32767 of its largest magnitude."""
    largest = float(np.max(np.abs(values), initial=0.0))
    scale = largest / 32767 if np.isfinite(largest) and largest > 0 else 1.0
    levels = np.clip(np.rint(np.nan_to_num(values) / scale), -32767, 32767)
    return {"scale": scale, "levels": base64.b64encode(levels.astype("<i2").tobytes()).decode()}
