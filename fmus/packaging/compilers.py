"""C compilers: the ziglang wheel, which builds for every platform, or the system's, which builds for this machine."""

import atexit
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from flexbeams.fmus.errors import BuildError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.plant.versions import installed_version

FLAGS = ("-std=c99", "-O2", "-g0", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion")

# Without it compilers make two instructions of a vector of 512 bits
PROCESSOR_FLAGS = {"x86-64-v4": ("-mprefer-vector-width=512",)}


@dataclass(frozen=True, kw_only=True)
class Platform:
    """One kind of machine that a unit can carry a binary for."""

    name: str  # CPU and system, as FMI 3.0 names its folder: x86_64-linux
    target: str  # zig's, with the oldest system that the binary runs on
    suffix: str  # of a shared library
    fmi2_folder: str  # FMI 2.0's folder, which names no CPU
    flags: tuple[str, ...]


_ELF = ("-fPIC", "-fvisibility=hidden", "-Wl,--build-id=none", "-Wl,-z,relro,-z,now")
_MACH = ("-fPIC", "-fvisibility=hidden")
PLATFORMS = {
    p.name: p
    for p in (
        Platform(name="x86_64-linux", target="x86_64-linux-gnu.2.17", suffix=".so", fmi2_folder="linux64", flags=_ELF),
        Platform(
            name="aarch64-linux", target="aarch64-linux-gnu.2.17", suffix=".so", fmi2_folder="linux64", flags=_ELF
        ),
        Platform(name="x86_64-windows", target="x86_64-windows-gnu", suffix=".dll", fmi2_folder="win64", flags=()),
        Platform(
            name="x86_64-darwin", target="x86_64-macos.11.0", suffix=".dylib", fmi2_folder="darwin64", flags=_MACH
        ),
        Platform(
            name="aarch64-darwin", target="aarch64-macos.11.0", suffix=".dylib", fmi2_folder="darwin64", flags=_MACH
        ),
    )
}


def chosen_platforms(names: Sequence[str]) -> list[Platform]:
    """The platforms of these names; `host` is this machine's and `all` stands for all. BuildError for another name."""
    chosen: dict[str, Platform] = {}
    for name in names:
        if name == "all":
            chosen |= PLATFORMS
        elif name == "host":
            chosen[host_platform().name] = host_platform()
        elif name in PLATFORMS:
            chosen[name] = PLATFORMS[name]
        else:
            raise BuildError(f"platform must be host, all or one of {', '.join(PLATFORMS)}, got {name!r}")
    if not chosen:
        raise BuildError("platform must be given at least once")
    return [PLATFORMS[name] for name in sorted(chosen)]


def host_name() -> str:
    """Name of this machine's platform, in the form of PLATFORMS."""
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    return f"{machine}-{system}"


def host_platform() -> Platform:
    """The platform of this machine; BuildError where units are not built for it."""
    if (name := host_name()) not in PLATFORMS:
        raise BuildError(f"native units are not built for {name}; choose among {', '.join(PLATFORMS)}")
    return PLATFORMS[name]


@dataclass(frozen=True, kw_only=True)
class Compiler:
    """A command that compiles and links C."""

    name: str  # zig, or the command or path that was asked for
    command: tuple[str, ...]

    @property
    def is_zig(self) -> bool:
        """Whether it builds for every platform."""
        return self.name == "zig"

    def build(
        self,
        library: Path,
        sources: Sequence[Path],
        includes: Sequence[Path],
        platform: Platform,
        definitions: Sequence[str] = (),
        processor: str = "",
    ) -> None:
        """Compile sources, or objects, to a shared library; BuildError with the compiler's first line where it fails.

        It runs on any processor of the platform, or on those like `processor` only, such as x86-64-v3.
        The library's bytes depend on its file name, the compiler and the contents of the sources, not on folders.
        """
        self.make(library, ["-shared", "-s"], definitions, includes, [*sources, "-lm"], platform, processor)

    def compile(
        self, out: Path, source: Path, includes: Sequence[Path], platform: Platform, definitions: Sequence[str]
    ) -> None:
        """Compile a source to an object file for `build`; BuildError as there."""
        self.make(out, ["-c"], definitions, includes, [source], platform)

    def make(
        self,
        out: Path,
        options: Sequence[str],
        definitions: Sequence[str],
        includes: Sequence[Path],
        inputs: Sequence[Path | str],
        platform: Platform,
        processor: str = "",
    ) -> None:
        """One call of the command, which makes the file `out`."""
        if not self.is_zig and platform != host_platform():
            raise BuildError(
                f"{self.command[0]} builds for {host_platform().name} only, {platform.name} takes the compiler zig"
            )
        model = processor.replace("-", "_") if self.is_zig else processor
        target: tuple[str, ...] = (f"-march={model}",) if model else ()
        if self.is_zig:
            target = ("-target", platform.target, f"-mcpu={model or 'baseline'}")
        target += PROCESSOR_FLAGS.get(processor, ())
        command = [
            *self.command,
            *target,
            *FLAGS,
            *platform.flags,
            *options,
            *(f"-D{name}" for name in definitions),
            *(f"-I{folder}" for folder in includes),
            "-o",
            out.name,
            *map(str, inputs),
        ]
        try:
            done = subprocess.run(
                command,
                cwd=out.parent,
                env=os.environ | (zig_environment() if self.is_zig else {}),
                capture_output=True,
                text=True,
                errors="replace",
            )
        except OSError as error:
            raise BuildError(f"{self.command[0]} cannot be run: {error.strerror}") from None
        if done.returncode != 0 or not out.is_file():
            lines = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines()
            reason = lines[0].strip() if lines else f"exit status {done.returncode}"
            raise BuildError(f"{out.name} for {platform.name} cannot be compiled: {reason}")


def find_compiler(name: str = "zig") -> Compiler:
    """The ziglang wheel's compiler for `zig`, else the command or path `name` that works like gcc or clang.

    BuildError that says what to install where there is none.
    """
    if name == "zig":
        if importlib.util.find_spec("ziglang") is None:
            raise BuildError(
                "the compiler zig is missing: pip install ziglang, or choose a system's compiler such as "
                "gcc (Debian: apt install gcc)"
            )
        return Compiler(name=name, command=(sys.executable, "-m", "ziglang", "cc"))
    if (path := shutil.which(name)) is None:
        raise BuildError(
            f"the compiler {name} is missing: install it (Debian: apt install {Path(name).name}), or "
            "pip install ziglang and choose zig"
        )
    return Compiler(name=name, command=(path,))


@cache
def zig_environment() -> dict[str, str]:
    """Environment variables that zig needs here.

    It keeps the C library that it compiles in the user's cache. Where that cannot be written, as in containers without
    a home, this process has a folder of its own for it.
    """
    if os.name != "posix" or os.environ.get("ZIG_GLOBAL_CACHE_DIR"):
        return {}
    home = os.environ.get("HOME")
    caches = os.environ.get("XDG_CACHE_HOME") or (home and f"{home}/.cache")
    with suppress(OSError):
        if caches:
            folder = Path(caches, "zig")
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return {}
    stack = ExitStack()
    atexit.register(stack.close)
    return {"ZIG_GLOBAL_CACHE_DIR": str(stack.enter_context(temporary_folder()))}


def compiler_version(name: str) -> str:
    """The version of a compiler; empty where it is missing."""
    try:
        if name == "zig":
            return installed_version("ziglang")
        done = subprocess.run(
            [shutil.which(name) or name, "--version"], capture_output=True, text=True, errors="replace"
        )
        return done.stdout.partition("\n")[0].strip()
    except (OSError, ModuleNotFoundError):
        return ""
