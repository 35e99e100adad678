"""Programs for other processors: built by zig, run by qemu with the C library of a Debian package."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.native.workshop import ZIG


@dataclass(frozen=True, kw_only=True)
class Processor:
    """A processor that programs for Linux are built for and run on."""

    target: str  # zig's; a C library that the system has, since zig takes a minute to compile one of its own
    emulator: str = ""  # empty for this machine
    libraries: Path = Path("/")
    package: str = ""

    @property
    def is_here(self) -> bool:
        """Whether its programs run here."""
        return not self.emulator or (shutil.which(self.emulator) is not None and (self.libraries / "lib").is_dir())

    @property
    def needed(self) -> pytest.MarkDecorator:
        """Skips a test where its programs do not run."""
        return pytest.mark.skipif(not self.is_here, reason=f"not installed: qemu-user, {self.package}")

    @property
    def through(self) -> tuple[str, ...]:
        """What stands in front of a program."""
        return (self.emulator, "-L", str(self.libraries)) if self.emulator else ()

    @property
    def compiler(self) -> tuple[str, ...]:
        """The command that compiles for it, stripped like the units: for others zig compiles its libraries again."""
        return (*ZIG, "-target", self.target, "-g0", "-s")


HERE = Processor(target="x86_64-linux-gnu.2.17")
ARM64 = Processor(
    target="aarch64-linux-gnu.2.17",
    emulator="qemu-aarch64",
    libraries=Path("/usr/aarch64-linux-gnu"),
    package="libc6-arm64-cross",
)
ARM32 = Processor(
    target="arm-linux-gnueabihf.2.17",
    emulator="qemu-arm",
    libraries=Path("/usr/arm-linux-gnueabihf"),
    package="libc6-armhf-cross",
)
X86_32 = Processor(
    target="x86-linux-gnu.2.17",
    emulator="qemu-i386",
    libraries=Path("/usr/i686-linux-gnu"),
    package="libc6-i386-cross",
)
RISCV64 = Processor(
    target="riscv64-linux-gnu.2.36",
    emulator="qemu-riscv64",
    libraries=Path("/usr/riscv64-linux-gnu"),
    package="libc6-riscv64-cross",
)
