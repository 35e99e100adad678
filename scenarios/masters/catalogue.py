"""The masters by name, and whether they are installed."""

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.masters import container, ecos, fmpy_ssp, libcosim, pathsim_, runner, sofirpy_
from flexbeams.scenarios.masters.trace import Master

RUNNER = runner.MASTER
MASTERS = {
    m.name: m
    for m in (fmpy_ssp.MASTER, libcosim.MASTER, ecos.MASTER, container.MASTER, pathsim_.MASTER, sofirpy_.MASTER)
}


def find_master(name: str) -> Master:
    """A master or the runner by name; InputError for an unknown name."""
    known = {**MASTERS, RUNNER.name: RUNNER}
    if name not in known:
        raise InputError("master", f"must be a known one{suggestion(name, known)}", name)
    return known[name]


def installed_version(master: Master) -> str | None:
    """The installed version; None where it is not installed."""
    try:
        return version(master.distribution) if find_spec(master.module) is not None else None
    except (PackageNotFoundError, ModuleNotFoundError):
        return None
