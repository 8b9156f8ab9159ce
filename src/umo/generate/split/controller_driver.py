"""The driver for a controller that runs a part of the machine. The driver itself runs on the host."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from umo.cycle.capability import Capability
from umo.cycle.machine import ConnectedMachine
from umo.cycle.part_periods import give_period
from umo.drivers.contract import Channel, Direction, Driver, IntArray
from umo.drivers.option_checks import duration, one_of
from umo.drivers.optional import Looks
from umo.drivers.streams import Host, Serial, place_of
from umo.errors import ChannelsFailed, DriverError, WiringError
from umo.generate.controller_generator import target_of
from umo.generate.known_values import KnownName
from umo.generate.known_watch import KnownWatch
from umo.generate.split.link_bodies import ControllerMode, ControllerState, FrameKind
from umo.generate.split.link_host import LinkHost, late
from umo.generate.split.link_stop import stop_controller
from umo.generate.split.part_mirror import PartMirror
from umo.generate.split.part_plan import PartPlan, plan_of
from umo.objects import Compound
from umo.system import calls
from umo.system.packages import how_to_install
from umo.wiring.wired import Wired

_DEFAULT = Host("127.0.0.1", 5327), Serial("", 115200, "none")
TARGETS = {"double": "cortex-m", "float": "avr"}


class Controller(Driver[Channel], Looks, Capability):
    """A controller with generated code (`umo new controller --controller`), which runs a part of the machine.

        [drivers.drive]
        type = "controller"
        serial = "/dev/ttyACM0"

        [wire]
        "theta" = { controller = "drive" }

    A channel is any string, and names a circuit of the board. The objects of the part are on this driver without a
    separate line in the wiring. A line may change the scale of an object.

    Options:
        host: the address of the controller for TCP. Default: 127.0.0.1.
        port: the TCP port of the controller. Default: 5327.
        serial: the device file of a serial line, in place of host and port.
        baudrate: the speed of the serial line in bit/s. Default: 115200.
        real: the type of the numbers on the controller: "double" or "float".
        cycle: the period of the controller. Default: that of the part, which is the machine's, or `every` of its class.
        host_timeout: the time without the host after which the controller brakes its axes to standstill, and then
            brings its outputs to their defaults. If no axis moves, it does so immediately.
        braking_timeout: the longest time for braking, after which every output goes to its default. 0: no braking.
    """

    forms = ("any text",)

    def __init__(
        self,
        *,
        host: str | None = None,
        port: int | None = None,
        serial: str | None = None,
        baudrate: int | None = None,
        real: Literal["double", "float"] = "double",
        cycle: str | float | None = None,
        host_timeout: str | float = 0.1,
        braking_timeout: str | float = 1.0,
    ) -> None:
        self.place = place_of(_DEFAULT, host, port, serial, baudrate=baudrate)
        self.real = one_of("real", real, ("double", "float"))
        self._cycle = None if cycle is None else duration("cycle", cycle)
        self.host_timeout = duration("host_timeout", host_timeout)
        self.braking_timeout = 0.0 if braking_timeout == 0 else duration("braking_timeout", braking_timeout)
        if not self.host_timeout > 0.0 or self._cycle == 0.0:
            raise WiringError("host_timeout and cycle must be above 0 s")
        self._prepared = self.place.prepared()
        self._plan: PartPlan | None = None
        self._link: LinkHost | None = None
        self._mirror: PartMirror | None = None
        self._machine: ConnectedMachine | None = None
        self._part: Compound | None = None
        self._watch: KnownWatch | None = None
        self._wrong = ""
        """The value that the code on the controller takes as known and that differs on the host."""
        self._contained = False
        """True if the whole part is in fault, and this fault is contained in equipment: in the part itself, or in
        equipment around it."""
        self._ends = self._rested = False
        self._places: dict[str, int] = {}
        self._seen: ControllerState | None = None

    def channel(self, text: str) -> Channel:
        return Channel(text, Direction.BOTH, 32, signed=True)

    def devices(self) -> Sequence[str]:
        """Return the host's addresses and port, or the device file."""
        return self.place.devices()

    # The part ----------------------------------------------------------------------------------------------

    def cycle_for(self, part: Compound, wired: Wired) -> float:
        """Return the period of the controller in s; by default it is the period of the part."""
        return self._cycle or (wired.period or 0.0) * wired.rates.every(part)

    def take_part(self, part: Compound, wired: Wired) -> PartPlan:
        """Take the part that runs on this controller, before the machine is connected. Raises NotTranslated if the part
        cannot be translated."""
        target = target_of(TARGETS[self.real], self.real)
        cycle = self.cycle_for(part, wired)
        self._part = part
        plan = self._plan = plan_of(part, wired, self, cycle, target, self.host_timeout, self.braking_timeout)
        channels = {each.item.path: each.channel.text for each in wired.wires}
        self._places = {channels[each.path]: n for n, each in enumerate(plan.model.objects[: plan.model.inputs])}
        return plan

    def attach(self, machine: ConnectedMachine) -> None:
        """Keep the attributes of the part equal to those of the controller from now on. The host does not call the laws
        of the part, because they run on the controller."""
        part = self._part
        assert self._plan is not None and part is not None
        machine.acting_laws.leave_out(part)
        if self._cycle is not None:
            give_period(machine, part, self._cycle)
        self._machine, self._mirror = machine, PartMirror(self._plan, machine, part)
        self._watch = KnownWatch(self._plan.translation.known, self._note_changes)
        self._ends = self._rested = False

    def end(self) -> None:
        """Prepare for the end of the machine. The first reset after that stops the controller."""
        self._ends = True

    # The driver --------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect, and check that the controller has this part. A process that only resets, such as a guardian, does
        not know the part, and connects only when it resets."""
        if not self._prepared:
            raise DriverError(f"a serial line needs pyserial: {how_to_install('text')}")
        self._rested = False
        if self._plan is None:
            return
        self._link = LinkHost(self.place.dial(), self._plan, self._name)
        self._link.greet(self._deadline())

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    @property
    def _name(self) -> str:
        return next(iter(self.place.devices()), "")

    def _deadline(self) -> float:
        """Return the time by which the controller must answer a repeated message."""
        return calls.now() + max(self.timeout, 5 * self.host_timeout)

    def _connected(self) -> LinkHost:
        if self._plan is None:
            raise DriverError('no part is wired to this controller: write "PART" = { controller = "NAME" } in [wire]')
        if self._link is None:
            raise DriverError("it is not open")
        return self._link

    def initialize(self, channel: Channel, default: int | None) -> None:
        """Keep the outputs at their defaults until the controller is started, and clear a fault of the controller."""
        if self._mirror is not None:
            self._mirror.clear()
        self._contained = False
        link = self._link
        if link is not None and link.state is not None and link.state.mode is not ControllerMode.RUNNING:
            link.close()

    def reset(self, channel: Channel, default: int | None) -> None:
        """Set all outputs to their defaults at the end of a run, in the controller's stop order. During a run the next
        exchange sends the inhibited outputs."""
        if default is None or self._rested or not (self._ends or self._mirror is None):
            return
        if self._plan is None:
            stop_controller(self.place.dial(), self._name, self._deadline(), self.host_timeout / 5)
        else:
            self._stop(self._connected(), self._deadline())
        self._rested = True

    def _stop(self, link: LinkHost, deadline: float) -> None:
        if not link.session and not link.offered:
            link.greet(deadline)
        if link.stop(deadline).mode is not ControllerMode.RESTING:
            raise DriverError(f"the controller {self._name} has not stopped")

    def read(self, channel: Channel) -> int:
        out = np.empty(1, np.int64)
        self.read_many((channel,), out)
        return int(out[0])

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        state = self._heard()
        failed = {}
        for i, channel in enumerate(channels):
            place = self._places[channel.text]
            out[i] = state.raws_in[place]
            if state.failed[place]:
                failed[channel.text] = "the controller could not read it"
        if state.mode is not ControllerMode.RUNNING and not (self._ends or self._contained):
            raise ChannelsFailed(dict.fromkeys((each.text for each in channels), self._fault_text(state)))
        if failed:
            raise ChannelsFailed(failed)

    def write(self, channel: Channel, raw: int) -> None:
        channel.check(raw)
        self._exchange()

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        self._exchange()

    def look(self) -> bool | None:
        return False if self._link is None else self._link.look()

    # The exchange ------------------------------------------------------------------------------------------

    def _heard(self) -> ControllerState:
        """Return the last answer of the controller. A controller that was not started is started first."""
        link, mirror = self._connected(), self._mirror
        assert mirror is not None
        self._check_known()
        link.receive()
        if not link.session:
            self._start(link, mirror)
        state = link.state
        if state is None or link.age > max(self.timeout, self.host_timeout):
            age = link.age
            link.close()
            raise late(self._name, age)
        if state is not self._seen:
            self._seen = state
            if not link.awaited:
                mirror.confirm()
            mirror.take(state)
            mirror.plan(state)
            self._tell_faults(state, mirror)
        return state

    def _note_changes(self, names: list[KnownName]) -> None:
        first = names[0]
        self._wrong = (
            f"{first.label} was set: the controller continues with the value that {first.place} has read before"
        )

    def _check_known(self) -> None:
        """Raise DriverError if the host has set a value that the controller takes as known. Then nothing is sent to the
        controller, so that its session ends (`host_timeout`)."""
        if self._watch is not None and not self._watch.look():
            raise DriverError(f"{self._wrong}; generate the controller again, or set a number in its place")

    def _tell_faults(self, state: ControllerState, mirror: PartMirror) -> None:
        """Report faults of equipment in the part, and a fault of the whole part, which on the controller is the
        machine."""
        assert self._machine is not None and self._part is not None and self._plan is not None
        for part, fault in mirror.new_faults(state):
            self._machine.equipment.contain(part, DriverError(self._plan.fault_text(fault)))
        if state.mode is ControllerMode.FAULTED and not self._contained:
            self._contained = self._machine.equipment.contain(self._part, DriverError(self._fault_text(state)))

    def _start(self, link: LinkHost, mirror: PartMirror) -> None:
        """Start the controller: send it all values of the host, and wait for its answer."""
        deadline = self._deadline()
        mirror.forget()
        if not link.offered:
            link.greet(deadline)
        inhibited = mirror.inhibited()
        link.start(inhibited, mirror.changes(inhibited, link.next_number, all_of_it=True), deadline)

    def _exchange(self) -> None:
        """Send what the host has changed, unless an answer is still awaited."""
        link, mirror = self._connected(), self._mirror
        if mirror is None or self._ends:
            return
        self._check_known()
        link.receive()
        if self._seen is not link.state and link.state is not None:
            self._heard()
        if link.session and link.may_send:
            inhibited = mirror.inhibited()
            link.send(FrameKind.EXCHANGE, inhibited, mirror.changes(inhibited, link.next_number))

    def _fault_text(self, state: ControllerState) -> str:
        if state.mode is ControllerMode.HOST_GONE:
            return "the controller has stopped, because it received nothing from this host in time"
        if state.mode is ControllerMode.RESTING:
            return "the controller was stopped"
        assert self._plan is not None
        return self._plan.fault_text(state.fault, state.fault_object)
