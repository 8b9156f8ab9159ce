"""A controller on an emulated Cortex-M3: outputs and faults are compared; what a host would set comes from sensors."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from tools.fuzz.machine import Side, part_of
from tools.fuzz.program import Program
from tools.fuzz.stimuli import SENSORS, Stimulus
from tools.fuzz.target import Beside, Refused, Target
from tools.fuzz.verdict import Verdict
from umo.generate.controller_folder import TARGETS, files_of, write_folder
from umo.generate.controller_model import ControllerModel, model_of
from umo.generate.translation import RUNTIME_FAULTS, Translation
from umo.generate.translator import translate

MAIN = Path(__file__).with_name("board_main.c")
OTHER_LIBRARY = re.compile(r"math\.(a?sin|a?cos|a?tan|atan2|exp|log|log10)\(|\*\*")
"""What the library of the board may compute with another last bit (docs/howto-generate.md)."""
CONDITIONED = re.compile(r', (filter|velocity)="\d ms"')
QEMU = "qemu-system-arm", "-M", "mps2-an385", "-display", "none", "-monitor", "none", "-serial", "stdio", "-kernel"


class BoardTarget(Target):
    name = "board"
    restores = False

    def played(self, programs: Sequence[Program]) -> list[Verdict]:
        some = [each for each in programs if not OTHER_LIBRARY.search(each.control)]
        found = dict(zip(some, super().played(some), strict=True))
        return [found.get(each, Verdict("left out")) for each in programs]

    def fit(self, program: Program) -> Program:
        """A filter is of that library, too."""
        return replace(program, text=CONDITIONED.sub("", program.text)).with_inputs_as_fields()

    def stimulus(self, given: Stimulus) -> Stimulus:
        return replace(given, clears=True, deaf=[False] * len(given.deaf))

    def beside(self, python: Side, programs: Sequence[Program], stack: ExitStack) -> Beside:
        target = TARGETS["cortex-m"]
        model = model_of(python.connection.machine, python.wired)
        translation = translate(python.m, model.conditions, model.steps, target)
        if reasons := [*map(str, [*translation.problems, *translation.on_host])]:
            raise Refused(programs, reasons)
        folder = self.new_folder()
        write_folder(files_of(model, translation, target), folder)
        shutil.copy(MAIN, folder)
        subprocess.run(["make", "-s", "-C", folder, "trial.elf", f"MAIN={MAIN.name}"], check=True)
        command = [*QEMU, folder / "trial.elf"]
        board = stack.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        stack.callback(board.kill)
        return BoardBeside(python, model, translation, board)


class BoardBeside(Beside):
    def __init__(
        self, python: Side, model: ControllerModel, translation: Translation, board: subprocess.Popen[bytes]
    ) -> None:
        self._python, self._board = python, board
        self._kinds: dict[int, str | None] = {0: None}
        self._kinds |= {number: kind for number, (_, kind, _) in enumerate(RUNTIME_FAULTS, 1)}
        self._kinds |= {each.number: each.kind for each in translation.faults}
        self._inputs = [each.path for each in model.objects[: model.inputs]]
        self._outputs = [model.objects[slot].path for slot in model.outputs]
        self._parts = [part_of(each.path)[0] for each in model.equipment]
        self._faults = dict.fromkeys(self._parts, 0)
        self._raws: dict[str, int] = {}
        self._line(0, [0] * len(self._inputs), [False] * len(self._inputs))

    def set(self, number: int, name: str, value: Any) -> bool:
        return False

    def clear(self, number: int) -> bool | None:
        return None  # it does so by itself

    def acknowledge(self) -> None:
        """It does so by itself."""

    def step(self, ticks: int, given: Sequence[Stimulus]) -> str | None:
        raws, failed = {}, {}
        for number, each in enumerate(given):
            paths = [f"parts.{number}.{name}" for name in SENSORS]
            raws |= zip(paths, each.raws, strict=True)
            failed |= zip(paths, each.failed, strict=True)
        return self._line(ticks, [raws[path] for path in self._inputs], [failed[path] for path in self._inputs])

    def _line(self, ticks: int, raws: Sequence[int], failed: Sequence[bool]) -> str | None:
        """A period; the class of the error of the machine."""
        words = ["x" if no else str(raw) for raw, no in zip(raws, failed, strict=True)]
        assert self._board.stdin is not None and self._board.stdout is not None
        self._board.stdin.write(f"{ticks} {' '.join(words)}\n".encode())
        self._board.stdin.flush()
        numbers = list(map(int, self._board.stdout.readline().split()))
        count = len(self._parts)
        self._faults = dict(zip(self._parts, numbers[:count], strict=True))
        self._raws = dict(zip(self._outputs, numbers[count + 1 :], strict=True))
        return self._kinds[numbers[count]]

    def errors(self) -> dict[int, str]:
        """Of those that were not in fault when the period began."""
        begun = {n: fault for n, fault in self._faults.items() if fault and not self._python.in_fault(n)}
        kinds = {n: str(self._kinds[fault]) for n, fault in begun.items()}
        return {n: kind for n, kind in kinds.items() if kind != "DriverError"}  # of what is read and sent

    def restore(self, number: int) -> None:
        raise AssertionError("a board does not tell its fields")

    def difference(self, number: int) -> str:
        python = self._python
        if python.in_fault(number) != bool(self._faults[number]):
            return f"in fault: Python {python.in_fault(number)}, C {self._kinds[self._faults[number]]}"
        for path in self._outputs:
            if part_of(path)[0] == number and python.circuit.raws[path] != self._raws[path]:
                return f"{path}: Python {python.circuit.raws[path]}, C {self._raws[path]}"
        return ""
