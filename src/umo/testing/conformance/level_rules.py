"""A rule about levels: only a write changes an output."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from time import sleep

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.pulses import Writes, known_writes
from umo.testing.conformance.rule_context import DriverCall, RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.spoiling import rewrite
from umo.testing.conformance.subject import Output
from umo.text import some

TRIES = 2
"""Number of repetitions in which an output must move every time. There are several because a watchdog of the device may
run out at the same time."""
LOOK_INTERVAL = 0.005
"""Time in s between two looks. It is a period."""
MOST_LOOKS = 20
"""Largest number of looks while the device does not answer, and after it answers again."""
OTHER_LEVEL = 2
"""Number of the level that another client writes. It differs from that of the driver."""
FEWEST_OUTPUTS = 1
"""Smallest number of outputs whose requests are distinguished from other requests."""
Happening = Callable[[RuleContext, "Witness", int], object]
"""Function that makes the driver connect again, or look for its device. Its argument is the number of the levels."""


@rule(Cost(opens=2, each=4, calls=110, connects=10, waits=6, sleeps=0.3))
def levels_kept(context: RuleContext) -> str | None:
    """Only a write changes an output. The output keeps its level when the driver connects again, after a lost
    connection, a timeout, a garbled answer or an error answer, and while the driver looks for its device. After the
    device itself was away, the driver may bring outputs to their defaults, because the device has lost their levels."""
    if not context.subject.outputs:
        raise NotTried("the driver has no outputs")
    happenings = _happenings(context)
    with context.opened() as probe, context.second(direct=True) as other:
        witness = Witness(context, probe, other)
        if not witness.watched:
            raise NotTried("no level can be seen independently: this needs a record of levels, or a loop-back and a "
            "second client, or write requests that the tap recognises")  # fmt: skip
        for what, happening in happenings.items():
            for left in reversed(range(TRIES)):
                if not (moved := _moved(context, witness, happening, left)):
                    break
            else:
                raise RuleBroken(f"{moved}, after {what}, although no client has written it")
    return witness.remark


def _happenings(context: RuleContext) -> Mapping[str, Happening]:
    """Return the events that may precede the next call, by their names."""
    context.loss  # noqa: B018  NotTried
    found: dict[str, Happening] = {"the device was away": _away}
    if (line := context.subject.line) is not None:
        found["a lost connection"] = lambda *_: line.drop()
        found |= {"a timeout": _in_vain, "a garbled answer": _garbled, "a look": _looked}
    if context.subject.refused:
        found["an error answer"] = _refused
    return found


def _moved(context: RuleContext, witness: Witness, happening: Happening, number: int) -> str:
    """Return what has moved, as text; empty if nothing has."""
    probe, witness.seen, witness.lost = witness.probe, "", happening is _away
    for place, output in enumerate(context.subject.outputs):
        rewrite(context, probe, output, output.other(number + place), "what was tried before")
    context.await_levels(probe)
    happening(context, witness, number)
    witness.write(context.subject.outputs[0], number + OTHER_LEVEL)
    probe.timeout = context.patience
    for call in _harmless(context, probe, number) * 2:  # the first may find the end of the connection
        with witness.looking():
            context.failure(call)
    return witness.seen


def _harmless(context: RuleContext, probe: Probe, number: int) -> list[DriverCall]:
    """Return calls that move nothing: for a driver without inputs a write of the present level."""
    if context.readable:
        return [partial(probe.read, context.readable[0]), partial(probe.read_many, context.readable)]
    first = context.subject.outputs[0]
    return [partial(probe.write, first.channel, first.other(number))]


def _in_vain(context: RuleContext, witness: Witness, number: int) -> None:
    context.unanswered(_in_haste(context, witness, number))


def _refused(context: RuleContext, witness: Witness, number: int) -> None:
    for text in context.subject.refused:
        for call in context.refused_calls(witness.probe, text):
            with witness.looking(), context.in_haste(witness.probe):
                context.failure(call)


def _garbled(context: RuleContext, witness: Witness, number: int) -> None:
    context.spoiled(lambda answer: bytes(each ^ 0x95 for each in answer), False, _in_haste(context, witness, number))


def _away(context: RuleContext, witness: Witness, number: int) -> None:
    with context.loss():
        context.failure(_in_haste(context, witness, number))


def _looked(context: RuleContext, witness: Witness, number: int) -> None:
    """Look for the device while it is silent, and when it answers again."""
    with context.line.silent():
        context.failure(_in_haste(context, witness, number))
        _look_often(context, witness)
    _look_often(context, witness)


def _look_often(context: RuleContext, witness: Witness) -> None:
    found: bool | None = None
    for _ in range(MOST_LOOKS):
        with witness.looking():
            found = context.look(witness.probe)
        if found is True:
            return
        sleep(LOOK_INTERVAL)


def _in_haste(context: RuleContext, witness: Witness, number: int) -> DriverCall:
    witness.probe.timeout = context.haste
    return _harmless(context, witness.probe, number)[0]


class Witness:
    """Observes the outputs independently of the driver: by a record, by another client through the loop-backs, and by
    the tap."""

    def __init__(self, context: RuleContext, probe: Probe, other: Probe | None) -> None:
        self.context, self.probe = context, probe
        self.seen = ""
        """The first movement, in words."""
        self.lost = False
        """True if the device was away and may have lost its levels: the driver may bring outputs to their defaults."""
        subject = context.subject
        self._apart = other if subject.line is None or subject.direct is not None else None
        """A client that does not use the line."""
        self._looped = [each for each in context.viewed if self._apart and context.view(each) != each.channel]
        self._writes: dict[Output, Writes] = {}
        if subject.line is not None and subject.levels is None and context.readable:
            tried = context.as_time_allows(subject.outputs, FEWEST_OUTPUTS, "outputs whose requests are recognised")
            self._writes = {output: writes for output in tried if (writes := known_writes(context, probe, output))}
        recorded = subject.outputs if subject.levels is not None else ()
        self.watched = {each.channel for each in (*recorded, *self._looped, *self._writes)}

    def write(self, output: Output, number: int) -> None:
        """Let another client write a value, if it may. The value must stay while the driver writes nothing."""
        if self._apart is not None and self.context.readable and not self.context.subject.sole_writer:
            self.context.insist(self.context.ready, self._apart, output.channel)
            self.context.insist(self._apart.write, output.channel, output.other(number))
            if output in self._looped:
                self.context.is_read(self._apart, output, output.other(number))

    @property
    def remark(self) -> str | None:
        """A remark on the outputs that nothing observes independently of the driver."""
        unseen = [each.channel for each in self.context.subject.outputs if each.channel not in self.watched]
        return f"the levels of {some(unseen)} were not watched" if unseen else None

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Make a call that writes nothing. Movements of outputs before this call are attributed to the device
        itself."""
        context, before = self.context, self._levels()
        with context.counted(answers=True) as traffic:  # a look may send a request and not wait for its end
            yield
        doing = context.watch.doing
        for output, writes in self._writes.items():
            if (raw := writes.found_in(traffic.requests)) is not None and not self._may_go_to(output, raw):
                self._note(f"{doing} sent a request to write {raw} to {output.channel}")
        for output, levels in self._levels().items():
            for now in levels:
                if not context.alike(output.channel, before[output][-1], now) and not self._may_go_to(output, now):
                    self._note(f"{output.channel} went from {before[output][-1]} to {now} during a {doing}")

    def _may_go_to(self, output: Output, raw: int) -> bool:
        return self.lost and self.context.same(output, output.default, raw)

    def _note(self, text: str) -> None:
        self.seen = self.seen or text

    def _levels(self) -> dict[Output, list[int]]:
        """Return the levels that the outputs had since the last look, as far as they are observed independently of the
        driver."""
        context, other = self.context, self._apart
        if context.subject.levels is not None:
            return {each: list(context.recorded(each)) for each in context.subject.outputs}
        if other is None or not self._looped:
            return {}
        other.timeout = context.patience
        return {each: [context.insist(other.read, context.view(each))] for each in self._looped}
