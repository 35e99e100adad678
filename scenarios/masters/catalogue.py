"""The masters by name, and whether they are here."""

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
    """A master by name, the runner among them; InputError for an unknown one."""
    known = {**MASTERS, RUNNER.name: RUNNER}
    if name not in known:
        raise InputError("master", f"must be a known one{suggestion(name, known)}", name)
    return known[name]


def installed_version(master: Master) -> str | None:
    """The version that is installed; None where it is not."""
    try:
        return version(master.distribution) if find_spec(master.module) is not None else None
    except (PackageNotFoundError, ModuleNotFoundError):
        return None
