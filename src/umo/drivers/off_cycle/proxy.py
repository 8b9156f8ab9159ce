"""The machine's substitute for a driver that is off the cycle.

While the machine is being connected and disconnected, each call is a request to the worker process, and waits for the
answer. While the machine runs no call waits: written values are posted, and read values are those that have arrived.
Without a worker process this process makes the calls: in virtual time, with `connect` in the user's process, and when
the worker has died and the machine is being reset.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from time import sleep
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from umo.drivers.contract import Channel, Driver, IntArray
from umo.drivers.off_cycle.device_server import DeviceServer, error_of
from umo.drivers.off_cycle.shared_memory import NO_TIME, Cell, Exchange, Order, Row, Wanted
from umo.drivers.optional import KnowsAges
from umo.drivers.wrapping import Wrapper
from umo.errors import ChannelsFailed, DeviceTimeout, DriverError

LOOK_INTERVAL = 0.0005
"""Time in s between two looks for an answer."""
MARGIN = 1.0
"""The time in s, in addition to twice the timeout, for which the worker may give no heartbeat during a request."""


def generation_of(rows: IntArray) -> int:
    """Return the number of times that the outputs had been initialised when these values were posted."""
    return int(rows[Row.GENERATION].max(initial=0))


class Worker:
    """The worker process of a driver, as seen by the processes that send it requests."""

    def is_gone(self) -> bool:
        """Return True if the worker process has ended."""
        raise NotImplementedError

    def silence(self) -> float:
        """Return the time in s since the last heartbeat of the worker process."""
        raise NotImplementedError


class OffCycle(Wrapper):
    """A driver off the cycle. The channels that the machine uses are known.

    `own_period`: the time in s from one transfer to the next. `max_age`: the age in s from which on a value is STALE.
    `defaults`: the raw integer of each channel that the machine uses, None for an input, by the channel's text.
    """

    withheld = (*Wrapper.withheld, KnowsAges)  # each value has its stamp
    shared = True
    """True if a worker process has the same exchange."""

    def __init__(self, driver: Driver[Any], own_period: float, max_age: float) -> None:
        super().__init__(driver)
        self.own_period, self.max_age = own_period, max_age
        self.exchange = Exchange(())
        self.server = DeviceServer(driver, self.exchange, own_period)
        self.worker: Worker | None = None
        """The worker; None if the calls are made in this process."""
        self.running = False
        """True if no call waits."""
        self.pause: Callable[[float], object] = sleep
        """The function that waits for an answer, in s."""
        self.fault_time: Callable[[], int] = lambda: NO_TIME
        """The machine's time in ns, by which injected faults act; NO_TIME if there are no faults."""
        self.generation = 0
        """The number of initialisations of the outputs that the machine knows."""
        self.read_rows: IntArray = self.exchange.arrivals.read()[1]
        """The values read last, with their stamps."""
        self._wanted: IntArray
        self._plans: dict[tuple[Channel, ...], IntArray] = {}

    def meet(self, channels: Sequence[Channel], inputs: Sequence[Channel], outputs: Sequence[Channel]) -> None:
        """Set the channels of the machine: those that each transfer reads, and those that it writes."""
        self.exchange = Exchange(channels, self.shared)
        self.server = DeviceServer(self.driver, self.exchange, self.own_period)
        place = self.exchange.place
        self.server.assign([place[each.text] for each in inputs], [place[each.text] for each in outputs])
        self._wanted = self.exchange.wanted.read()[1]

    # Requests ------------------------------------------------------------------------------------------

    def request(self, call: str, **content: Any) -> Any:
        """Request a call of the driver, and wait for its answer. Raises DeviceTimeout if the worker gives no
        heartbeat."""
        request = {"call": call, "timeout": self.driver.timeout, "now": self.fault_time(), **content}
        answer = self.server.perform(request) if self.worker is None else self._ask(self.worker, request)
        if "error" in answer:
            raise error_of(answer)
        return answer["value"]

    def _ask(self, worker: Worker, request: Mapping[str, Any]) -> dict[str, Any]:
        number = self.exchange.ask(dict(request))
        limit = MARGIN + 2 * self.driver.timeout
        while (answer := self.exchange.answered(number)) is None:
            if worker.is_gone() and (answer := self.exchange.answered(number)) is None:
                raise DeviceTimeout("its worker process has ended")
            if worker.silence() > limit:
                raise DeviceTimeout(f"its worker process sends no heartbeat for {limit:g} s")
            self.pause(LOOK_INTERVAL)
        return answer

    def call_here_if_alone(self) -> None:
        """Make the calls in this process if the worker has ended, because no other process then holds the device."""
        if self.worker is not None and self.worker.is_gone():
            self.worker = None
            self.server.opened = False

    def open(self) -> None:
        self.request("open")

    def close(self) -> None:
        self.request("close")

    def watchdog(self, seconds: float) -> None:
        self.request("watchdog", seconds=seconds)

    def report(self) -> Mapping[str, Any]:
        report: Mapping[str, Any] = self.request("report")
        return report

    def inspect(self, channel: Channel) -> str:
        line: str = self.request("inspect", channel=channel.text)
        return line

    def finalize(self, channel: Channel) -> None:
        self.request("finalize", channel=channel.text)

    def look(self) -> bool | None:
        found: bool | None = self.request("look")
        return found

    def initialize(self, channel: Channel, default: int | None) -> None:
        if self.running:
            self._order(channel, Order.INITIALIZE, default)
        else:
            self.request("initialize", channel=channel.text, raw=default)

    def reset(self, channel: Channel, default: int | None) -> None:
        if self.running:
            self._order(channel, Order.RESET, default)
        else:
            self.request("reset", channel=channel.text, raw=default)

    def read(self, channel: Channel) -> int:
        if not self.running:
            raw: int = self.request("read", channel=channel.text)
            return raw
        number = self.exchange.place[channel.text]
        rows = self.read_rows = self.exchange.arrivals.read()[1]
        if rows[Row.STAMP, number] == NO_TIME:
            raise DriverError(self.cause(number))
        return int(rows[Row.RAW, number])

    def write(self, channel: Channel, raw: int) -> None:
        channel.check(raw)
        if self.running:
            self._order(channel, Order.WRITE, raw)
        else:
            self.request("write", channel=channel.text, raw=raw)

    def read_many(self, channels: Sequence[Channel], out: IntArray) -> None:
        if not self.running:
            found = self.request("read_many", channels=[channel.text for channel in channels])
            out[:] = found["raws"]
            if found["causes"]:
                raise ChannelsFailed(found["causes"])
            return
        places = self.places(channels)
        rows = self.read_rows = self.exchange.arrivals.read()[1]
        out[:] = rows[Row.RAW, places]
        never = np.flatnonzero(rows[Row.STAMP, places] == NO_TIME).tolist()
        if never:
            raise ChannelsFailed({channels[i].text: self.cause(int(places[i])) for i in never})

    def write_many(self, channels: Sequence[Channel], raws: IntArray) -> None:
        if not self.running:
            self.request("write_many", channels=[channel.text for channel in channels], raws=raws.tolist())
            return
        places = self.places(channels)
        if not np.array_equal(self._wanted[Wanted.RAW, places], raws):
            self._wanted[Wanted.RAW, places] = raws
            self.exchange.wanted.post(self._wanted)

    # While the machine runs ------------------------------------------------------------------------------

    def begin(self) -> None:
        """Begin the cyclic transfers, so that no call waits. The first transfer has been made, or has failed, when this
        returns."""
        self.request("begin")
        self.running = True
        self.exchange.cells[Cell.CYCLIC] = 1
        self.accept_generation(self.exchange.arrivals.read()[1])

    def end(self) -> None:
        """Make each call a request again. The worker then makes no calls by itself."""
        self.exchange.cells[Cell.CYCLIC] = 0
        self.running = False

    def accept_generation(self, rows: IntArray) -> None:
        """Post values for the generation of outputs to which these values belong (`generation_of`), and cancel all
        orders."""
        self.generation = generation_of(rows)
        self._wanted[Wanted.RAW], self._wanted[Wanted.ORDER] = rows[Row.RAW], rows[Row.ORDER]
        self._wanted[Wanted.GENERATION] = self.generation
        self.exchange.wanted.post(self._wanted)

    def _order(self, channel: Channel, call: Order, raw: int | None) -> None:
        """Order a call for one channel. An earlier order for the channel that was not carried out yet is replaced."""
        number, wanted = self.exchange.place[channel.text], self._wanted
        if raw is not None:
            wanted[Wanted.RAW, number] = raw
        wanted[Wanted.CALL, number] = call
        wanted[Wanted.ORDER, number] += 1
        self.exchange.wanted.post(wanted)

    def order(self, number: int) -> int:
        """Return the number of the last order for a channel, by the channel's number."""
        return int(self._wanted[Wanted.ORDER, number])

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Post and request nothing in this process any more. `instead` is called in place of each call."""
        self.request = self.exchange.wanted.post = instead  # type: ignore[method-assign]

    def places(self, channels: Sequence[Channel]) -> IntArray:
        """Return the numbers of channels; a plan is kept for each tuple of them."""
        key = tuple(channels)
        if (places := self._plans.get(key)) is None:
            places = self._plans[key] = np.array([self.exchange.place[each.text] for each in key], np.int64)
        return places

    def carried_out(self, number: int, place: int, rows: IntArray) -> bool:
        """Return True if an order for a channel was already carried out when these values were posted. Order and
        channel are given by their numbers."""
        return bool(rows[Row.ORDER, place] >= number)

    def times(self, places: IntArray, stamps: IntArray, now: float, now_ns: int) -> npt.NDArray[np.float64]:
        """Return the times in s on the cycle's clock of values of these channels, by their stamps; NaN for values that
        never arrived. `now` is the time on the cycle's clock at the stamp `now_ns`."""
        return np.where(stamps == NO_TIME, np.nan, now - (now_ns - stamps) * 1e-9)  # below 0: since the last tick

    def cause(self, number: int) -> str:
        """Return the reason why a channel has no new value."""
        return self.causes([number])[0]

    def causes(self, numbers: Sequence[int]) -> list[str]:
        """Return the causes of several channels."""
        exchange = self.exchange
        if self.worker is not None and self.worker.is_gone():
            return ["its worker process has ended"] * len(numbers)
        if exchange.cells[Cell.AWAY_SINCE] != NO_TIME:
            return [f"its device is away: {exchange.cause(-1)}"] * len(numbers)
        return [exchange.cause(number) or "no value has arrived in time" for number in numbers]
