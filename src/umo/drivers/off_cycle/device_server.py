"""The server of one driver off the cycle. It answers requests while nothing is controlled, and then makes transfers at
the driver's period.

In a worker process the server waits for a slow device as long as needed. Without a worker process (virtual time,
`connect` in the user's process) the cycle calls the same object.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from time import monotonic_ns
from typing import Any

import numpy as np

from umo.drivers.absence import OFF_CYCLE, Absence, AbsenceState, AbsenceStep
from umo.drivers.contract import UNREAD, Channel, Driver, IntArray
from umo.drivers.off_cycle.shared_memory import NO_TIME, Cell, Exchange, Order, Row, Wanted
from umo.drivers.optional import (
    NoWatchdog,
    ages_of,
    answers_for_device,
    arm_watchdog,
    inspection_of,
    look_for,
    report_of,
)
from umo.errors import FAILURES, ChannelsFailed, DeviceTimeout, DriverError, forget_frames, text_of


class DeviceServer:
    """One driver and its side of the exchange. `period`: the time in s between transfers. `ns`: the clock, in ns."""

    def __init__(
        self, driver: Driver[Any], exchange: Exchange, period: float, ns: Callable[[], int] = monotonic_ns
    ) -> None:
        self.driver, self.exchange, self.ns = driver, exchange, ns
        self.on_call: Callable[[], object] = lambda: None
        """The function that is called before each call of the driver, as a heartbeat."""
        self.in_charge: Callable[[], bool] = lambda: True
        """The function that returns, after a slow reading, whether the machine still runs. If it does not, the waiting
        values are not written."""
        self.opened = False
        self._period = round(period * 1e9)
        self._cells = exchange.cells
        self._channels = exchange.channels
        self._initialized: dict[str, tuple[Channel, int | None]] = {}
        """The channels that were initialised, with the defaults of outputs, in this order."""
        self._watchdog: float | None = None
        self._inputs: tuple[int, ...] = ()
        self._outputs: tuple[int, ...] = ()
        self._groups: tuple[tuple[Channel, ...], tuple[Channel, ...]] = (), ()
        self._followed = -1
        """The count of the wanted values up to which orders were carried out."""
        self._due = 0
        self._reads = False
        """True if the last transfer has brought readings. Readings then continue while writing fails, and orders are
        tried."""
        self._held_until = 0
        """The time in ns up to which the outputs are kept at their defaults."""
        self._absence = Absence(OFF_CYCLE, answers_for_device(driver))

    def assign(self, inputs: Sequence[int], outputs: Sequence[int]) -> None:
        """Set the channels, by number, that each transfer reads and writes; all others are moved only by orders."""
        self._inputs, self._outputs = tuple(inputs), tuple(outputs)
        channels = self._channels
        self._groups = tuple(channels[i] for i in self._inputs), tuple(channels[i] for i in self._outputs)

    # Requests ------------------------------------------------------------------------------------------------

    def perform(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Make one call, and return its answer: `value`, or the `error`."""
        self.driver.timeout = request.get("timeout", self.driver.timeout)
        try:
            return {"value": getattr(self, f"_do_{request['call']}")(request)}
        except FAILURES as error:
            answer: dict[str, Any] = {"error": _kind(error), "text": text_of(error)}
            if isinstance(error, ChannelsFailed):
                answer["causes"] = dict(error.causes)
            forget_frames(error)
            return answer

    def _do_open(self, request: Mapping[str, Any]) -> None:
        """Open the driver, unless it is already open, as in a worker that replaces another worker."""
        if not self.opened:
            self.on_call()
            self.driver.open()
            self.opened = True

    def _do_close(self, request: Mapping[str, Any]) -> None:
        self.opened = False
        self._initialized.clear()
        self.on_call()
        self.driver.close()

    def _do_watchdog(self, request: Mapping[str, Any]) -> None:
        self._watchdog = request["seconds"]
        self.on_call()
        arm_watchdog(self.driver, request["seconds"])

    def _do_report(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self.on_call()
        return report_of(self.driver)

    def _do_inspect(self, request: Mapping[str, Any]) -> str:
        self.on_call()
        return inspection_of(self.driver, self._channel(request["channel"]))

    def _do_initialize(self, request: Mapping[str, Any]) -> None:
        channel, default = self._channel(request["channel"]), request["raw"]
        self._initialized[channel.text] = channel, default
        self.on_call()
        self.driver.initialize(channel, default)
        self._note(channel, default)

    def _do_reset(self, request: Mapping[str, Any]) -> None:
        channel = self._channel(request["channel"])
        self.on_call()
        self.driver.reset(channel, request["raw"])
        self._note(channel, request["raw"])

    def _do_finalize(self, request: Mapping[str, Any]) -> None:
        channel = self._channel(request["channel"])
        self._initialized.pop(channel.text, None)
        self.on_call()
        self.driver.finalize(channel)

    def _do_read(self, request: Mapping[str, Any]) -> Any:
        self.on_call()
        return _as_plain(self.driver.read(self._channel(request["channel"])))

    def _do_write(self, request: Mapping[str, Any]) -> None:
        channel = self._channel(request["channel"])
        self.on_call()
        self.driver.write(channel, request["raw"])
        self._note(channel, request["raw"])

    def _do_read_many(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Return the raw integers, and the causes for channels that failed."""
        channels = tuple(map(self._channel, request["channels"]))
        out, causes = np.full(len(channels), UNREAD), {}
        self.on_call()
        try:
            self.driver.read_many(channels, out)
        except ChannelsFailed as error:
            causes = dict(error.causes)
        return {"raws": out.tolist(), "causes": causes}

    def _do_write_many(self, request: Mapping[str, Any]) -> None:
        channels = tuple(map(self._channel, request["channels"]))
        self.on_call()
        self.driver.write_many(channels, np.array(request["raws"], np.int64))

    def _do_look(self, request: Mapping[str, Any]) -> bool | None:
        self.on_call()
        return look_for(self.driver)

    def _do_begin(self, request: Mapping[str, Any]) -> None:
        """Make one transfer now, and from then on transfers at the driver's period."""
        self._back()
        if not self._cells[Cell.GENERATION]:
            self._cells[Cell.GENERATION] = self._cells[Cell.INITIALIZED] = 1
        began = self.ns()
        self._transfer()
        self._due = max(began + self._period, self.ns())

    def _channel(self, text: str) -> Channel:
        number = self.exchange.place.get(text)
        return self.driver.channel(text) if number is None else self._channels[number]

    def _note(self, channel: Channel, raw: int | None) -> None:
        """Record the raw integer that an output has accepted."""
        number = self.exchange.place.get(channel.text)
        if number is not None and raw is not None:
            rows = self.exchange.arrivals.read()[1]
            rows[Row.RAW, number], rows[Row.STAMP, number] = raw, self.ns()
            self._post(rows)

    # At its own period -----------------------------------------------------------------------------------------

    def work(self) -> None:
        """Carry out the work that is due now: orders, and the transfer of a period."""
        if (self._reads or self._absence.refuses or not self._absence.is_away) and not self._is_held:
            self._follow_orders()
        if self.ns() >= self._due:
            self._transfer()
            self._due = max(self._due + self._period, self.ns())
            if self._absence.is_away and not self._reads:
                self._due = max(self._due, round(self._absence.due * 1e9))

    def seconds_left(self) -> float:
        """Return the time in s to the next transfer."""
        return (self._due - self.ns()) * 1e-9

    def _transfer(self) -> None:
        began, rows = self.ns(), self.exchange.arrivals.read()[1]
        try:
            found = not self._absence.is_away or self._found(rows)
            if not found and not self._reads:
                return
            self._read(rows, began)
            if found:
                decided = not self.in_charge() or self._write(rows)
                self._cells[Cell.AWAY_SINCE] = NO_TIME
                if decided:
                    self._back()
        except FAILURES as error:
            self._failed(began, error)
        self._post(rows)

    def _read(self, rows: IntArray, began: int) -> None:
        self._reads, channels = False, self._groups[0]
        if not channels:
            return
        out, causes = np.full(len(channels), UNREAD), {}
        self.on_call()
        try:
            self.driver.read_many(channels, out)
        except ChannelsFailed as error:
            causes = error.causes
        ages = ages_of(self.driver, channels) or [0.0] * len(channels)
        for number, channel, raw, age in zip(self._inputs, channels, out.tolist(), ages, strict=True):
            cause = causes.get(channel.text, "the driver returned no value" if raw == UNREAD else "")
            self._judge(rows, number, raw, began - round(age * 1e9), cause)
        self._reads, self._cells[Cell.AWAY_SINCE] = True, NO_TIME

    @property
    def _is_held(self) -> bool:
        return self.ns() < self._held_until

    def _to_write(self) -> tuple[list[int], IntArray]:
        """Return the outputs that a transfer writes, by number, and their raw integers."""
        if self._is_held:
            defaults = [self._initialized[channel.text][1] or 0 for channel in self._groups[1]]
            return list(self._outputs), np.array(defaults, np.int64)
        wanted = self.exchange.wanted.read()[1]
        current = wanted[Wanted.GENERATION] == self._cells[Cell.GENERATION]
        numbers = [number for number in self._outputs if current[number]]
        return numbers, wanted[Wanted.RAW, numbers]

    def _write(self, rows: IntArray) -> bool:
        """Write the wanted values. Return True if they were sent, or if there are no outputs. Return False if the
        outputs were initialised again and no values are wanted for them yet."""
        numbers, raws = self._to_write()
        if not numbers:
            return not self._outputs
        complete = len(numbers) == len(self._outputs)
        channels = self._groups[1] if complete else tuple(self._channels[number] for number in numbers)
        causes: Mapping[str, str] = {}
        began = self.ns()
        self.on_call()
        try:
            self.driver.write_many(channels, raws)
        except ChannelsFailed as error:
            causes = error.causes
        except FAILURES as error:
            for number in numbers:
                self.exchange.set_cause(number, text_of(error))
            raise
        for number, channel, raw in zip(numbers, channels, raws.tolist(), strict=True):
            self._judge(rows, number, raw, began, causes.get(channel.text, ""))
        return True

    def _judge(self, rows: IntArray, number: int, raw: int, began: int, cause: str) -> None:
        """Record that one channel was transferred, or failed."""
        if cause:
            self.exchange.set_cause(number, cause)
        else:
            rows[Row.RAW, number], rows[Row.STAMP, number] = raw, began

    def _follow_orders(self) -> None:
        """Carry out each ordered call once. Of several orders for one channel, only the last is carried out."""
        if self.exchange.wanted.count == self._followed:
            return
        self._followed, wanted = self.exchange.wanted.read()
        rows = self.exchange.arrivals.read()[1]
        new = np.flatnonzero(wanted[Wanted.ORDER] != rows[Row.ORDER]).tolist()
        for number in new:
            rows[Row.ORDER, number] = wanted[Wanted.ORDER, number]
            if wanted[Wanted.GENERATION, number] != self._cells[Cell.GENERATION]:
                continue  # it was meant for the time before the outputs were initialised again
            began = self.ns()
            channel = self._channels[number]
            try:
                sent = self._call(channel, *wanted[[Wanted.CALL, Wanted.RAW], number].tolist())
            except FAILURES as error:
                self.exchange.set_cause(number, text_of(error))
                if self._initialized[channel.text][1] is not None:
                    rows[Row.STAMP, number] = NO_TIME  # it is not known what it has
                if isinstance(error, TimeoutError):
                    self._failed(began, error)
                    self._followed = -1  # the others are still to be carried out
                    break
            else:
                if sent is not None:
                    rows[Row.RAW, number], rows[Row.STAMP, number] = sent, began
        if new:
            self._post(rows)

    def _post(self, rows: IntArray) -> None:
        """Post values, with the generation of outputs to which they belong."""
        rows[Row.GENERATION] = self._cells[Cell.GENERATION]
        self.exchange.arrivals.post(rows)

    def _call(self, channel: Channel, call: int, raw: int) -> int | None:
        """Make a call for one channel. Return the raw integer that was sent to an output; None for an input."""
        self.on_call()
        default = self._initialized[channel.text][1]
        if call == Order.WRITE:
            if self._cells[Cell.INITIALIZED] != self._cells[Cell.GENERATION]:
                raise DriverError("its device was not initialised again yet")
            self.driver.write(channel, raw)
            return raw
        if call == Order.RESET:
            self.driver.reset(channel, default)
        else:
            self.driver.initialize(channel, default)
        return default

    # A device that is away ---------------------------------------------------------------------------------------

    def _failed(self, began: int, error: BaseException) -> None:
        """Record that a call failed for the whole driver, or timed out. No transfer is made until the device is
        found."""
        if self._cells[Cell.AWAY_SINCE] == NO_TIME and not self._reads:
            self._cells[Cell.AWAY_SINCE] = began
        self._absence.failed(self._now, isinstance(error, TimeoutError), began=began * 1e-9)
        self._set_cause(error)

    def _set_cause(self, error: BaseException) -> None:
        self.exchange.set_cause(-1, text_of(error))
        forget_frames(error)

    def _back(self) -> None:
        self._cells[Cell.AWAY_SINCE] = NO_TIME
        if self._absence.state is not AbsenceState.THERE:
            self._absence = Absence(OFF_CYCLE, answers_for_device(self.driver))

    @property
    def _now(self) -> float:
        return self.ns() * 1e-9

    def _found(self, rows: IntArray) -> bool:
        """Return True if the device answers again. A device that was away for long is initialised first."""
        if not self._absence.is_due(self._now):
            return False
        found = self._look()
        step = self._absence.looked(self._now, found, self.driver.timeout)
        if step is AbsenceStep.INITIALIZE:
            complete = self._initialize_again(rows)  # takes its time
            step = self._absence.initialized(self._now, complete)
        return step is AbsenceStep.TRY

    def _look(self) -> bool | None:
        """Return the result of a look. A driver that is not open yet is opened instead."""
        try:
            if self.opened:
                self.on_call()
                return look_for(self.driver)
            self._do_open({})
        except FAILURES as error:
            self._set_cause(error)
            return False
        return True

    def _initialize_again(self, rows: IntArray) -> bool:
        """Initialise the driver's channels again, and return True if this succeeded. Values posted from now on belong
        to a new generation."""
        self._cells[Cell.GENERATION] += 1
        try:
            for channel, default in tuple(self._initialized.values()):
                began = self.ns()
                self.on_call()
                self.driver.initialize(channel, default)
                self._absence.accepted()
                number = self.exchange.place.get(channel.text)
                if default is not None and number is not None:
                    rows[Row.RAW, number], rows[Row.STAMP, number] = default, began
            self._cells[Cell.INITIALIZED] = self._cells[Cell.GENERATION]
            if self._watchdog is not None:
                self.on_call()
                arm_watchdog(self.driver, self._watchdog)
        except FAILURES as error:
            self._set_cause(error)
            self._post(rows)
            return False
        return True

    # The place of a worker that died, and the end ------------------------------------------------------------------

    def begin_anew(self, defaults: Mapping[str, int | None], watchdog: float | None, hold: float = 0.0) -> None:
        """Open the driver and initialise all of its channels (each with its default, by its text): call this after
        another worker has died, when the state of the outputs is unknown. Until this succeeds, the device counts as
        away. For `hold` s the outputs stay at their defaults, regardless of written values."""
        self._held_until = self.ns() + round(hold * 1e9)
        self._initialized = {text: (self._channel(text), raw) for text, raw in defaults.items()}
        self._watchdog, self._reads = watchdog, False
        self._cells[Cell.AWAY_SINCE] = self._due = self.ns()
        self._absence.assume(self._now)
        rows = self.exchange.arrivals.read()[1]
        if self._found(rows):
            self._back()
            self._post(rows)

    def reset_all(self, order: Sequence[str]) -> dict[str, str]:
        """Reset every initialised output to its default, in this order of the channels' texts. Return the causes for
        the outputs that could not be reset. After a failure the next attempt opens the driver again."""
        driven = [text for text in order if text in self._initialized]
        if driven and not self.opened and (why := self._open_again(driven)):
            return dict.fromkeys(driven, why)
        failed: dict[str, str] = {}
        for text in driven:
            answer = self.perform({"call": "reset", "channel": text, "raw": self._initialized[text][1]})
            if "error" in answer:
                failed[text] = answer["text"]
        if failed:
            self.opened = False
            with suppress(*FAILURES):
                self.on_call()
                self.driver.close()
        return failed

    def _open_again(self, outputs: Sequence[str]) -> str:
        """Open the driver and initialise its channels again, these outputs first. Return the reason if opening failed;
        otherwise ""."""
        try:
            self._do_open({})
            for text in dict.fromkeys([*outputs, *self._initialized]):
                channel, default = self._initialized[text]
                self.on_call()
                self.driver.initialize(channel, default)
        except FAILURES as error:
            return text_of(error) if not self.opened else ""  # each output is tried
        return ""


def _kind(error: BaseException) -> str:
    """Return the class of an error, as far as the other side distinguishes them."""
    if isinstance(error, ChannelsFailed):
        return "channels"
    if isinstance(error, TimeoutError):
        return "timeout"
    if isinstance(error, NoWatchdog):
        return "watchdog"
    return "driver" if isinstance(error, DriverError) else "other"


def error_of(answer: Mapping[str, Any]) -> DriverError:
    """Return the error of an answer in the form in which the driver raised it."""
    kind, text = answer["error"], answer["text"]
    if kind == "channels":
        return ChannelsFailed(answer["causes"])
    return {"timeout": DeviceTimeout, "watchdog": NoWatchdog}.get(kind, DriverError)(text)


def _as_plain(raw: Any) -> Any:
    """Return an integer for JSON; any other value unchanged, so that the caller notices it."""
    return raw if raw is None or isinstance(raw, int | str | float) else int(raw)
