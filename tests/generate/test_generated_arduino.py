"""The sketch of a generated controller, compiled with Debian's Arduino core, on an emulated Arduino Uno."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from helpers.boards import need
from helpers.controllers import MACHINES, BoardKind, generate
from helpers.peers.text_devices import CannotRun

pytestmark = pytest.mark.full
CORE = Path("/usr/share/arduino/hardware/arduino/avr/cores/arduino")
VARIANT = CORE.parents[1] / "variants" / "standard"
FLAGS = [
    "-Os", "-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO", "-DARDUINO_ARCH_AVR",
    "-ffunction-sections", "-fdata-sections", "-flto", f"-I{CORE}", f"-I{VARIANT}",
]  # fmt: skip
"""Those of platform.txt. The headers of Debian's avr-gcc 5.4 lack DECIMAL_DIG in C++, which the core uses."""
OF_C = ["-std=gnu11", "-fno-fat-lto-objects"]
OF_CPP = ["-std=gnu++11", "-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics", "-DDECIMAL_DIG=__DECIMAL_DIG__"]
FLASH, RAM = 32_256, 2_048
"""Bytes of an Uno that a sketch may have."""


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The objects of the core."""
    try:
        need("avr-gcc", "simavr")
    except CannotRun as error:
        pytest.skip(str(error))
    if not CORE.is_dir():
        pytest.skip("the sketch needs the Arduino core: Debian's arduino-core-avr")
    folder = tmp_path_factory.mktemp("core")
    return [_compiled(file, folder) for file in sorted(CORE.iterdir()) if file.suffix in (".c", ".cpp", ".S")]


def _compiled(file: Path, folder: Path, *more: str) -> Path:
    target = folder / f"{file.name}.o"
    language = {".c": OF_C, ".cpp": OF_CPP, ".ino": [*OF_CPP, "-include", "Arduino.h", "-x", "c++"]}.get(file.suffix)
    compiler = "avr-gcc" if language in (OF_C, None) else "avr-g++"
    of = ["-x", "assembler-with-cpp"] if language is None else language
    subprocess.run([compiler, "-c", *FLAGS, *of, *more, "-o", target, file], check=True)
    return target


@pytest.mark.parametrize("machine", MACHINES)
def test_the_sketch_compiles_fits_and_tells_its_fault(machine: str, core: list[Path], tmp_path: Path) -> None:
    sketch, built = tmp_path / "controller", tmp_path / "built"
    built.mkdir()
    generate(MACHINES[machine], BoardKind("arduino", None, 1), sketch)
    sources = [file for file in sorted(sketch.iterdir()) if file.suffix in (".c", ".cpp", ".ino")]
    assert sketch / "controller.ino" in sources
    warnings = ["-Wall", "-Wextra", "-Werror"]
    objects = [_compiled(file, built, f"-I{sketch}", *warnings) for file in sources]
    elf = built / "sketch.elf"
    link = ["avr-gcc", "-Os", "-flto", "-fuse-linker-plugin", "-Wl,--gc-sections", "-mmcu=atmega328p"]
    subprocess.run([*link, "-o", elf, *objects, *core, "-lm"], check=True)
    said = subprocess.run(["avr-size", elf], check=True, capture_output=True, text=True).stdout
    text, data, bss = map(int, said.splitlines()[1].split()[:3])
    assert text + data <= FLASH and data + bss <= RAM, said
    assert _told(elf) == "fault 1"  # no pin is wired yet: the first sensor could not be read


def _told(elf: Path) -> str:
    """What the sketch tells on its serial port."""
    simavr = shutil.which("simavr")
    assert simavr is not None
    command = [simavr, "-m", "atmega328p", "-f", "16000000", elf]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        try:
            found = (re.search(r"fault \d+", line) for line in process.stdout)
            return next(each.group() for each in found if each)
        finally:
            process.kill()
