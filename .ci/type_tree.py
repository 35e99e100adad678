"""Makes build/types, a tree of links in which a type checker finds the package as Python does.

The import package `flexbeams` maps to folders that stand side by side, which a type checker cannot know; mypy's
settings point at this tree. Run again where a folder is new; it may be run from anywhere.
"""

import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TREE = ROOT / "build/types/flexbeams"


def main() -> None:
    shutil.rmtree(TREE, ignore_errors=True)
    TREE.mkdir(parents=True)
    for path in (ROOT / "flexbeams").iterdir():
        if path.name != "__pycache__":
            (TREE / path.name).symlink_to(path)
    for name in ("plant", "controller", "fmus", "scenarios"):
        (TREE / name).symlink_to(ROOT / name, target_is_directory=True)


if __name__ == "__main__":
    main()
