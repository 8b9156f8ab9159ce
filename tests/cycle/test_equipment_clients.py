"""Equipment and clients: actions, held actuators, modes and interlocks in a fault, and `clear`."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

from helpers.machines import actuator, relay, sensor, timer, wired
from helpers.reactors import (
    AT_DEFAULT,
    DRIVEN,
    Commanded,
    Plant,
    Reactor,
    Rig,
    Valve,
    driven,
    fail_law,
    fail_sensor,
    failing,
    reactor,
    run_both,
)
from helpers.telling import concerned
from umo import (
    Compound,
    DigitalSensor,
    Interlock,
    Range,
    TaskFailed,
    Vector,
    action,
    connect,
)
from umo.control import ServoAxis, next_period, unless, wait
from umo.cycle.events import CommandState
from umo.cycle.journal import ENTRY, Journal, Kind
from umo.errors import AxisError, DeclarationError, DriverError, EquipmentFault, Interlocked
from umo.operation.commands.client_commands import ClientCommand, Mode
from umo.states import OnOff
from umo.testing import Scripted


class Operated(Reactor, equipment=True):
    @action
    async def drain_it(self) -> None:
        """Drain."""
        self.drain.write(OnOff.ON)
        await wait(1.0)

    @action(harmless=True)
    def count(self) -> int:
        """Periods."""
        return self.acted

    @action(harmless=True)
    async def measure(self) -> float:
        """Temperature after a while."""
        await wait(1.0)
        return self.thermometer.read()


def test_a_client_clears_a_fault_in_automatic_mode() -> None:
    with Commanded() as rig:
        rig.m.a.cycle.start(failing())
        rig.periods(1)
        assert rig.do("clear", "a.heater") == ("done", '"cleared: a"')
        assert rig.m.a.cycle.fault is None
        assert rig.do("clear") == ("done", '"nothing was in fault"')


class Hot(Reactor, equipment=True):
    """Its heater latches, its stirrer waits."""

    hot = waits = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.hot, [self.heater], "over-temperature", latched=True)
        yield Interlock(lambda: self.waits, [self.stirrer, self.heater], "the lid is open")


def test_a_client_that_clears_a_fault_is_told_which_interlocks_still_inhibit_its_actuators() -> None:
    with Commanded(a=reactor(Hot), b=reactor(Hot)) as rig:
        a, b = rig.m.a, rig.m.b
        a.cycle.start(failing())
        a.hot, a.waits, b.waits = True, True, True
        rig.periods(2)
        still = "cleared: a; still inhibited: over-temperature"
        assert rig.do("clear", "a.drain") == ("done", f'"{still}; the lid is open"')
        a.hot, a.waits = False, False
        a.cycle.start(failing())
        rig.periods(2)
        assert rig.do("clear") == ("done", f'"{still} (latched: acknowledge it)"')
        assert rig.do("clear", "a.drain") == ("done", '"nothing was in fault"')
        assert rig.do("clear", "b") == ("done", '"nothing was in fault; still inhibited: the lid is open"')
        rig.do("acknowledge", "a")
        a.cycle.start(failing())
        rig.periods(2)
        assert rig.do("clear", "a") == ("done", '"cleared: a"')


def test_an_interlock_that_begins_in_a_fault_is_told_when_the_fault_ends_if_it_still_inhibits() -> None:
    with Rig(a=reactor(Hot), b=reactor(Hot)) as rig:
        a, journal = rig.m.a, Journal(100)
        a.cycle.start(failing())
        rig.periods(1)
        a.hot = a.waits = True
        rig.periods(1)
        a.waits = False
        rig.periods(1)
        a.hot = False
        rig.periods(1)
        assert [text for text in rig.texts if "inhibited" in text] == []
        rig.connection.image.transfer.journal = journal
        a.cycle.clear()
        entries = [ENTRY.unpack_from(journal.buffer, ENTRY.size * number) for number in range(journal.count)]
        noted = [(slot, kind) for slot, kind, *_ in entries]
        told = "a.heater: inhibited: over-temperature (latched: acknowledge it)"
        assert rig.texts[-2:] == [told, "a: fault cleared"]
        heater, stirrer = (rig.connection.image.slot_of[id(each)] for each in (a.heater, a.stirrer))
        assert (heater, Kind.INTERLOCKED) in noted
        assert (stirrer, Kind.INTERLOCKED) not in noted
        a.cycle.start(failing())
        rig.periods(2)
        a.cycle.clear()
        assert rig.texts.count(told) == 1


def test_a_latched_interlock_whose_condition_is_still_true_when_the_fault_ends_is_to_be_acknowledged() -> None:
    with Rig(a=reactor(Hot), b=reactor(Hot)) as rig:
        a = rig.m.a
        a.cycle.start(failing())
        rig.periods(1)
        a.hot = True
        rig.periods(1)
        a.cycle.clear()
        rig.periods(2)
        assert [text for text in rig.texts if "inhibited" in text] == [
            "a.heater: inhibited until acknowledged: over-temperature"
        ]


def test_an_interlock_that_began_before_the_fault_is_told_once() -> None:
    with Rig(a=reactor(Hot), b=reactor(Hot)) as rig:
        a = rig.m.a
        a.waits = True
        rig.periods(1)
        a.cycle.start(failing())
        rig.periods(2)
        a.cycle.clear()
        rig.periods(2)
        (told,) = [text for text in rig.texts if "the lid is open" in text]
        assert told == "a: the lid is open: 2 actuators inhibited: a.heater and a.stirrer"


class Strict(Reactor, equipment=True):
    """To write its heater while it is hot is a program error."""

    hot = False

    def interlocks(self) -> Iterator[Interlock]:
        yield Interlock(lambda: self.hot, [self.heater], "too hot", effect="stop")


def test_a_write_in_a_fault_is_refused_and_raises_nothing_whatever_interlock_inhibits_as_well() -> None:
    with Rig(a=reactor(Strict), b=reactor(Strict)) as rig:
        a, b = rig.m.a, rig.m.b
        both = Vector([a.heater, b.heater])
        a.cycle.start(failing())
        a.hot = True
        rig.periods(2)
        assert a.heater.write(1.0) is False
        assert both.write([1.0, 2.0]) is False
        rig.periods(1)
        assert both.read().tolist() == [0.0, 2.0]
        a.cycle.clear()
        with pytest.raises(Interlocked, match="too hot"):
            a.heater.write(1.0)


def test_a_client_is_told_why_a_fault_cannot_be_cleared() -> None:
    with Commanded() as rig:
        fail_sensor(rig)
        rig.periods(1)
        state, text = rig.do("clear", "a")
        assert state == "refused"
        assert text == "EquipmentFault: a is in fault: the fault cannot be cleared while a.thermometer cannot be read"


def test_an_action_of_equipment_that_comes_into_fault_ends_and_another_is_refused() -> None:
    with Commanded(Mode.MANUAL, a=reactor(Operated)) as rig:
        assert rig.do("call", "a.drain_it")[0] == "begun"
        number = rig.number
        rig.periods(2)
        assert rig.m.a.drain.read() is OnOff.ON
        fail_sensor(rig)
        rig.periods(2)
        state, text = rig.answer(number)
        assert (state, "a is in fault" in text, rig.m.a.drain.read()) == ("cancelled", True, OnOff.OFF)
        assert rig.do("call", "a.drain_it")[0] == "refused"
        assert rig.do("call", "a.count")[0] == "done"
        assert rig.do("call", "a.measure") == ("refused", f"EquipmentFault: a is in fault: {rig.m.a.cycle.fault}")


def test_a_sequence_that_an_action_of_another_part_has_started_in_equipment_ends_with_its_fault() -> None:
    class Both(Plant):
        @action
        def start_both(self) -> None:
            """Heat."""
            for each in (self.a, self.b):
                each.cycle.start(each.heat())

    m = Both(timer=timer(), lamp=relay(), level=sensor(), a=reactor(), b=reactor())
    with Commanded(Mode.MANUAL, machine=m) as rig:
        rig.do("call", "start_both")
        rig.periods(3)
        assert (m.a.heater.read(), m.b.heater.read()) == (5.0, 5.0)
        fail_sensor(rig)
        rig.periods(3)
        assert (m.a.heater.read(), m.a.cleaned, m.b.heater.read(), m.b.cleaned) == (0.0, 1, 5.0, 0)


def test_a_clients_write_that_a_device_refuses_is_refused_and_a_fault_of_its_equipment() -> None:
    with Commanded(Mode.MANUAL) as rig:
        rig.boxes["of_a"].at(len(rig.boxes["of_a"].calls) + 1, OSError("short circuit"))  # after read_many
        state, text = rig.do("write", "a.drain", value="ON")
        assert (state, text) == ("refused", "CommandRefused: a.drain is inhibited: a is in fault")
        rig.periods(3)
        assert rig.answer(rig.number) == (state, text)  # and nothing else later
        assert "short circuit" in (rig.m.a.cycle.fault or "")


class Cooking(Reactor, equipment=True):
    @action
    async def cook(self) -> None:
        """Drive the heater, and a valve."""
        while True:
            self.heater.write(5.0)
            self.drain.write(OnOff.ON)
            await next_period()

    @action
    async def heat_it(self) -> None:
        """Heat."""
        await self.heat()

    @action
    def begin(self) -> None:
        """Heat in a sequence that nobody awaits; then drive a valve."""
        self.cycle.start(self.heat())
        self.drain.write(OnOff.ON)

    @action(velocity=Range("rpm", 0.0, 9.0), release="let_go")
    def stir(self, velocity: float) -> None:
        """Stir."""
        self.stirrer.write(velocity)

    def let_go(self) -> None:
        self.stirrer.write(0.0)

    async def on_resume(self) -> None:
        for _ in range(20):
            self.heater.write(3.0)
            await next_period()


@pytest.mark.parametrize("name", ["cook", "begin"])
def test_an_action_whose_own_write_puts_its_equipment_in_fault_has_ended_also_after_clear(name: str) -> None:
    with Commanded(Mode.MANUAL, a=reactor(Cooking)) as rig:
        box = rig.boxes["of_a"]
        box.at(len(box.calls) + 1, OSError("the coil is broken"))  # after read_many
        rig.do("call", f"a.{name}")
        rig.periods(2)
        assert "the coil is broken" in (rig.m.a.cycle.fault or "")
        told = [each for each in rig.connection.machine.events if each.command == rig.number]
        assert str(told[-1].state) in ("refused", "cancelled")
        rig.do("clear", "a")
        rig.periods(3)
        assert driven(rig.m.a) == AT_DEFAULT


def test_what_a_client_keeps_up_in_equipment_ends_with_its_fault() -> None:
    with Commanded(Mode.MANUAL, a=reactor(Cooking)) as rig:
        assert rig.do("call", "a.stir", arguments={"velocity": 2.0})[0] == "done"
        number = rig.number
        fail_sensor(rig)
        rig.periods(2)
        assert rig.answer(number)[0] == "cancelled"
        assert "a is in fault" in rig.answer(number)[1]


class Watched(Plant):
    @action
    async def watch(self) -> None:
        """Open the drain of a at the end."""
        try:
            await wait(10.0)
        finally:
            self.a.drain.write(OnOff.ON)


@pytest.mark.parametrize("end", ["give back", "cancel", "mode"])
@pytest.mark.parametrize(
    ("other", "arguments"), [("heat_it", {}), ("stir", {"velocity": 2.0})], ids=["running", "held"]
)
def test_an_action_that_a_fault_has_ended_while_others_are_cancelled_is_ended_once(
    end: str, other: str, arguments: dict[str, Any]
) -> None:
    m = Watched(timer=timer(), lamp=relay(), level=sensor(), a=reactor(Cooking), b=reactor())
    with Commanded(Mode.MANUAL, machine=m) as rig:
        box = rig.boxes["of_a"]
        rig.do("call", "watch")
        assert rig.do("call", f"a.{other}", arguments=arguments)[0] in ("begun", "done")
        number = rig.number
        rig.periods(2)
        box.at(len(box.calls) + 1, OSError("the coil is broken"))  # after read_many
        assert rig.do(end, value="automatic" if end == "mode" else None)[0] == "done"
        assert "the coil is broken" in (m.a.cycle.fault or "")
        ends = [event for event in rig.connection.machine.events if event.command == number and "fault" in event.text]
        assert [str(event.state) for event in ends] == ["cancelled"]
        rig.periods(2)
        assert driven(m.a) == AT_DEFAULT


class Drained(Reactor, equipment=True):
    @action(release="rest")
    def open_it(self) -> None:
        """Open something."""

    @action(release="rest")
    def open_more(self) -> None:
        """Open something else."""

    def rest(self) -> None:
        self.drain.write(OnOff.ON)


@pytest.mark.parametrize("signs", [{}, {"": (1, 9.0)}], ids=["the lease ends", "only what is held ends"])
def test_a_client_that_dies_holding_two_actions_ends_each_once_if_the_first_release_fails(
    signs: dict[str, tuple[int, float]],
) -> None:
    with Commanded(Mode.MANUAL, a=reactor(Drained)) as rig:
        rig.do("call", "a.open_it")
        rig.do("call", "a.open_more")
        rig.now, rig.letters.signs = 9.0, signs
        rig.boxes["of_a"].at(len(rig.boxes["of_a"].calls) + 1, OSError("the coil is broken"))  # after read_many
        rig.periods(3)
        assert "the coil is broken" in (rig.m.a.cycle.fault or "")
        events = rig.connection.machine.events
        ended = [event for event in events if event.state is CommandState.CANCELLED]
        assert concerned(ended) == ["a.open_it", "a.open_more"]
        assert not [event.text for event in events if "could not be released" in event.text]
        assert driven(rig.m.a) == AT_DEFAULT
        assert rig.m.b.acted == rig.m.a.acted + 3  # it goes on


class FlushedValve(Valve, equipment=True):
    def setup(self) -> None:
        self.at_end = lambda: None

    @action
    async def watch(self) -> None:
        """Do something at the end."""
        try:
            await wait(10.0)
        finally:
            self.at_end()

    @action
    async def turn(self) -> None:
        """Wait."""
        await wait(10.0)


def test_a_fault_of_the_outer_equipment_while_the_actions_of_the_inner_end_ends_each_once() -> None:
    with Commanded(Mode.MANUAL, a=reactor(outlet=FlushedValve(coil=relay()))) as rig:
        a: Any = rig.m.a
        a.outlet.at_end = lambda: a.drain.write(OnOff.ON)
        rig.do("call", "a.outlet.watch")
        rig.do("call", "a.outlet.turn")
        rig.boxes["of_a"].at(len(rig.boxes["of_a"].calls) + 1, OSError("the coil is broken"))
        assert rig.connection.machine.equipment.contain(a.outlet, ValueError("it is stuck"))
        assert "it is stuck" in a.outlet.cycle.fault
        rig.periods(2)
        assert (a.outlet.cycle.fault, a.cycle.fault is not None) == ("ValueError: it is stuck", True)
        ended = [each.path for each in rig.connection.machine.events if each.state is CommandState.CANCELLED]
        assert sorted(ended) == ["a.outlet.turn", "a.outlet.watch"]


def test_on_resume_of_equipment_that_comes_into_fault_has_ended_also_after_clear() -> None:
    with Commanded(Mode.AUTOMATIC, a=reactor(Cooking)) as rig:
        rig.m.b.cycle.start(rig.m.b.heat())
        rig.do("mode", value="manual")
        rig.do("mode", value="automatic")
        rig.periods(3)
        assert rig.m.a.heater.read() == 3.0
        fail_law(rig)
        rig.periods(1)
        rig.m.a.law = None
        assert rig.do("clear", "a")[0] == "done"
        rig.periods(3)
        assert rig.m.a.heater.read() == 0.0


def test_an_on_resume_of_equipment_that_fails_is_a_fault_of_it_and_the_others_go_on() -> None:
    with Commanded(Mode.AUTOMATIC, a=reactor(Cooking)) as rig:
        rig.m.b.cycle.start(rig.m.b.heat())
        rig.do("mode", value="manual")
        box = rig.boxes["of_a"]
        box.at(len(box.calls) + 3, OSError("the coil is broken"))  # a write of on_resume
        rig.do("mode", value="automatic")
        rig.periods(25)
        assert "the coil is broken" in (rig.m.a.cycle.fault or "")
        assert (rig.answer(rig.number)[0], rig.m.b.cycle.fault) == ("done", None)


class Refusing(Cooking):
    """Its `on_resume` raises."""

    async def on_resume(self) -> None:
        raise TaskFailed("the door is open")


def test_an_on_resume_of_equipment_that_raises_is_a_fault_of_it_and_the_others_go_on() -> None:
    with Commanded(Mode.AUTOMATIC, a=reactor(Refusing)) as rig:
        rig.m.b.cycle.start(rig.m.b.heat())
        rig.do("mode", value="manual")
        rig.do("mode", value="automatic")
        rig.periods(3)
        assert rig.m.a.cycle.fault == "the door is open"
        assert (rig.answer(rig.number)[0], rig.m.b.cycle.fault) == ("done", None)
        assert rig.m.b.heater.read() == 5.0


def test_a_lease_that_ends_after_a_fault_frees_nothing_of_it() -> None:
    with Commanded(Mode.MANUAL) as rig:
        rig.do("write", "a.heater", value=5.0)
        fail_law(rig)
        rig.periods(1)
        rig.do("give back")
        rig.periods(2)
        assert (rig.m.a.heater.write(5.0), rig.m.a.heater.inhibited) == (False, "a is in fault")


def test_a_write_that_fails_and_a_release_in_the_same_period_free_nothing_of_the_fault() -> None:
    with Commanded(Mode.MANUAL) as rig:
        rig.do("write", "a.heater", value=5.0)
        box = rig.boxes["of_a"]
        box.at(len(box.calls) + 1, OSError("the coil is broken"))
        rig.letters.waiting.append(ClientCommand(90, "ann", "key", "write", "a.drain", "ON"))
        rig.letters.waiting.append(ClientCommand(91, "ann", "key", "let go", "a.heater"))
        rig.letters.signs = dict.fromkeys(("", "a.drain", "a.heater"), (1, 1.0))
        rig.periods(2)
        assert rig.m.a.cycle.fault is not None
        assert rig.m.a.heater.write(5.0) is False


def test_an_actuator_that_is_taken_and_released_many_times_is_free_for_the_program() -> None:
    with Commanded(Mode.MANUAL) as rig:
        for _ in range(3):
            rig.do("write", "a.heater", value=5.0)
            rig.do("let go", "a.heater")
        assert rig.m.a.heater.write(1.0)
        rig.periods(1)
        assert rig.m.a.heater.read() == 1.0


def test_what_a_client_holds_ends_with_a_fault_and_says_why() -> None:
    with Commanded(Mode.MANUAL) as rig:
        assert rig.do("write", "a.stirrer", value=3.0)[0] == "done"
        number = rig.number
        rig.periods(1)
        assert rig.m.a.stirrer.read() == 3.0
        fail_sensor(rig)
        rig.periods(2)
        assert (rig.answer(number), rig.m.a.stirrer.read()) == (("cancelled", "a is in fault"), 0.0)
        assert rig.do("write", "a.stirrer", value=3.0) == (
            "refused",
            "CommandRefused: a.stirrer is inhibited: a is in fault",
        )


class Slide(Compound):
    timer: DigitalSensor
    x: ServoAxis


def slide(kind: type[ServoAxis] = ServoAxis, **changes: Any) -> Slide:
    """Its motor moves nothing."""
    limits = {"velocity": 50.0, "acceleration": 500.0, "jerk": 1e4, "window": 1.0, "following_error": 0.5}
    axis = kind(motor=actuator(), encoder=sensor(minimum=-100.0), gain=0.1, **(limits | changes))
    return Slide(timer=timer(), x=axis)


def test_an_axis_that_does_not_follow_in_manual_mode_is_in_fault_alone() -> None:
    m = slide()
    with Commanded(Mode.MANUAL, machine=m) as rig:
        assert rig.do("call", "x.move_to", arguments={"position": 40.0})[0] == "begun"
        number = rig.number
        rig.periods(100)
        assert "x does not follow" in (m.x.cycle.fault or "")
        assert rig.answer(number)[0] in ("failed", "cancelled")
        assert "x is in fault: x does not follow" in rig.answer(number)[1]
        assert rig.do("call", "x.jog", arguments={"velocity": 5.0})[0] == "refused"
        assert rig.do("clear", "x")[1] == '"cleared: x"'
        assert rig.do("call", "x.move_to", arguments={"position": 0.0})[0] == "begun"


def test_an_axis_in_fault_that_refuses_a_motion_leaves_nothing_that_only_the_collector_would_free() -> None:
    class Alone(ServoAxis, equipment=True): ...

    m, refused = slide(Alone), []

    async def move() -> None:
        while True:
            try:
                await m.x.move_to(40.0)
            except EquipmentFault as error:
                refused.append(weakref.ref(error))
            await next_period()

    with Commanded(machine=m) as rig:
        rig.connection.machine.equipment.contain(m.x, ValueError("it is stuck"))
        m.cycle.start(move())
        gc.disable()
        try:
            rig.periods(3)
            assert [each() for each in refused] == [None] * 3
        finally:
            gc.enable()


class Braked(ServoAxis):
    """An axis of a machine, whose brake does not answer."""

    def disable(self) -> None:
        if self.enabled and self.cycle.running:
            raise ValueError("the brake did not answer")


@pytest.mark.parametrize("motion", ["jog", "move_to"])
def test_an_axis_in_fault_that_cannot_be_disabled_is_not_controlled_after_clear(motion: str) -> None:
    m = slide(Braked)
    with Commanded(Mode.MANUAL, machine=m) as rig:
        rig.do("call", f"x.{motion}", arguments={"jog": {"velocity": 5.0}, "move_to": {"position": 40.0}}[motion])
        rig.periods(1)
        assert m.x.enabled
        rig.connection.machine.equipment.contain(m.x, ValueError("it is stuck"))
        assert any("the brake did not answer" in text for text in rig.texts)
        assert (m.x.enabled, m.x.motor.read()) == (False, 0.0)
        rig.do("clear", "x")
        rig.periods(3)
        assert (m.x.cycle.fault, m.x.enabled, m.x.motor.read()) == (None, False, 0.0)
        assert rig.do("call", "x.move_to", arguments={"position": 0.0})[0] == "begun"


def test_automatic_mode_is_refused_while_an_axis_is_in_fault() -> None:
    m = slide()
    with Commanded(Mode.MANUAL, machine=m) as rig:
        rig.do("call", "x.move_to", arguments={"position": 40.0})
        rig.periods(100)
        state, text = rig.do("mode", value="automatic")
        assert state == "refused"
        assert "the application cannot continue: x is in fault: x does not follow" in text
        assert text.endswith("; clear it, or stop the run")
        rig.do("clear", "x")
        assert rig.do("mode", value="automatic")[0] == "done"


def test_what_ended_by_a_fault_in_manual_mode_is_not_driven_again_in_automatic_mode() -> None:
    with Commanded(Mode.AUTOMATIC) as rig:
        run_both(rig)
        rig.do("mode", value="manual")
        rig.periods(2)
        assert [driven(each) for each in (rig.m.a, rig.m.b)] == [AT_DEFAULT] * 2
        fail_sensor(rig)
        rig.periods(2)
        rig.boxes["of_a"].set("a.thermometer", 50)
        rig.periods(1)
        rig.do("clear", "a")
        assert rig.do("mode", value="automatic")[0] == "done"
        rig.periods(3)
        assert (driven(rig.m.a), driven(rig.m.b)) == (AT_DEFAULT, DRIVEN)


def test_a_fault_in_the_period_of_a_change_to_manual_mode_keeps_its_laws_from_acting() -> None:
    with Commanded(Mode.AUTOMATIC) as rig:
        run_both(rig)
        fail_law(rig)
        rig.do("mode", value="manual")
        acted, others = rig.m.a.acted, rig.m.b.acted
        rig.periods(3)
        assert (rig.m.a.acted, rig.m.b.acted) == (acted, others + 3)
        assert driven(rig.m.a) == AT_DEFAULT


def test_an_axis_that_does_not_follow_in_automatic_mode_ends_the_run() -> None:
    m = slide()
    with pytest.raises(AxisError, match="does not follow"), Commanded(Mode.AUTOMATIC, machine=m) as rig:
        m.cycle.start(m.x.move_to(40.0))
        rig.periods(100)


def test_an_axis_that_its_machine_declares_equipment_fails_alone_in_automatic_mode_too() -> None:
    class Table(ServoAxis, equipment=True):
        pass

    told: list[str] = []

    async def main(m: Slide) -> str:
        try:
            await m.x.move_to(40.0)
        except TaskFailed as error:
            told.append(f"{type(error).__name__}: {error}")
        m.x.cycle.clear()
        await m.x.move_to(0.0)  # where it stands
        return "went on"

    m = slide(Table)
    with Commanded(machine=m) as rig:
        task = m.cycle.start(main(m))
        rig.periods(150)
    assert len(told) == 1
    assert told[0].startswith("EquipmentFault: x is in fault: x does not follow")
    assert task.result == "went on"


def test_a_motion_that_does_not_arrive_is_a_fault_of_its_axis() -> None:
    class Table(ServoAxis, equipment=True):
        pass

    m = slide(Table, following_error=1e9, settling_time=0.05)
    with Commanded(machine=m) as rig:
        m.cycle.start(catching(m.x.move_to(0.5, duration=0.0)))
        m.x.window = 0.1
        rig.periods(1200)
        assert "did not arrive" in (m.x.cycle.fault or "")
        assert not m.x.enabled


async def catching(motion: Any) -> None:
    with suppress(TaskFailed):
        await motion


# Declaration ----------------------------------------------------------------------------------------------


def test_a_value_of_equipment_that_there_is_not_is_a_mistake() -> None:
    with pytest.raises(DeclarationError, match=r'equipment is True, False or "manual", not'):

        class Wrong(Compound, equipment="sometimes"):  # type: ignore[arg-type]
            pass


def test_the_machine_is_equipment_without_saying_so() -> None:
    class Sole(Compound, equipment=True):
        timer: DigitalSensor
        level: DigitalSensor

    m, box = Sole(timer=timer(), level=sensor()), Scripted()
    with pytest.raises(DriverError), connect(m, wired(m, box)):
        box.set("level", OSError("gone"))
        m.timer.read()
        m.sample()


class Local:
    """Something whose life can be observed."""


def test_a_failure_whose_awaiter_is_cancelled_in_the_same_period_is_a_fault_and_keeps_nothing_alive() -> None:
    alive: weakref.WeakSet[Local] = weakref.WeakSet()

    async def failing() -> None:
        local = Local()
        alive.add(local)
        await next_period()
        raise TaskFailed(f"the valve of {type(local).__name__} sticks")

    async def parent(part: Reactor) -> None:
        task = part.cycle.start(failing())

        async def waiting() -> None:
            await task

        asked = iter(range(3))
        await unless(lambda: next(asked, None) is None, waiting())

    gc.disable()
    try:
        with Rig() as rig:
            rig.m.a.cycle.start(parent(rig.m.a))
            rig.periods(9)
            assert rig.texts == ["a: in fault: the valve of Local sticks"]
            assert not alive
    finally:
        gc.enable()
