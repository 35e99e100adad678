"""How does an experiment run? Scenario files, co-simulation of the units, results, exports, the command line."""

import sys
from platform import machine
from types import ModuleType

if sys.platform == "linux" and machine() == "aarch64" and "fmpy" not in sys.modules:
    # FMPy prints two lines where it cannot load the library of its logger, which exists for x86_64 only. Units log
    # without it.
    _logging = ModuleType("fmpy.logging")
    _logging.addLoggerProxy = lambda callbacks: None  # type: ignore[attr-defined]
    sys.modules["fmpy.logging"] = _logging
