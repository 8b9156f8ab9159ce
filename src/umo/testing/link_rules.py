"""The rules of the link (docs/split-protocol.md), which `umo device conform` tests on a controller in place of the
rules of a driver. Only the laws of a part write its outputs, so the rules of a driver do not apply.

Nothing is driven. The host inhibits every output, so that it stays at its default while the laws run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from random import Random
from time import monotonic

from umo.drivers.streams import Lost
from umo.generate.split.controller_driver import Controller
from umo.generate.split.link_bodies import ITEM, VERSION, ControllerMode, ControllerState, FrameItem, FrameKind, item
from umo.generate.split.link_frames import framed
from umo.generate.split.link_host import LinkHost, WrongController
from umo.generate.split.part_plan import PartPlan
from umo.testing.conformance.certificate import Finding, Judgement
from umo.testing.conformance.rules import RuleBroken
from umo.testing.link_peer import LinkPeer

EXCHANGES, DAMAGES = 20, 12
START, EXCHANGE, STOP = FrameKind.START, FrameKind.EXCHANGE, FrameKind.STOP


class LinkTrial:
    """A controller at the other end of a line, and the part that should run on it."""

    def __init__(self, driver: Controller, plan: PartPlan) -> None:
        self.driver, self.plan = driver, plan
        self.patience = max(plan.host_timeout / 4, 3 * plan.model.period)

    @contextmanager
    def peer(self) -> Iterator[LinkPeer]:
        """Return a context with a host that only this rule uses. At the end of the context the controller stops."""
        stream = self.driver.place.dial()(monotonic() + max(self.driver.timeout, 1.0))
        try:
            peer = LinkPeer(stream, self.plan, self.patience)
            yield peer
            peer.session = peer.greeted().session
            peer.asked(STOP)
        finally:
            stream.close()


def greeting(trial: LinkTrial) -> None:
    """The answer to a greeting has the nonce of the greeting, the version, the hash of the part and its numbers. Each
    nonce is offered one session, however often it arrives."""
    with trial.peer() as peer:
        nonce = peer.new_nonce()
        first, again, other = peer.greeted(nonce), peer.greeted(nonce), peer.greeted()
        expected = VERSION, trial.plan.hash, trial.plan.real_size
        if (has := (first.version, first.hash, first.real_size)) != expected:
            names = "version, hash and bytes of a real"
            raise RuleBroken(f"its {names} are {', '.join(map(str, has))}, not {', '.join(map(str, expected))}")
        if not first.session or first.session != again.session or other.session == first.session:
            sessions = f"{first.session} and {again.session}, and another nonce the session {other.session}"
            raise RuleBroken(f"two greetings with the same nonce are offered the sessions {sessions}")


def another_part(trial: LinkTrial) -> None:
    """A host that has another version of the part cannot start it."""
    others = replace(trial.plan, host_timeout=trial.plan.host_timeout + 2 * trial.plan.model.period)
    host = LinkHost(trial.driver.place.dial(), others, "at the other end")
    try:
        host.greet(monotonic() + max(trial.driver.timeout, 5 * trial.patience))
    except WrongController:
        return
    finally:
        host.close()
    raise RuleBroken(f"a greeting with the hash of another part, {others.hash}, is answered like one with its own hash")


def not_started(trial: LinkTrial) -> None:
    """Nothing runs before START, and START is accepted only for the session that was offered."""
    with trial.peer() as peer:
        peer.session = peer.greeted().session
        peer.refused(framed(peer.body(EXCHANGE)), "EXCHANGE before START")
        other = peer.session % 0xFFFF + 1
        peer.refused(framed(peer.body(START, session=other, items=peer.fields())), "START of a session not offered")
        peer.refused(framed(peer.body(START, session=0, items=peer.fields())), "START of session 0")


def values(trial: LinkTrial) -> str:
    """Each answer contains the number of its request and the inputs of a later period. Inhibited outputs stay at their
    defaults."""
    model, missing = trial.plan.model, set[str]()
    with trial.peer() as peer:
        last = _running(trial, peer.started())
        for _ in range(EXCHANGES):
            state = _running(trial, peer.asked(EXCHANGE))
            if state.number <= last.number:
                raise RuleBroken(f"an answer of period {state.number} came after an answer of period {last.number}")
            _at_defaults(trial, state)
            missing |= {model.objects[n].path for n, failed in enumerate(state.failed) if failed}
            last = state
    return f"not read by the controller: {', '.join(sorted(missing))}" if missing else ""


def repeated(trial: LinkTrial) -> None:
    """A frame that arrives a second time, or after a later frame, is ignored."""
    with trial.peer() as peer:
        peer.started()
        peer.asked(EXCHANGE)
        number = peer.number
        peer.refused(framed(peer.body(EXCHANGE, number=number)), "a frame that came twice")
        peer.asked(EXCHANGE)
        peer.refused(framed(peer.body(EXCHANGE, number=number)), "a frame that came after a later one")
        _running(trial, peer.asked(EXCHANGE))


def damaged(trial: LinkTrial) -> None:
    """A frame that has a changed bit, or is cut short, is ignored. The next frame is carried out."""
    random = Random(1)
    with trial.peer() as peer:
        peer.started()
        for number in range(DAMAGES):
            data = bytearray(framed(peer.body(EXCHANGE)))
            if number % 4:
                data[random.randrange(2, len(data) - 1)] ^= 1 << random.randrange(8)
            else:
                del data[random.randrange(2, len(data) - 1)]
            peer.refused(bytes(data), "a damaged frame")
            _running(trial, peer.asked(EXCHANGE))


def items(trial: LinkTrial) -> None:
    """A frame with an unknown item, or with an item that is cut short, is ignored as a whole."""
    with trial.peer() as peer:
        peer.started()
        wrong = {
            "an item of an unknown kind": ITEM.pack(99, 0),
            "a field that does not exist": item(FrameItem.FIELD, 0xFFFF, b"12345678"),
            "an item that is cut short": item(FrameItem.COMMAND, 0)[:2],
        }
        for what, each in wrong.items():
            peer.refused(framed(peer.body(EXCHANGE, items=(each,))), f"a frame with {what}")
            _running(trial, peer.asked(EXCHANGE))


def second_host(trial: LinkTrial) -> None:
    """The greeting of a second host changes nothing for the first host. Once the second host starts the part, the
    controller ignores the first host."""
    with trial.peer() as peer:
        peer.started()
        first, second = peer.session, peer.greeted().session
        _running(trial, peer.asked(EXCHANGE))
        peer.session = second
        _running(trial, peer.asked(START, peer.fields()))
        peer.refused(framed(peer.body(EXCHANGE, session=first)), "a frame of an earlier session")
        _running(trial, peer.asked(EXCHANGE))


def silence(trial: LinkTrial) -> str:
    """After the last frame the part runs for host_timeout at most, in periods that the controller counts. Then the
    session ends."""
    with trial.peer() as peer:
        peer.started()
        before = _running(trial, peer.asked(EXCHANGE))
        peer.silent(trial.plan.host_timeout + max(trial.patience, 5 * trial.plan.model.period))
        peer.refused(framed(peer.body(EXCHANGE)), f"after {trial.plan.host_timeout:g} s of silence a frame")
        peer.refused(framed(peer.body(EXCHANGE, session=0)), "a frame of no session")
        after = peer.asked(STOP, session=peer.greeted().session)
        ran, limit = after.number - before.number, trial.plan.timeout_ticks
        if not ran <= limit:
            raise RuleBroken(f"in silence the part ran for {ran} periods, not {limit}")
        _at_defaults(trial, after)
    return f"it ran for {ran} of {limit} periods"


def stop(trial: LinkTrial) -> None:
    """STOP brings the outputs to their defaults. The part does not run until another START."""
    with trial.peer() as peer:
        peer.started()
        state = peer.asked(STOP)
        if state.mode is not ControllerMode.RESTING:
            raise RuleBroken(f"after STOP the controller is {state.mode.name}")
        _at_defaults(trial, state)
        if (later := peer.asked(EXCHANGE)).number != state.number or later.mode is not ControllerMode.RESTING:
            raise RuleBroken("after STOP an EXCHANGE lets the part run")


RULES: dict[str, Callable[[LinkTrial], str | None]] = {
    "greeting": greeting,
    "another part": another_part,
    "not started": not_started,
    "values": values,
    "repeated frame": repeated,
    "damaged frame": damaged,
    "items": items,
    "second host": second_host,
    "silence": silence,
    "stop": stop,
}


def findings(trial: LinkTrial, names: Iterable[str] = RULES) -> Iterator[Finding]:
    """Return the verdict on each of these rules. If the controller is not the one of the wiring, no further rule is
    tried."""
    mute = ""
    for name in names:
        rule = RULES[name]
        text = " ".join((rule.__doc__ or "").split())
        if mute:
            yield Finding(name, text, Judgement.NOT_TRIED, mute)
            continue
        try:
            yield Finding(name, text, Judgement.PASSED, rule(trial) or "")
        except RuleBroken as broken:
            mute = "the controller is not the one of the wiring" if rule is greeting else ""
            yield Finding(name, text, Judgement.FAILED, str(broken))
        except (Lost, OSError) as error:
            yield Finding(name, text, Judgement.FAILED, str(error) or "the line was lost")


def _running(trial: LinkTrial, state: ControllerState) -> ControllerState:
    if state.mode is not ControllerMode.RUNNING:
        why = f": {trial.plan.fault_text(state.fault, state.fault_object)}" if state.fault else ""
        raise RuleBroken(f"the part does not run: it is {state.mode.name}{why}")
    return state


def _at_defaults(trial: LinkTrial, state: ControllerState) -> None:
    model = trial.plan.model
    for place, slot in enumerate(model.outputs):
        if state.raws_out[place] != model.objects[slot].default_raw:
            wanted = model.objects[slot].default_raw
            raise RuleBroken(f"{model.objects[slot].path} is at {state.raws_out[place]}, not at its default, {wanted}")
