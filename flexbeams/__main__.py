"""`python -m flexbeams`: the command `flexbeams`."""

import sys

from flexbeams.scenarios.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
