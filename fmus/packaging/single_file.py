"""All code of a unit as one C file: what a rig adds to its build, and what several units link by without a clash."""

import re
from collections.abc import Sequence
from pathlib import Path

from flexbeams.fmus.units.native_kernel import NATIVE

_FOLDERS = ("", "numerics", "units", "fmi")
_FMI = ("fmi2.c", "fmi2_values.c", "fmi2_derivatives.c", "fmi2_state.c", "fmi2_model_exchange.c")
_INCLUDE = re.compile(r'#include (["<])([\w.]+)[">]\n')
_GUARD = re.compile(r"#ifndef (\w+_H)\n#define \1\n\n?(.*)\n#endif\n", re.DOTALL)
_STANDARD = "fmi2Functions.h"  # comes with the tool that compiles
_HEAD = """/* {unit}: FMI 2.0 for co-simulation. All code of the unit, the same for every design; the design is in
   {unit}_tables.h.

   Compile this file alone, as C99, with the headers of FMI 2.0 on the include path, and link the C library's
   mathematics:

       cc -std=c99 -O2 -ffp-contract=off -I<headers of FMI 2.0> -c {unit}.c

   Its functions are called {unit}_fmi2Instantiate and so on, and nothing else is visible: several units link into one
   program. -DFMI2_OVERRIDE_FUNCTION_PREFIX gives the plain names of a shared library. */

#ifndef FMI2_FUNCTION_PREFIX
#define FMI2_FUNCTION_PREFIX {unit}_
#endif
#define SINGLE_FILE

{includes}
#include "fmi2Functions.h"
"""


def single_file(unit: str, kernels: Sequence[Path]) -> str:
    """The C file of a unit with these kernels; it includes <unit>_tables.h behind them."""
    joiner = _Joiner(kernels)
    mathematics = joiner.bodies(kernels)
    plumbing = joiner.bodies([NATIVE / "fmi" / name for name in _FMI])
    head = _HEAD.format(unit=unit, includes="\n".join(f"#include <{name}>" for name in sorted(joiner.system)))
    tables = f'\n#include "{unit}_tables.h"\n'
    return "".join(
        [
            *(head, *joiner.headers),
            *_unless("TABLES_ONLY", mathematics),
            *_unless("CODE_ONLY", [tables]),
            *_unless("TABLES_ONLY", plumbing),
        ]
    )


def _unless(macro: str, texts: Sequence[str]) -> list[str]:
    """The texts where a macro is not defined."""
    return [f"\n#ifndef {macro}\n", *texts, f"\n#endif /* {macro} */\n"]


class _Joiner:
    """Files in an order that a compiler can read, each once, without includes and guards."""

    def __init__(self, sources: Sequence[Path]) -> None:
        self._folders = [*(NATIVE / folder for folder in _FOLDERS), *dict.fromkeys(path.parent for path in sources)]
        self._added: set[Path] = set()
        self.headers: list[str] = []  # texts, each behind those that it includes
        self.system: set[str] = set()  # names of the C library's headers

    def bodies(self, sources: Sequence[Path]) -> list[str]:
        """Texts of C files that are not there yet, each behind those that belong to the headers which it includes."""
        texts = []
        for source in sources:
            if source in self._added:
                continue
            self._added.add(source)
            headers = self._headers(source)
            for header in headers:
                if header not in self._added:
                    self._added.add(header)
                    self.headers.append(_section(header))
            texts += self.bodies([body for header in headers if (body := header.with_suffix(".c")).is_file()])
            texts.append(_section(source))
        return texts

    def _headers(self, file: Path) -> list[Path]:
        """All headers of this project that a file needs, those first that others include."""
        needed: dict[Path, None] = {}
        for kind, name in _INCLUDE.findall(file.read_text(encoding="utf-8")):
            if kind == "<":
                self.system.add(name)
            elif name != _STANDARD:
                header = next(path for folder in self._folders if (path := folder / name).is_file())
                needed |= dict.fromkeys([*self._headers(header), header])
        return list(needed)


def _section(file: Path) -> str:
    text = _INCLUDE.sub("", file.read_text(encoding="utf-8"))
    text = _GUARD.sub(r"\2", text)
    text = re.sub(r"\n{3,}", "\n\n", text).strip("\n")
    return f"\n/* ---- {file.name} {'-' * (100 - len(file.name))} */\n\n{text}\n"
