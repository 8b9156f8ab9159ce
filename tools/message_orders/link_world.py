"""A link under a schedule of its messages, and what must be true of it.

The host is a connected machine with the driver `controller`; the controller is its generated program. One world goes
from one schedule to the next: each begins and ends with both ends in step.
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from tools.message_orders.line import Line
from tools.message_orders.link_ends import (
    TO_CONTROLLER,
    TO_HOST,
    ControllerProgram,
    LineDial,
    LineWorld,
    compiled,
    virtual_time,
)
from tools.message_orders.link_part import (
    BRAKING_TIMEOUT,
    CONTROLLER_PERIOD,
    HOST_PERIOD,
    HOST_TIMEOUT,
    HOT,
    LOAD,
    Plant,
    machine,
    wiring,
)
from tools.message_orders.schedules import DELIVER, Schedule
from umo import Quality, connect
from umo.errors import UmoError
from umo.generate.controller_folder import write_folder
from umo.generate.controller_generator import target_of
from umo.generate.split.link_bodies import ControllerMode, ControllerState, StateReader
from umo.generate.split.link_frames import FrameReader
from umo.generate.split.link_host import LinkHost
from umo.generate.split.link_stop import stop_controller
from umo.generate.split.part_generator import part_files
from umo.generate.split.part_plan import PartPlan

SCENARIOS = ("run", "greet", "fault", "guardian", "orphan")
SHORT, LATE = 0.6 * HOST_TIMEOUT, 1.3 * HOST_TIMEOUT
"""Times in s for which a line holds a message: the host still counts as there, or does not."""
RUNNING = 1
DEFAULTS, DRIVEN = [0, 0], [50, 10]
STOP_TIME = HOST_TIMEOUT + BRAKING_TIMEOUT + CONTROLLER_PERIOD
LONGEST_PERIOD = 2.5
"""s in which a period of the host ends, whatever the line does: it waits for an answer to START for 1 s at most."""
IN_STEP_TIME, IN_STEP_MESSAGES = 0.5, 40
"""Within so much, counted from the last message that the schedule decides over, both ends are in step."""


class Untrue(AssertionError):
    """What a schedule has shown to be untrue."""


def require(is_true: bool, text: str) -> None:
    if not is_true:
        raise Untrue(text)


class ControllerWatch:
    """What the controller does, period by period, and what may not be."""

    def __init__(self, program: ControllerProgram, places: dict[str, int]) -> None:
        self.program, self._places = program, places
        self.read_at = [0.0]
        """When it has read each value of its counter, s."""
        self.pairs: set[tuple[int, int]] = set()
        self._begun: deque[int] = deque(maxlen=1000)
        self.session = self.mode = self.target = self.load = self.fault = 0
        self.faulted_at = 0.0
        self.targets: set[int] = {0}
        """What the application has set."""
        self.cleared_at: list[float] = []
        """When the operator has cleared, and it was not carried out yet."""

    def look(self, now: float) -> None:
        """After a period."""
        program, before = self.program, self.session
        session, self.mode = program.session, program.mode
        if self.mode != RUNNING:
            require(program.outputs == DEFAULTS, f"the controller does not run, and its outputs are {program.outputs}")
            self.session = session
            return
        require(program.silent * CONTROLLER_PERIOD <= HOST_TIMEOUT, "it runs beyond the host timeout")
        starts = session != before
        if starts:
            require(session not in self._begun, f"session {session} is begun twice")
            self._begun.append(session)
        self._look_at_fields(starts)
        self._look_at_fault(now, starts)
        self.session = session

    def _look_at_fields(self, starts: bool) -> None:
        program, places = self.program, self._places
        target, load = program.number(places["target"]), program.number(places["load"])
        require(target in self.targets, f"the controller has the target {target}, which nobody has set")
        require(target >= self.target, f"the target {target} has come after {self.target}")
        number, before = load // LOAD, self.load // LOAD
        if not starts:
            require(number >= before, f"load {number} has come after {before}")
            require(number > before or load <= self.load, f"load {number} was carried out twice")
        self.target, self.load = target, load
        self.pairs.add((program.number(places["made"]), program.number(places["seen"])))

    def _look_at_fault(self, now: float, starts: bool) -> None:
        fault = self.program.fault(0)
        if fault and not self.fault:
            self.faulted_at = now
        elif self.fault and not fault and not starts:
            known = [at for at in self.cleared_at if at > self.faulted_at]
            require(bool(known), "a fault was cleared that nobody has seen")
            self.cleared_at.remove(known[0])
        self.fault = fault


class LinkWorld(LineWorld):
    """Both ends, in step. `folder` has the library of the controller."""

    def __init__(self, library: Path) -> None:
        self.line = Line(SHORT, LATE)
        self.root = machine()
        self.program = ControllerProgram(library, 2)
        self._stack = ExitStack()
        self._periods = self._next_host = 0
        self._temperature = 20
        self._target = self._loads = 0
        """What the application has set last."""
        self._untrue = ""
        """The first thing that a look has found."""
        self._sent: deque[ControllerState] = deque(maxlen=400)
        self._last: tuple[float, ControllerState] | None = None
        self._begin()

    def _begin(self) -> None:
        self._stack.enter_context(virtual_time(self))
        self.program.power_up()
        self._connection = connect(self.root, wiring(), acknowledge=True)
        self.watch: ControllerWatch
        self.m: Plant = self._stack.enter_context(self._connection)
        self._driver = self._connection.driver("drive")
        self.until_in_step()

    def plan(self, plan: PartPlan) -> None:
        """The plan of the part is known: what the controller says can be read."""
        self._plan, self._reader, self._states = plan, FrameReader(plan.longest), StateReader(plan)
        places = {each.name: number for number, each in enumerate(plan.fields)}
        self.watch = ControllerWatch(self.program, places)

    def close(self) -> None:
        self.line.is_dead = False
        self._stack.close()

    # Time ------------------------------------------------------------------------------------------------

    def advance(self, until: float) -> None:
        """To the next thing that happens, at most to `until`."""
        line, following = self.line, (self._periods + 1) * CONTROLLER_PERIOD
        due = line.next_due(TO_HOST)
        line.now = min(until, following, due if due > line.now else until)
        if line.now >= following:
            self._controller_period()

    def _controller_period(self) -> None:
        line = self.line
        self._periods += 1
        self.watch.read_at.append(line.now)
        said = self.program.period([self._periods, self._temperature], line.arrived(TO_CONTROLLER))
        self._note(self.watch.look, line.now)
        self._note(self._look_at_silence, line.now - line.heard_at)
        if said:
            states = [state for body in self._reader.take(said) if (state := self._states.read(body)) is not None]
            self._sent += states
            self._note(self._look_at_answers, states)
            for frame in split_frames(said):
                line.send(TO_HOST, frame)

    def _look_at_silence(self, silent: float) -> None:
        require(self.watch.mode != RUNNING or silent <= STOP_TIME, f"it runs after a silence of {silent:g} s")

    def _look_at_answers(self, states: Sequence[ControllerState]) -> None:
        gone = any(each.mode is ControllerMode.HOST_GONE for each in states)
        require(not gone, "a session that has ended is answered")

    def _note(self, look: Callable[[Any], object], at: Any) -> None:
        """Look, and keep what is untrue until the host's call has returned, which would take it for its own failure."""
        try:
            look(at)
        except Untrue as error:
            self._untrue = self._untrue or str(error)

    def wait(self, seconds: float) -> None:
        until = self.line.now + seconds
        while self.line.now < until:
            self.advance(until)

    def host_period(self) -> None:
        """One period of the host."""
        m, began = self.m, self.line.now
        m.timer.read()
        m.sample()
        self._look_at_host()
        m.control()
        m.update()
        took = self.line.now - began
        require(took <= LONGEST_PERIOD, f"a period of the host takes {took:g} s")
        self.wait(max(HOST_PERIOD - took, 0.0))
        self._raise_noted()

    def _raise_noted(self) -> None:
        if self._untrue:
            raise Untrue(self._untrue)

    # What the host shows ---------------------------------------------------------------------------------

    def told(self, state: ControllerState) -> None:
        """The driver takes this for the state of the controller."""
        self._note(self._look_at_state, state)

    def _look_at_state(self, state: ControllerState) -> None:
        require(state in self._sent, f"the controller has not said {state}")
        if self._last is not None and self._last[1].session == state.session:
            require(state.number >= self._last[1].number, "the host goes back to an older state")
        self._last = self.line.now, state

    def _look_at_host(self) -> None:
        drive, now = self.m.drive, self.line.now
        if drive.counter.quality is Quality.GOOD:
            age = now - self.watch.read_at[int(drive.counter.read())]
            limit = max(self._driver.timeout, HOST_TIMEOUT)
            require(age <= limit, f"a value is {age:g} s old, and is shown as good")
        pair = drive.made, drive.seen
        require(pair == (0, 0) or pair in self.watch.pairs, f"{pair} is shown, which the controller never had")

    # What the application does ---------------------------------------------------------------------------

    def set_target(self) -> None:
        self._target += 1
        self.m.drive.target = self._target
        self.watch.targets.add(self._target)

    def set_load(self) -> None:
        self._loads += 1
        self.m.drive.load = self._loads * LOAD + LOAD - 1

    def clear_faults(self) -> bool:
        """The operator clears what is in fault."""
        equipment, zone = self._connection.machine.equipment, self.m.drive.zone
        if not equipment.is_in_fault(zone):
            return False
        self.watch.cleared_at.append(self.line.now)
        equipment.clear(zone)
        return True

    # Schedules -------------------------------------------------------------------------------------------

    @property
    def is_in_step(self) -> bool:
        drive, watch = self.m.drive, self.watch
        return (
            drive.counter.quality is Quality.GOOD
            and watch.mode == RUNNING
            and watch.target == drive.target == self._target
            and watch.load // LOAD == drive.load // LOAD == self._loads
            and not watch.fault
            and self.program.outputs == DRIVEN
        )

    def until_in_step(self) -> None:
        began, messages = self.line.now, self.line.messages
        while not self.is_in_step:
            self.clear_faults()
            self.host_period()
            require(self.line.now - began <= IN_STEP_TIME, f"not in step after {IN_STEP_TIME} s")
        said = self.line.messages - messages
        require(said <= IN_STEP_MESSAGES, f"in step after {said} messages")

    def run(self, schedule: Schedule) -> None:
        """From in step to in step. Untrue."""
        session = self.program.session
        self.line.begin(schedule.letters)
        getattr(self, f"_{schedule.scenario}")()
        self.line.counts = False
        self.until_in_step()
        if schedule.scenario == "run" and schedule.letters.strip(DELIVER) in ("L", "C", "X"):
            require(self.program.session == session, "a message that is lost ends the session")
        self._both_stop()
        self.until_in_step()

    def _while_it_decides(self, *acts: Callable[[int], object]) -> None:
        """Periods of the host until the schedule has decided over its messages, or nothing is sent any more."""
        for number in range(400):
            if self.line.is_decided:
                return
            for act in acts:
                act(number)
            self.host_period()
        raise Untrue("the ends have stopped talking")

    def _change(self, number: int) -> None:
        self.set_target()
        if number % 3 == 0:
            self.set_load()

    def _run(self) -> None:
        """The application changes what the part is to do, in each period."""
        self.line.counts = True
        self._while_it_decides(self._change)

    def _greet(self) -> None:
        """The line was away, and both ends have stopped."""
        self._both_stop()
        self.line.counts = True
        self._while_it_decides(self._change)

    def _fault(self) -> None:
        """A part fails alone, is cleared, and fails again."""

        def spike(number: int) -> None:
            self._temperature = HOT + 1 if number % 4 == 0 else 20

        self.line.counts = True
        self._while_it_decides(spike, lambda _: self.clear_faults())
        self._temperature = 20

    def _guardian(self) -> None:
        """The control process has died after a period, its guardian stops the controller, and another one begins."""
        self.line.counts = True
        self.host_period()
        self._stopped_by_guardian()
        self._driver.close()
        with suppress(UmoError):
            self._driver.open()
        self.line.counts = False

    def _orphan(self) -> None:
        """A control process that takes the place of another one has died while it greets, and its guardian stops the
        controller."""
        self.line.counts = True
        LinkHost(LineDial(), self._plan, "drive").look()
        self._stopped_by_guardian()
        self.line.counts = False

    def _stopped_by_guardian(self) -> None:
        deadline = self.line.now + 20 * HOST_TIMEOUT
        try:
            stop_controller(LineDial(), "drive", deadline, HOST_TIMEOUT / 5)
        except UmoError:
            require(not self.line.is_decided, "the guardian does not reach a controller whose messages come")
        else:
            require(self.watch.mode != RUNNING, "the guardian says that the controller is stopped")

    def _both_stop(self) -> None:
        """The line carries nothing: the controller stops in time, and the host shows nothing as good."""
        self.line.is_dead = True
        until = self.line.now + max(self._driver.timeout, HOST_TIMEOUT) + 3 * HOST_PERIOD + LATE
        while self.line.now < until:
            self.host_period()
        require(self.watch.mode == ControllerMode.HOST_GONE, "the controller goes on without its host")
        require(self.m.drive.counter.quality is not Quality.GOOD, "the host shows a value as good, without a line")
        self.line.is_dead = False


def split_frames(said: bytes) -> Iterator[bytes]:
    """The frames in what the controller has said in a period, each with its two zeros."""
    for each in said.split(b"\0"):
        if each:
            yield b"\0" + each + b"\0"


@contextmanager
def controller_library() -> Iterator[Path]:
    """The controller's program as a library, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        write_folder(part_files(machine(), wiring(), "drive", target_of("host")), Path(folder))
        yield compiled(Path(folder))


class LinkRuns:
    """Runs schedules, one after the other; after one that fails, both ends begin anew."""

    def __init__(self, library: Path) -> None:
        self._library = library
        self._world: LinkWorld | None = None

    def run(self, schedule: Schedule) -> str:
        """What is untrue; "": nothing."""
        try:
            if self._world is None:
                self._world = LinkWorld(self._library)
            self._world.run(schedule)
        except Untrue as error:
            self.close()
            return str(error)
        return ""

    def close(self) -> None:
        if self._world is not None:
            world, self._world = self._world, None
            with suppress(UmoError, Untrue):
                world.close()
