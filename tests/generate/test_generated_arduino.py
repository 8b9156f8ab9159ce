"""The sketch of a generated controller, compiled with Debian's Arduino core, on an emulated Arduino Uno or Mega."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from helpers.boards import need
from helpers.controllers import MACHINES, TRIALS, BoardKind, generate
from helpers.peers.text_devices import CannotRun

pytestmark = pytest.mark.full
CORE = Path("/usr/share/arduino/hardware/arduino/avr/cores/arduino")
OF_C = ["-std=gnu11", "-fno-fat-lto-objects"]
OF_CPP = ["-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics", "-DDECIMAL_DIG=__DECIMAL_DIG__"]
"""Those of platform.txt. The headers of Debian's avr-gcc 5.4 lack DECIMAL_DIG in C++, which the core uses."""


class Arduino(NamedTuple):
    """A board; `flash` and `ram` in bytes, as a sketch may have them."""

    mcu: str
    variant: str
    flash: int
    ram: int

    @property
    def flags(self) -> list[str]:
        """Those of platform.txt."""
        return [
            "-Os", f"-mmcu={self.mcu}", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_ARCH_AVR",
            f"-DARDUINO_AVR_{'UNO' if self.variant == 'standard' else 'MEGA2560'}", "-ffunction-sections",
            "-fdata-sections", "-flto", f"-I{CORE}", f"-I{CORE.parents[1] / 'variants' / self.variant}",
        ]  # fmt: skip

    def compiled(self, file: Path, folder: Path, *more: str) -> Path:
        """The object of a file."""
        target = folder / f"{file.name}.o"
        ino = [*OF_CPP, "-include", "Arduino.h", "-x", "c++"]
        language = {".c": OF_C, ".cpp": OF_CPP, ".ino": ino}.get(file.suffix)
        compiler = "avr-gcc" if language in (OF_C, None) else "avr-g++"
        of = ["-x", "assembler-with-cpp"] if language is None else language
        subprocess.run([compiler, "-c", *self.flags, *of, *more, "-o", target, file], check=True)
        return target


UNO = Arduino("atmega328p", "standard", 32_256, 2_048)
MEGA = Arduino("atmega2560", "mega", 253_952, 8_192)
SKETCHES = [(UNO, name) for board, name in TRIALS if board.startswith("ATmega") and name != "ztheta"]
"""With the core, z-theta has 300 bytes more than the flash of an Uno."""


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Arduino], list[Path]]:
    """The objects of the core for a board."""
    try:
        need("avr-gcc", "simavr")
    except CannotRun as error:
        pytest.skip(str(error))
    if not CORE.is_dir():
        pytest.skip("the sketch needs the Arduino core: Debian's arduino-core-avr")

    @cache
    def compiled(board: Arduino) -> list[Path]:
        folder = tmp_path_factory.mktemp("core")
        files = (file for file in sorted(CORE.iterdir()) if file.suffix in (".c", ".cpp", ".S"))
        return [board.compiled(file, folder) for file in files]

    return compiled


@pytest.mark.parametrize(("board", "machine"), [*SKETCHES, (MEGA, "ztheta")])
def test_the_sketch_compiles_fits_and_tells_its_fault(
    board: Arduino, machine: str, core: Callable[[Arduino], list[Path]], tmp_path: Path
) -> None:
    sketch, built = tmp_path / "controller", tmp_path / "built"
    built.mkdir()
    generate(MACHINES[machine], BoardKind("arduino", None, 1), sketch)
    sources = [file for file in sorted(sketch.iterdir()) if file.suffix in (".c", ".cpp", ".ino")]
    assert sketch / "controller.ino" in sources
    warnings = ["-Wall", "-Wextra", "-Werror"]
    objects = [board.compiled(file, built, f"-I{sketch}", *warnings) for file in sources]
    elf = built / "sketch.elf"
    link = ["avr-gcc", "-Os", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections", f"-mmcu={board.mcu}"]
    subprocess.run([*link, "-o", elf, *objects, *core(board), "-lm"], check=True)
    said = subprocess.run(["avr-size", elf], check=True, capture_output=True, text=True).stdout
    text, data, bss = map(int, said.splitlines()[1].split()[:3])
    assert text + data <= board.flash and data + bss <= board.ram, said
    assert _told(elf, board) == "fault 1"  # no pin is wired yet: the first sensor could not be read


def _told(elf: Path, board: Arduino) -> str:
    """What the sketch tells on its serial port."""
    simavr = shutil.which("simavr")
    assert simavr is not None
    command = [simavr, "-m", board.mcu, "-f", "16000000", elf]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        try:
            found = (re.search(r"fault \d+", line) for line in process.stdout)
            return next(each.group() for each in found if each)
        finally:
            process.kill()
