"""Settings with which a run differs from its scenario, for its summary and the name of its folder."""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings

_MAX_LENGTH = 80  # characters of a folder's suffix
_DEFAULTS: dict[str, Any] = {
    "backend": "native",
    "compiler": "zig",
    "decimate": 1,
    **{name: {} for name in ("record_every", "design", "overrides")},
}
_NAMES = (
    "coupling",
    "basis",
    "structure",
    "stop_time",
    "step",
    "backend",
    "compiler",
    "decimate",
    "record_every",
    "real_time_factor",
    "design",
    "overrides",
)


def changed_settings(settings: Settings, scenario: Scenario | None = None) -> dict[str, Any]:
    """The options that change a run, by the name of the option; without those that repeat the scenario's own value."""
    own: dict[str, Any] = {"structure": scenario.structure, "basis": scenario.design.basis} if scenario else {}
    if scenario:
        own |= {"coupling": scenario.coupling, "stop_time": scenario.stop_time, "step": scenario.step}
    changed = {}
    for name in _NAMES:
        value = getattr(settings, name)
        if value not in (None, _DEFAULTS.get(name), own.get(name)):
            changed["set" if name == "overrides" else name] = dict(value) if isinstance(value, Mapping) else value
    return changed


def variant_suffix(changed: dict[str, Any]) -> str:
    """The end of the name of a folder of results that names these settings: "" or "-gauss-seidel-stop_time=2"."""
    parts = []
    for name, value in changed.items():
        if name in ("set", "design"):
            parts += [f"{key}={_text(v)}" for key, v in value.items()]
        elif name == "record_every":
            parts += [f"{key}-every-{v}" for key, v in value.items()]
        elif name == "structure":
            parts.append(Path(value).stem)
        elif isinstance(value, str):
            parts.append(value)
        else:
            parts.append(f"{name}={_text(value)}")
    suffix = "".join(f"-{part}" for part in parts)
    plain = re.sub(r"[^\w.,=+-]", "", suffix)
    if len(plain) <= _MAX_LENGTH:
        return plain
    return f"{plain[: _MAX_LENGTH - 9]}-{hashlib.sha256(suffix.encode('utf-8', 'replace')).hexdigest()[:8]}"


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ",".join(map(_text, value))
    if isinstance(value, str):
        return value
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"
