"""Versions of installed packages, read once: each reading parses a description of hundreds of lines."""

from functools import cache


@cache
def installed_version(package: str) -> str:
    """The version of an installed package; PackageNotFoundError where it is not installed."""
    from importlib.metadata import version  # which takes longer to load than to ask

    return version(package)
