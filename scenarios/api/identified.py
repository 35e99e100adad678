"""The structure `kiel_identified` and the measured statics of the scenarios `identified` and `identified_offset_free`.

`python -m flexbeams.scenarios.api.identified [FOLDER]` runs `identification_steps`, whose sensors measure an exact
plant, fits ten modes a beam to what they recorded, from a start that is 20 % off in all parameters but the weighed tip
mass of beam 1, measures the static gains, and writes both files: where they ship, or into FOLDER.
"""

import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tomlkit

from flexbeams.plant.identification.writing import identified_text
from flexbeams.plant.static_maps import write_static_maps
from flexbeams.plant.structure import STRUCTURES_FOLDER, find_structure, read_structure
from flexbeams.scenarios.api.identifications import identify, static_maps
from flexbeams.scenarios.api.runs import run
from flexbeams.scenarios.definition.scenario_file import LIBRARY
from flexbeams.scenarios.results.files import write_results

DATA = "identification_steps"  # the scenario that records the data
STRUCTURE, MAPS = "kiel_identified.toml", "kiel_statics.csv"
WEIGHED = "beam[1].tip_mass"
OFF, SEED = 0.2, 3  # of the start: share, and seed of the signs
HEADER = f"""Three beams whose parameters were identified: ten modes a beam, fitted to simulated measurements of an
exact plant (scenario {DATA}). They absorb what ten modes miss, and so differ from those of kiel.
Written by `python -m flexbeams.scenarios.api.identified`; a comment states the origin of each value."""


def distant_start(path: Path) -> str:
    """The text of a structure file with every parameter but WEIGHED larger or smaller by OFF, under HEADER."""
    text = path.read_text(encoding="utf-8")
    document = tomlkit.parse(text[text.index("[[beam]]") :])
    rng = np.random.default_rng(SEED)
    for name, value in read_structure(path).parameters().items():
        sign = rng.choice([-1, 1])
        part, number, key = re.split(r"\[|\]\.", name)
        table: Any = document[part][int(number) - 1]
        if name == WEIGHED:
            table[key].comment("known (weighed)")
        else:
            table[key] = float(f"{value * (1 + OFF * sign):.6g}")
    return "".join(f"# {line}\n" for line in HEADER.splitlines()) + "\n" + tomlkit.dumps(document)


def main(arguments: list[str]) -> int:
    """Measures, identifies and writes; stages of the fit go to stderr, the files' names to stdout."""
    folder = Path(arguments[0]) if arguments else None
    structure, maps = (folder or STRUCTURES_FOLDER) / STRUCTURE, (folder or LIBRARY) / MAPS
    kiel = find_structure("kiel")
    with TemporaryDirectory() as work:
        start, data = Path(work) / "start.toml", Path(work) / "data"
        start.write_text(distant_start(kiel), encoding="utf-8")
        measured = run(DATA)
        write_results(data, measured.recording, measured.summary)
        result = identify(
            data / "results.csv",
            structure=start,
            known={WEIGHED: read_structure(kiel).parameters()[WEIGHED]},
            notify=lambda text: print(f"fitting {text}", file=sys.stderr),
        )
        structure.write_text(identified_text(start.read_text(encoding="utf-8"), result), encoding="utf-8")
        comment = f"Measured static gains of {DATA}, with half widths of 95 % intervals"
        write_static_maps(static_maps(data / "results.csv", structure=kiel), maps, comment)
    print(structure, maps, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
