"""Settings of a run from the keyword arguments that `run` and `simulation` share."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.fmus.units.kind import UnitKind
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
    """The settings; `fields` are those that have the same name and type there."""
    return Settings(
        overrides=dict(start or {}),
        structure=None if structure is None else str(structure),
        design=dict(design or {}),
        build_folder=cache_folder(build_folder),
        kinds=tuple(kinds),
        **fields,
    )
