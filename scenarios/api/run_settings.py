"""Settings of a run from the keyword arguments that `run` and `simulation` share."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.scenarios.definition.arguments import require_choices, require_integer, require_number, require_table
from flexbeams.scenarios.definition.choices import BACKENDS, BASES, COUPLINGS
from flexbeams.scenarios.definition.schema import Value
from flexbeams.scenarios.definition.settings import Settings


def run_settings(
    *,
    start: Mapping[str, Value] | None,
    structure: str | Path | None,
    design: Mapping[str, Any] | None,
    build_folder: str | Path | None,
    kinds: Sequence[UnitKind],
    **fields: Any,
) -> Settings:
    """The settings; `fields` are those that have the same name and type there. InputError for what they cannot be."""
    choices = {"coupling": COUPLINGS, "basis": BASES, "backend": BACKENDS}
    require_choices(**{name: (fields.get(name), valid) for name, valid in choices.items()})
    for name in ("stop_time", "step"):
        require_number(name, fields.get(name))
    require_integer("decimate", fields.get("decimate"), 1)
    require_table("start", start)
    require_table("design", design)
    return Settings(
        overrides=dict(start or {}),
        structure=None if structure is None else str(structure),
        design=dict(design or {}),
        build_folder=cache_folder(build_folder),
        kinds=tuple(kinds),
        **fields,
    )
