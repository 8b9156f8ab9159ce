"""A part on a controller whose periods a test gives, one by one, with what its host says in them; such as theta."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, cast

from helpers.split_parts import PEERS, THETA
from umo import Compound
from umo.control import StepperAxis
from umo.control.axis_state import AxisState
from umo.control.inputs import HOMING
from umo.control.profile import Setpoint
from umo.cycle.laid_out import wired_numbers
from umo.drivers.wrapping import bare
from umo.generate.c_compiler import FLAGS, compiler
from umo.generate.controller_folder import write_folder
from umo.generate.controller_generator import target_of
from umo.generate.split.controller_driver import Controller
from umo.generate.split.link_bodies import (
    ControllerState,
    FrameItem,
    FrameKind,
    StateReader,
    hello,
    item,
    request,
    welcome_of,
)
from umo.generate.split.link_frames import FrameReader, framed
from umo.generate.split.part_generator import part_files
from umo.generate.split.part_plan import PartPlan
from umo.wiring import resolve


class Period(NamedTuple):
    """What the controller was after one period."""

    mode: int
    setpoint: Setpoint
    outputs: list[int]
    answers: list[bytes]


class PacedController:
    """The controller, and the frames of its host."""

    def __init__(self, process: subprocess.Popen[str], plan: PartPlan) -> None:
        self._process, self._plan = process, plan
        self._reader, self._states = FrameReader(plan.longest), StateReader(plan)
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

    def exchange(self, *items: bytes, ticks: int = 1) -> ControllerState:
        """A period in which the host says something, and what the controller answers."""
        (body,) = self.step(self.request(FrameKind.EXCHANGE, items), ticks).answers
        found = self._states.read(body)
        assert found is not None
        return found

    def start(self) -> Period:
        """Begin a session, with the part as it is in Python."""
        self.session = self.greet()
        fields = [item(FrameItem.FIELD, number, each.live()) for number, each in enumerate(self._plan.fields)]
        self.step(self.request(FrameKind.START))
        return self.step(self.request(FrameKind.EXCHANGE, fields))


@contextmanager
def paced(
    folder: Path, root: Compound, wiring: dict[str, Any], part: Compound, profile: str, plant: str = "no_plant.c"
) -> Iterator[PacedController]:
    """The part on the controller `drive`, whose program is in the folder, or is made there. The profile is told."""
    wired = resolve(root, wiring)
    driver = bare(wired.drivers["drive"])
    assert isinstance(driver, Controller)
    with wired_numbers(root, wired):
        plan = driver.take_part(part, wired)
    program = folder / "paced"
    if not program.exists():
        write_folder(part_files(root, wiring, "drive", target_of("host")), folder)
        _compile(folder, program, profile, plant)
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield PacedController(process, plan)
        finally:
            process.kill()


def _compile(folder: Path, program: Path, profile: str, plant: str) -> None:
    sources = [*folder.glob("umo_*.c"), *(folder / f"{name}.c" for name in ("machine", "machine_link", "main_link"))]
    cc = compiler()
    assert cc is not None
    board = folder / "paced_board.c"
    board.write_text(f'#define PROFILE {profile}\n#include "{PEERS / board.name}"\n')
    command = [cc, *FLAGS, "-fPIC", f"-I{folder}", "-o", program, *sources, board, PEERS / plant, "-lm"]
    subprocess.run(command, check=True)


@contextmanager
def paced_theta(folder: Path, **options: Any) -> Iterator[tuple[PacedController, StepperAxis]]:
    """Theta at its index, enabled, and the axis in Python."""
    root = THETA.machine()
    with paced(folder, root, THETA.wiring(1, **options), root.theta, "theta_profile", THETA.plant) as controller:
        axis = cast(StepperAxis, root.theta)
        enable(axis)
        yield controller, axis


def enable(axis: StepperAxis) -> None:
    """The axis is enabled where its counter reads 0."""
    axis._state, axis._accept, axis._offset = AxisState.STANDSTILL, HOMING, axis.encoder.zero_offset
    axis.profile.hold(axis._offset)
