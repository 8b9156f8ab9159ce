"""Faults between a machine and one of its drivers (`umo.testing.faults`). Without faults a driver is not wrapped."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from operator import index
from typing import Any, Protocol

import numpy as np

from umo.digits import number_text
from umo.drivers.contract import UNREAD, Channel, Driver, IntArray
from umo.drivers.faults.effects import MARK, Effect
from umo.drivers.optional import Looks, answers_for_device, arm_watchdog, look_for
from umo.drivers.wrapping import Wrapper, of_driver
from umo.duration import TIME_TOLERANCE, duration
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError

log = logging.getLogger("umo")


class HasNow(Protocol):
    @property
    def now(self) -> float: ...


class Injection:
    """The faults of one machine. No fault is in effect before the machine is connected and has set its clock, so that
    the guardian resets the machine without faults."""

    def __init__(self, texts: Sequence[str], seed: int, waits: bool) -> None:
        self.texts, self.seed, self.waits = tuple(texts), seed, waits
        """`waits`: whether the run is in wall-clock time, so that a call with a delay takes its time."""
        self.clock: HasNow | None = None
        self.drivers: list[FaultyDriver] = []
        self.tells = True
        """True if the beginning and the end of faults are logged. The control process logs them, a worker process does
        not."""
        self.say: Callable[[Callable[[], str]], object] = _log
        """The function that logs a line. Its argument is a function that formats the line, so that a machine can log it
        after the outputs of its period are sent."""

    @property
    def active(self) -> int:
        """Number of faults that are in effect now, counted on each channel; shown as a signal."""
        return sum(len(driver.active()) for driver in self.drivers)

    def end(self) -> bool:
        """End all faults at the end of the run. Return whether a fault that concerns outputs was in effect."""
        ended = [effect for driver in self.drivers for effect in driver.end()]
        self.clock = None
        return any(effect.output or effect.channel is None for effect in ended)


def _log(line: Callable[[], str]) -> None:
    log.warning("%s", line())


def _said(what: str, effect: Effect, now: float) -> str:
    where = "" if effect.channel is None else f" (channel {effect.channel.text})"
    return f"injected fault {what} at {number_text(now)} s: {effect.text}{where}"


class FaultyDriver(Wrapper, Looks):
    """A driver with faults on some of its channels. Everything else is as in the wrapped driver. A FaultyDriver always
    has `look`, because a fault may prevent the device from being found."""

    def __init__(self, driver: Driver[Any], effects: Sequence[Effect], injection: Injection) -> None:
        super().__init__(driver)
        self.levels: dict[str, int] = {}
        """The raw integers that were last written to the circuit, by channel."""
        self.effects, self._injection = effects, injection
        self._acting: list[Effect] = []
        self._now = -1.0
        injection.drivers.append(self)

    finalize = of_driver("finalize")
    close = of_driver("close")

    # Which faults are in effect ------------------------------------------------------------------------

    def active(self) -> list[Effect]:
        """Return the effects that act at the time of the machine. Logs their beginnings and ends."""
        clock = self._injection.clock
        if clock is None or clock.now == self._now:
            return self._acting
        self._now = now = clock.now
        acting = [each for each in self.effects if each.begin - TIME_TOLERANCE <= now < each.end - TIME_TOLERANCE]
        for effect in acting:
            if effect not in self._acting:
                effect.set_in(self.levels.get(_text(effect)) if effect.output else None)
                self._log("begins", effect, now)
        for effect in self._acting:
            if effect not in acting:
                self._log("ends", effect, now)
        self._acting = acting
        return acting

    def end(self) -> list[Effect]:
        """End all effects from now on, and return those that were in effect."""
        acting, self._acting = self._acting, []
        for effect in acting:
            self._log("ends", effect, self._now)
        return acting

    def _log(self, what: str, effect: Effect, now: float) -> None:
        if self._injection.tells:
            self._injection.say(partial(_said, what, effect, now))

    def _concerning(self, channels: Sequence[Channel], output: bool) -> list[Effect]:
        acting = self.active()
        if not acting:
            return acting
        texts = {channel.text for channel in channels}
        return [each for each in acting if each.channel is None or (each.output is output and _text(each) in texts)]

    def _begin(self, effects: Sequence[Effect]) -> dict[str, Exception | str]:
        """Begin a call, and return the channels that are lost, each with its cause. Raises an error if the whole call
        fails."""
        if takes := max((effect.takes for effect in effects), default=0.0):
            self._delay(takes)
        if any(effect.mistake for effect in effects):
            raise RuntimeError(f"a mistake in the driver {MARK}")
        lost: dict[str, Exception | str] = {}
        for effect in effects:
            if loss := effect.lost():
                cause = f"{loss} {MARK}"
                if effect.channel is None:
                    raise DriverError(cause)
                lost[_text(effect)] = cause
        return lost

    def _delay(self, seconds: float) -> None:
        """Delay a call. Raises DeviceTimeout if the delay is not shorter than the timeout. Virtual time stands still
        during a call, so a shorter delay has no effect there. Several delays pass at the same time."""
        if self._injection.waits:
            time.sleep(min(seconds, self.timeout))
        if seconds >= self.timeout:
            raise DeviceTimeout(f"timed out ({duration(self.timeout)}) {MARK}")

    def _changed(self, raw: int, effects: Sequence[Effect], text: str) -> int:
        for effect in effects:
            if _text(effect) == text:
                raw = effect.changed(raw, self._now - effect.begin)
        return raw

    # Calls with faults ---------------------------------------------------------------------------------

    def open(self) -> None:
        self.levels, self._acting, self._now = {}, [], -1.0
        counts: Counter[tuple[str, str, bool]] = Counter()
        for effect in self.effects:
            same = effect.text, _text(effect), effect.output
            effect.start(self._injection.seed, counts[same])
            counts[same] += 1
        self._begin([each for each in self.active() if each.channel is None])
        self.driver.open()

    @property
    def answers_for_device(self) -> bool:
        return answers_for_device(self.driver)

    def look(self) -> bool | None:
        """Look for the device. A fault that makes calls fail prevents the device from being found."""
        acting = self.active()
        if any(effect.takes >= self.timeout for effect in acting):
            return False
        whole = [effect for effect in acting if effect.channel is None]
        return False if any(effect.mistake or effect.lost() for effect in whole) else look_for(self.driver)

    def watchdog(self, seconds: float) -> None:
        self._begin([each for each in self.active() if each.channel is None])
        arm_watchdog(self.driver, seconds)

    def read(self, channel: Channel) -> int:
        effects = self._concerning((channel,), False)
        self._lose(effects)
        raw = self.driver.read(channel)
        if any(effect.short for effect in effects):
            return None  # type: ignore[return-value]  # as a driver whose answer has no value in it
        return self._changed(index(raw), effects, channel.text) if effects else raw

    def write(self, channel: Channel, raw: int) -> None:
        self._put("write", channel, raw)

    def initialize(self, channel: Channel, default: int | None) -> None:
        self._put("initialize", channel, default)

    def reset(self, channel: Channel, default: int | None) -> None:
        self._put("reset", channel, default)

    def _put(self, segment: str, channel: Channel, raw: int | None) -> None:
        effects = self._concerning((channel,), raw is not None)
        self._lose(effects)
        if raw is None:
            getattr(self.driver, segment)(channel, None)
        elif not any(effect.short for effect in effects):
            changed = self._changed(raw, effects, channel.text)
            with _marked(changed != raw):
                getattr(self.driver, segment)(channel, changed)
            self.levels[channel.text] = changed

    def _lose(self, effects: Sequence[Effect]) -> None:
        for cause in self._begin(effects).values():
            raise DriverError(str(cause))

    # Blocks with faults --------------------------------------------------------------------------------

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        effects = self._concerning(channels, False)
        if not effects:
            self.driver.read_many(channels, out)
            return
        lost = self._begin(effects)
        kept = self._kept(channels, effects, lost)
        raws = np.full(len(kept), UNREAD)
        if kept:
            lost |= _partly(lambda: self.driver.read_many(tuple(channels[i] for i in kept), raws))
        for i, raw in zip(kept, raws.tolist(), strict=True):
            out[i] = raw if raw == UNREAD else self._changed(raw, effects, channels[i].text)
        if lost:
            raise ChannelsFailed(lost)

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        effects = self._concerning(channels, True)
        lost = self._begin(effects)
        kept = self._kept(channels, effects, lost)
        moved = tuple(channels[i] for i in kept) if effects else channels
        meant = raws[kept].tolist()
        changed = [self._changed(raw, effects, each.text) for each, raw in zip(moved, meant, strict=True)]
        if changed:
            with _marked(changed != meant):
                lost |= _partly(lambda: self.driver.write_many(moved, np.array(changed, np.int64)))
        self.levels |= {each.text: raw for each, raw in zip(moved, changed, strict=True) if each.text not in lost}
        if lost:
            raise ChannelsFailed(lost)

    def _kept(self, channels: Sequence[Channel], effects: Sequence[Effect], lost: Mapping[str, object]) -> list[int]:
        """Return the indices of the channels that are transferred."""
        ends = {_text(effect) for effect in effects if effect.short}
        stop = next((i for i, channel in enumerate(channels) if channel.text in ends), len(channels))
        return [i for i in range(stop) if channels[i].text not in lost]


@contextmanager
def _marked(changed: bool) -> Iterator[None]:
    """Return a context in which the error for a refused level says that a fault has `changed` the level."""
    try:
        yield
    except DriverError as error:
        if not changed or isinstance(error, TimeoutError):
            raise
        raise DriverError(f"{error} {MARK}") from error


def _partly(transfer: Any) -> Mapping[str, str]:
    """Make a block transfer, and return the channels that failed, each with its cause."""
    try:
        transfer()
    except ChannelsFailed as error:
        return error.causes
    return {}


def _text(effect: Effect) -> str:
    return "" if effect.channel is None else effect.channel.text
