"""The rules that every face keeps, each tried with a client of another project on a machine of the kit."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from umo.clients.faces.conformance.client import ForeignClient, Grade, RefusedByFace, Seen
from umo.clients.faces.conformance.tried_machine import LIMIT, STEP, TriedMachine, finishes, until
from umo.clients.faces.face import Face
from umo.clients.faces.host import FaceHost
from umo.errors import text_of
from umo.objects import Quality
from umo.operation.commands.client_commands import Mode
from umo.operation.commands.roles import EVERYBODY

CHANGE_TIMEOUT = 2.0
"""Time in s within which a change must reach a client (`finishes`)."""
TIME_ERROR = 1.0
"""Largest accepted error of a time in s, in addition to the error of the machine's own clock. It is the interval
between two looks of the host."""
FLOOD = 200
"""Number of commands in the test of a flood."""
RATE = 50.0
"""Number of looks of the host per second."""


@dataclass(frozen=True)
class TriedFace:
    """The face under test."""

    name: str
    make: Callable[[], Face]
    """Returns a new face, on a free port."""
    client: Callable[[Face, str], Awaitable[ForeignClient]]
    """Returns a new client for a user of this name, connected to the server of the face."""
    commands: bool = True
    """True if the protocol has commands."""
    writes: bool = True
    """True if a client may write actuators and jog. The protocol must show whether the client lives."""
    is_named: bool = True
    """True if the protocol transmits the name of the user."""


@dataclass
class Rig:
    """A machine, the face that serves it, and its clients."""

    subject: TriedFace
    machine: TriedMachine
    face: Face
    said: list[str]
    _stack: AsyncExitStack = field(repr=False)

    async def client(self, user: str = "ann") -> ForeignClient:
        """Return a connected client. The rig closes it at the end."""
        client = await self.subject.client(self.face, user)
        self._stack.push_async_callback(client.close)
        return client

    async def sees(self, client: ForeignClient, name: str, condition: Callable[[Seen], bool], what: str) -> Seen:
        """Return the client's view once the condition is true. Raises AssertionError if it is not true within
        `CHANGE_TIMEOUT`."""
        seen = None

        async def look() -> Seen:
            nonlocal seen
            while not condition(now := await client.read(name)):
                seen = now
                await asyncio.sleep(STEP)
            return now

        looking = asyncio.create_task(look())
        if not await finishes(looking, CHANGE_TIMEOUT):
            raise AssertionError(f"{name}: {what} within {CHANGE_TIMEOUT:g} s, but {seen}")
        return looking.result()

    async def told(self, client: ForeignClient, name: str, value: float | str) -> Seen:
        return await self.sees(client, name, lambda seen: seen.value == value, f"the value {value!r}")


@asynccontextmanager
async def rig_of(subject: TriedFace, mode: Mode = Mode.AUTOMATIC, read_only: bool = False) -> AsyncIterator[Rig]:
    async with AsyncExitStack() as stack:
        machine = await stack.enter_async_context(TriedMachine(mode))
        face, said = subject.make(), []  # type: ignore[var-annotated]
        host = FaceHost(
            None,
            [(subject.name, face)],
            rate=RATE,
            read_only=read_only,
            say=said.append,
            find=lambda: machine.find(),
            roles=lambda: EVERYBODY,
        )
        serving = asyncio.create_task(host.run())

        async def end() -> None:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)

        stack.push_async_callback(end)
        clients = await stack.enter_async_context(AsyncExitStack())
        await until(lambda: host.told or serving.done())
        if serving.done():
            serving.result()
        yield Rig(subject, machine, face, said, clients)


Check = Callable[[Rig], Coroutine[Any, Any, None]]


@dataclass(frozen=True)
class FaceRule:
    """One rule. `sentence` states the requirement."""

    name: str
    sentence: str
    check: Check
    mode: Mode = Mode.AUTOMATIC
    read_only: bool = False
    needs: tuple[str, ...] = ()
    """Attributes of the subject without which the rule does not apply."""


RULES: dict[str, FaceRule] = {}


def rule(sentence: str, *needs: str, mode: Mode = Mode.AUTOMATIC, read_only: bool = False) -> Callable[[Check], Check]:
    def keep(check: Check) -> Check:
        name = check.__name__
        RULES[name] = FaceRule(name, sentence, check, mode, read_only, needs)
        return check

    return keep


async def try_rule(subject: TriedFace, rule: FaceRule) -> str | None:
    """Test one rule. Return a text that says how it is broken, None if it is kept, or "" if it does not apply."""
    if not all(getattr(subject, each) for each in rule.needs):
        return ""
    try:
        async with rig_of(subject, rule.mode, rule.read_only) as rig:
            checking = asyncio.create_task(rule.check(rig))
            if not await finishes(checking):
                raise AssertionError(f"the command was not done within {LIMIT:g} s")
            checking.result()
    except Exception as error:
        return f"{rule.sentence} It does not hold: {text_of(error)}"
    return None


@dataclass(frozen=True)
class FaceReport:
    """The results of the rules, by name: None if the rule is kept, "" if it does not apply, otherwise a text that says
    how it is broken."""

    subject: str
    results: Mapping[str, str | None]

    @property
    def broken(self) -> list[str]:
        return [name for name, text in self.results.items() if text]

    @property
    def passed(self) -> bool:
        return not self.broken

    def __str__(self) -> str:
        held = sum(text is None for text in self.results.values())
        return "\n".join(
            [f"{self.subject}: {held} of {len(self.results)} rules", *map(str, filter(None, self.results.values()))]
        )


async def try_face(subject: TriedFace) -> FaceReport:
    """Test a face against every rule."""
    return FaceReport(subject.name, {name: await try_rule(subject, each) for name, each in RULES.items()})


# Values --------------------------------------------------------------------------------------------------


@rule("Every kind of item is read with its value.")
async def kinds(rig: Rig) -> None:
    client = await rig.client()
    expected: Mapping[str, float | str] = {
        "cell.level": 10.0, "cell.limit": "PASS", "cell.valve": 0.0, "cell.lamp": "OFF", "tunable:cell.gain": 1.0,
        "cell.phase": "idle", "alarm:cell.full": "normal", "equipment:cell": "normal", "run:mode": "automatic",
        "alarm:cell.over 90 % (#1)": "normal",
    }  # fmt: skip
    for name, value in expected.items():
        await rig.told(client, name, value)


@rule("A number has its unit and its range, where the protocol has them.")
async def units(rig: Rig) -> None:
    seen = await rig.told(await rig.client(), "cell.level", 10.0)
    assert seen.unit in ("mm", None), f"unit {seen.unit!r}"
    assert (seen.minimum, seen.maximum) in ((0.0, 100.0), (None, None)), f"range {seen.minimum} to {seen.maximum}"


@rule("A change reaches the client.")
async def changes(rig: Rig) -> None:
    client = await rig.client()
    for raw in (40, 60, 20):
        rig.machine.set("cell.level", raw)
        await rig.told(client, "cell.level", raw / 2)
    rig.machine.set("cell.limit", 1)
    await rig.told(client, "cell.limit", "FAIL")


@rule("A named value with more than two states is shown by its name.")
async def states(rig: Rig) -> None:
    from umo.clients.faces.conformance.tried_machine import Phase

    client = await rig.client()
    for phase in (Phase.COOKING, Phase.FILLING):
        rig.machine.m.cell.phase = phase
        await rig.told(client, "cell.phase", phase.name.lower())


@rule("The time of a value is the time at which the device gave it.")
async def times(rig: Rig) -> None:
    client = await rig.client()
    rig.machine.set("cell.level", 44)
    seen = await rig.told(client, "cell.level", 22.0)
    if client.has_times:
        assert seen.time is not None, "the value has no time"
        assert abs(seen.time - time.time()) < TIME_ERROR + CHANGE_TIMEOUT, (
            f"the time is {seen.time - time.time():g} s wrong"
        )


@rule("A value that is not referenced is not shown as good.")
async def unreferenced(rig: Rig) -> None:
    client = await rig.client()
    await rig.sees(client, "cell.position", lambda seen: seen.grade is Grade.DOUBTFUL, "a doubtful value")
    rig.machine.m.cell.position.referenced()
    await rig.sees(client, "cell.position", lambda seen: seen.grade is Grade.GOOD, "a good value")


@rule("A value beyond its range is not shown as good.")
async def out_of_range(rig: Rig) -> None:
    client = await rig.client()
    rig.machine.set("cell.level", 400)
    await rig.sees(client, "cell.level", lambda seen: seen.grade is not Grade.GOOD, "no good value")


@rule("A stale value is not shown as good, and has the time of its last reading.")
async def stale(rig: Rig) -> None:
    client = await rig.client()
    before = await rig.told(client, "cell.level", 10.0)
    rig.machine.set("cell.level", OSError("unplugged"))
    first = await rig.sees(client, "cell.level", lambda seen: seen.grade is not Grade.GOOD, "no good value")
    rig.machine.set("cell.limit", 1)
    await rig.told(client, "cell.limit", "FAIL")
    second = await client.read("cell.level")
    assert second.grade is not Grade.GOOD, f"{second}"
    if client.has_times and first.time is not None and second.time is not None:
        assert second.time - first.time < STEP, "the time of a stale value advances"
    assert before.grade is Grade.GOOD, f"{before}"


@rule("A bad value is shown as missing. When the quality is good again, the value is shown.")
async def bad(rig: Rig) -> None:
    client = await rig.client()
    rig.machine.set("cell.position", OSError("unplugged"))
    await rig.sees(client, "cell.position", lambda seen: seen.grade is Grade.NONE, "no value")
    rig.machine.set("cell.position", 30)
    await rig.sees(client, "cell.position", lambda seen: seen.value == 15.0, "the value 15")


@rule("An alarm and a fault of equipment are reported.")
async def alarms(rig: Rig) -> None:
    client = await rig.client()
    rig.machine.set("cell.level", 190)
    await rig.told(client, "alarm:cell.full", "unacknowledged")
    rig.machine.set("cell.limit", OSError("unplugged"))
    await rig.told(client, "equipment:cell", "fault")


# Ends ----------------------------------------------------------------------------------------------------


@rule("If the machine sends no frames, no value is shown as good.")
async def silence(rig: Rig) -> None:
    client = await rig.client()
    await rig.sees(client, "cell.level", lambda seen: seen.grade is Grade.GOOD, "a good value")
    rig.machine.goes_on = False
    await rig.sees(client, "cell.level", lambda seen: seen.grade is not Grade.GOOD, "no good value")


@rule("When the run has ended, no value is shown as good. With the next run all values return.")
async def ends(rig: Rig) -> None:
    client = await rig.client()
    names = ("cell.level", "cell.limit", "tunable:cell.gain", "cell.phase", "run:mode")
    for name in names:
        await rig.sees(client, name, lambda seen: seen.grade is Grade.GOOD, "a good value")
    await rig.machine.end()
    for name in names:
        await rig.sees(client, name, lambda seen: seen.grade is not Grade.GOOD, "no good value")
    rig.machine.set("cell.level", 70)
    rig.machine.begin()
    await rig.told(client, "cell.level", 35.0)


# Commands ------------------------------------------------------------------------------------------------


async def refused(work: Awaitable[Any], client: ForeignClient, *words: str) -> None:
    """Check that a command is refused with this text."""
    try:
        await work
    except RefusedByFace as refusal:
        for word in words if client.has_words else ():
            assert word in str(refusal), f"the refusal is {str(refusal)!r}, which does not contain {word!r}"
    else:
        raise AssertionError("the command was not refused")


@rule("A tunable number is set.", "commands")
async def tunes(rig: Rig) -> None:
    client = await rig.client()
    await client.tune("cell.gain", 2.5)
    assert rig.machine.m.cell.gain == 2.5, f"the number is {rig.machine.m.cell.gain}"
    await rig.told(client, "tunable:cell.gain", 2.5)


@rule("A command that the machine refuses is answered with the machine's reason, and changes nothing.", "commands")
async def refusals(rig: Rig) -> None:
    client = await rig.client()
    await refused(client.tune("cell.gain", 11.0), client, "11")
    await refused(client.tune("cell.gain", float("nan")), client)
    await refused(client.call("cell.add", {"weight": 7.0}), client, "7")
    assert rig.machine.m.cell.gain == 1.0, f"the number is {rig.machine.m.cell.gain}"


@rule("An action is called with its arguments, and returns its result.", "commands")
async def calls(rig: Rig) -> None:
    client = await rig.client()
    result = await client.call("cell.add", {"weight": 1.5})
    assert result in (3.0, None), f"the result is {result!r}"
    assert any(each.path == "cell.add" for each in rig.machine.events), "the command did not reach the machine"


@rule("The events of the machine name the user of a command. A name that is not proved is marked.", "commands")
async def users(rig: Rig) -> None:
    for name, value in (("ann", 2.0), ("bob", 3.0)):
        await (await rig.client(name)).tune("cell.gain", value)
    who = [each.who for each in rig.machine.events if each.path == "cell.gain"]
    for name, told in zip(("ann", "bob"), who, strict=True):
        assert not rig.subject.is_named or told.startswith(name), f"the event names {told!r} instead of {name}"
        assert rig.face.proves_users or "unverified" in told, f"{told!r} is not marked as unverified"


@rule("A face that only reads refuses every command.", "commands", read_only=True)
async def read_only(rig: Rig) -> None:
    client = await rig.client()
    await rig.told(client, "cell.level", 10.0)
    await refused(client.tune("cell.gain", 2.0), client)
    await refused(client.call("cell.add", {"weight": 1.0}), client)
    assert rig.machine.m.cell.gain == 1.0, "the number was set"
    assert not rig.machine.holder, "the face has taken the lease"


@rule("An actuator is written in manual mode only.", "commands", "writes")
async def manual(rig: Rig) -> None:
    client = await rig.client()
    await refused(client.write("cell.valve", 5.0), client, "manual mode")
    await client.mode("manual")
    await client.write("cell.valve", 5.0)
    await rig.told(client, "cell.valve", 5.0)


@rule("A written value is held as long as its client is alive.", "commands", "writes", mode=Mode.MANUAL)
async def held(rig: Rig) -> None:
    client, other = await rig.client(), await rig.client("bob")
    await client.write("cell.valve", 5.0)
    number = rig.machine.number
    await until(lambda: rig.machine.number > number + 200)  # 1 s: twice the dead-man time
    assert rig.machine.m.cell.valve.read() == 5.0, "the written value was released"
    await client.kill()
    await until(lambda: rig.machine.m.cell.valve.read() == 0.0, 10.0)
    await rig.told(other, "cell.valve", 0.0)


@rule(
    "A dead-man command is refused if the protocol does not show whether its client is alive.",
    "commands",
    mode=Mode.MANUAL,
)
async def kept_up(rig: Rig) -> None:
    if rig.subject.writes:
        return
    client = await rig.client()
    await refused(client.write("cell.valve", 5.0), client)
    await refused(client.call("cell.jog", {"velocity": 5.0}), client)
    assert rig.machine.m.cell.valve.read() == 0.0, "the valve was written"


@rule("Two clients command at the same time, and each gets its own answer.", "commands")
async def together(rig: Rig) -> None:
    clients = [await rig.client(name) for name in ("ann", "bob")]
    results = await asyncio.gather(*(client.call("cell.add", {"weight": 1.0 + n}) for n, client in enumerate(clients)))
    assert results in ([2.0, 4.0], [None, None]), f"the results are {results}"


@rule(
    "Many commands from one client do not delay the other clients for long, and each command is answered.", "commands"
)
async def flood(rig: Rig) -> None:
    client, other = await rig.client(), await rig.client("bob")
    answers = await asyncio.gather(
        *(client.tune("cell.gain", 1.0 + n % 8) for n in range(FLOOD)), return_exceptions=True
    )
    wrong = [each for each in answers if each is not None and not isinstance(each, RefusedByFace)]
    assert not wrong, f"{wrong[0]!r}"
    rig.machine.set("cell.level", 80)
    await rig.told(other, "cell.level", 40.0)
    await other.tune("cell.gain", 9.0)


@rule("A client that ends without closing its connection does not disturb the others.")
async def killed_client(rig: Rig) -> None:
    client, other = await rig.client(), await rig.client("bob")
    await rig.told(client, "cell.level", 10.0)
    await client.kill()
    rig.machine.set("cell.level", 30)
    await rig.told(other, "cell.level", 15.0)


@rule("A command to an item that does not exist is refused, and affects no other command.")
async def unknown(rig: Rig) -> None:
    client = await rig.client()
    seen = await client.read("cell.nothing")
    assert seen.grade is Grade.NONE, f"{seen}"
    if rig.subject.commands:
        await refused(client.tune("cell.nothing", 1.0), client)
        await refused(client.call("cell.nothing", {}), client)
    await rig.told(client, "cell.level", 10.0)


@rule("The quality of every item is shown as the grade of the protocol that corresponds to it.")
async def qualities(rig: Rig) -> None:
    client = await rig.client()
    await rig.told(client, "cell.level", 10.0)
    for item in rig.machine.connection.image.items:
        if item.path == "timer":
            continue
        seen = await client.read(item.path)
        good = item.quality is Quality.GOOD
        assert (seen.grade is Grade.GOOD) == good, f"{item.path} is {item.quality}, and seen as {seen.grade.value}"
