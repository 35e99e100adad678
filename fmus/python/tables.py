"""The data file of a unit, which all its instances share, with the variables by value reference."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Tables:
    """Contents of `data.npz`: `data` (read-only arrays), `meta`, and the interface's variables.

    `values` (n,) and `texts` are the start values, `spans` the indices of each array variable.
    """

    def __init__(self, path: Path) -> None:
        self.digest = hashlib.sha256(path.read_bytes()).digest()
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        interface = json.loads(arrays.pop("interface").tobytes())
        self.meta: dict[str, Any] = json.loads(arrays.pop("meta").tobytes())
        for array in arrays.values():
            array.setflags(write=False)
        self.data: Mapping[str, NDArray[Any]] = MappingProxyType(arrays)
        self.unit_name: str = interface["unit_name"]
        self.step_size: float = interface["step_size"]  # s, the declared communication step
        self.variables: list[dict[str, Any]] = interface["variables"]
        self.values = np.zeros(len(self.variables))
        self.texts: dict[int, str] = {}
        self.spans: dict[str, slice] = {}
        for reference, variable in enumerate(self.variables):
            if variable["type"] == "String":
                self.texts[reference] = variable.get("start", "")
            else:
                self.values[reference] = variable.get("start", 0.0)
            name = re.sub(r"\[[\d,]*\]", "[]", variable["name"]).removesuffix("[]")
            first = self.spans[name].start if name in self.spans else reference
            self.spans[name] = slice(first, reference + 1)


@lru_cache(maxsize=8)
def read_tables(path: Path) -> Tables:
    """The tables of a data file, read once: fmi2Reset must not fail where the files are gone by then."""
    return Tables(path)


def selector_of(references: tuple[int, ...]) -> slice | NDArray[np.intp]:
    """Index of these positions; a slice, which numpy reads much faster, where they are contiguous."""
    first = references[0] if references else 0
    if references == tuple(range(first, first + len(references))):
        return slice(first, first + len(references))
    return np.array(references, dtype=np.intp)
