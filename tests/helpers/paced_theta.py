"""The theta axis on a controller whose periods a test gives, one by one, with what its host says in them."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, cast

from helpers.split_axis import COUNTS_PER_STEP, PEERS, theta_wiring
from umo.control import StepperAxis
from umo.control.inputs import HOMING
from umo.control.profile import Setpoint
from umo.drivers.faults.wrapper import bare
from umo.generate.compiled_machine import FLAGS, compiler
from umo.generate.controller_folder import write_folder
from umo.generate.controller_generator import target_of
from umo.process.station import find
from umo.split.controller_driver import Controller
from umo.split.link_bodies import FrameItem, FrameKind, hello, item, request, welcome_of
from umo.split.link_frames import FrameReader, framed
from umo.split.part_generator import _files, _plan
from umo.split.part_plan import PartPlan
from umo.wiring import resolve


class Period(NamedTuple):
    """What the controller was after one period."""

    mode: int
    setpoint: Setpoint
    outputs: list[int]
    answers: list[bytes]


class PacedTheta:
    """The controller, and the frames of its host."""

    def __init__(self, process: subprocess.Popen[str], plan: PartPlan, axis: StepperAxis) -> None:
        self._process, self._plan, self.axis = process, plan, axis
        self._reader = FrameReader(plan.longest)
        self._number = self.session = 0

    def step(self, body: bytes = b"", ticks: int = 1) -> Period:
        """One period, in which this frame has come."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{ticks} {framed(body).hex() if body else ''}\n")
        self._process.stdin.flush()
        mode, position, velocity, acceleration, *outputs, answer = self._process.stdout.readline().split()
        bodies = list(self._reader.take(b"" if answer == "-" else bytes.fromhex(answer)))
        setpoint = Setpoint(float(position), float(velocity), float(acceleration))
        return Period(int(mode), setpoint, [int(each) for each in outputs], bodies)

    def greet(self) -> int:
        """The session that the controller offers."""
        self._number += 1
        (body,) = self.step(hello(self._number)).answers
        found = welcome_of(body)
        assert found is not None
        return found.session

    def request(self, kind: FrameKind, items: Sequence[bytes] = (), session: int | None = None) -> bytes:
        self._number += 1
        outputs = len(self._plan.model.outputs)
        given = self.session if session is None else session
        return request(kind, given, self._number, [False] * outputs, items)

    def start(self) -> Period:
        """Begin a session, with the axis as it is in Python."""
        self.session = self.greet()
        fields = [item(FrameItem.FIELD, number, each.live()) for number, each in enumerate(self._plan.fields)]
        self.step(self.request(FrameKind.START))
        return self.step(self.request(FrameKind.EXCHANGE, fields))


@contextmanager
def paced_theta(folder: Path, **options: Any) -> Iterator[PacedTheta]:
    """Theta at its index, enabled."""
    root = find("ztheta").machine()
    wired = resolve(root, theta_wiring(1, **options))
    driver = bare(wired.drivers["drive"])
    assert isinstance(driver, Controller)
    plan = _plan(root, wired, "theta", driver, target_of("host"))
    write_folder(_files(plan), folder)
    sources = [*folder.glob("umo_*.c"), *(folder / f"{name}.c" for name in ("machine", "machine_link", "main_link"))]
    program, cc = folder / "paced", compiler()
    assert cc is not None
    counts = f"-DCOUNTS_PER_STEP={COUNTS_PER_STEP}"
    board = PEERS / "paced_board.c"
    subprocess.run([cc, *FLAGS, counts, f"-I{folder}", "-o", program, *sources, board, "-lm"], check=True)
    axis = cast(StepperAxis, root.theta)
    axis.enabled, axis._accept, axis._offset = True, HOMING, axis.encoder.zero_offset
    axis.profile.hold(axis._offset)
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield PacedTheta(process, plan, axis)
        finally:
            process.kill()
