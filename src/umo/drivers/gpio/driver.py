"""Digital lines of a GPIO chip, through the character device of Linux (version 2, from Linux 5.10)."""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from contextlib import suppress
from time import monotonic
from typing import TYPE_CHECKING, Literal, TypeVar

from umo.drivers._block_driver import BlockDriver, Plans
from umo.drivers._library import library
from umo.drivers.contract import IntArray
from umo.drivers.gpio.channel import GpioChannel, checked, parse
from umo.errors import DriverError, WiringError
from umo.system.packages import how_to_install

if TYPE_CHECKING:
    from umo.drivers.gpio.lines import Lines, LineTransfer

T = TypeVar("T")


class Gpio(BlockDriver[GpioChannel]):
    """The lines of one GPIO chip.

    Channels: `line:N` or `line:NAME`, a line of the chip by its number or name; `lines:4-11` or `lines:A,B,C`, up to 63
    lines as one number, in which the first line is the lowest bit; `edges:N[:rising|falling|both]`, the number of edges
    since the channel was initialised (rising edges by default). Words after a space are settings of the lines, for
    example `line:7 bias=pull-up debounce=5ms`.

    Options:
        chip: path, name or label, such as "/dev/gpiochip0", "gpiochip0" or "pinctrl-bcm2835".
        bias: "as-is", "disabled", "pull-up" or "pull-down", of inputs and outputs.
        drive: "push-pull", "open-drain" or "open-source", of outputs.
        active_low: a line is 1 when its voltage is low.
        debounce: time for which an input must be stable before a change counts, such as "5 ms"; "0 ms": none.
    These are the defaults for all channels.

    A line whose channel is initialised with a default is an output, and begins at this default; any other line is an
    input. `open` takes the lines of the wiring as they are: direction and level of a line change when it is
    initialised. Lines of the chip that are not in the wiring are not touched. When the driver is closed the kernel
    releases the lines. The chip then determines their levels, so an output needs a pull resistor towards its safe
    level.

    All lines of a period are transferred by one system call per 64 lines. Source: Documentation/userspace-api/gpio of
    the Linux kernel.
    """

    def __init__(
        self,
        *,
        chip: str = "/dev/gpiochip0",
        bias: Literal["as-is", "disabled", "pull-up", "pull-down"] = "as-is",
        drive: Literal["push-pull", "open-drain", "open-source"] = "push-pull",
        active_low: bool = False,
        debounce: str = "0 ms",
    ) -> None:
        if not isinstance(chip, str) or not chip:
            raise WiringError(f"chip must be the path, name or label of a GPIO chip, not {chip!r}")
        self.chip = chip
        self._settings = checked(bias, drive, active_low, debounce)
        self._library = library("umo.drivers.gpio.lines", "gpiod")
        self._named: dict[str, GpioChannel] = {}
        self._lines: Lines | None = None
        self._reads, self._writes = Plans(self._plan), Plans(self._plan)

    def channel(self, text: str) -> GpioChannel:
        self._named[text] = channel = parse(text, self._settings)
        return channel

    def devices(self) -> Sequence[str]:
        """Return the chip's device file, regardless of how the option names it. If the chip does not exist, return it
        as the option names it."""
        if self._library is not None:
            from umo.drivers.gpio.chip import path_of

            with suppress(OSError):
                return [f"gpio {path_of(self.chip)}"]
        return [f"gpio {self.chip}"]

    def open(self) -> None:
        """Take the lines of the wiring as they are. A line that is in use is refused later, when it is initialised."""
        if self._library is None:
            raise DriverError(f"the gpio driver needs gpiod: {how_to_install('gpio')}")
        self._lines = self._library.Lines(self.chip)
        self._begin()

    def close(self) -> None:
        self._forget()
        if self._lines is not None:
            self._lines.disconnect()
            self._lines = None

    def initialize(self, channel: GpioChannel, default: int | None) -> None:
        """Initialise the channel: an output goes directly to its default, an input line is set to input, a count starts
        at 0. If another process of umo is about to release the line, wait for it within `timeout`."""
        lines = self._begin()
        self._forget()
        self._called(lambda: lines.initialize(channel, default, monotonic() + self.timeout))

    def finalize(self, channel: GpioChannel) -> None:
        """End the use of the channel. A line keeps its direction and level until the driver is closed."""
        self._forget()
        if self._lines is not None:
            self._lines.finalize(channel)

    def reset(self, channel: GpioChannel, default: int | None) -> None:
        """Bring an output to its default, even one that was not initialised; an input and a count are not changed."""
        if default is None:
            return
        if self._lines is None or self._lines.used.get(channel) is None:
            self.initialize(channel, default)
        else:
            self.write(channel, default)

    def read_many(self, channels: Sequence[GpioChannel], out: IntArray) -> None:
        self._begin()
        out[:] = self._called(lambda: self._reads.of(channels).read())

    def _write(self, channels: Sequence[GpioChannel], raws: list[int]) -> None:
        self._begin()
        self._called(lambda: self._writes.of(channels).write(raws))

    def _plan(self, channels: tuple[GpioChannel, ...]) -> LineTransfer:
        return self._begin().plan(channels)

    def _forget(self) -> None:
        """Discard the plans of all transfers, because the lines have changed."""
        self._reads.clear()
        self._writes.clear()

    def _begin(self) -> Lines:
        """Return the lines of the open chip. A chip that had gone is opened again, and its lines are initialised as
        before."""
        if self._lines is None:
            raise DriverError("it is not open")
        if not self._lines.connected:
            self._forget()
            lines = self._lines
            try:
                self._called(lambda: lines.connect(self._named.values(), monotonic() + self.timeout))
            except DriverError:
                lines.disconnect()
                raise
        return self._lines

    def _called(self, call: Callable[[], T]) -> T:
        """Make a call of the chip. Raises DriverError if the system refuses it."""
        try:
            return call()
        except DriverError:
            raise
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> DriverError:
        """Return the error. A chip that has gone is released; the next call opens it again."""
        if self._lines is not None and error.errno == errno.ENODEV:
            self._forget()
            self._lines.disconnect()
            return DriverError(f"{self._lines.name}: the chip has gone")
        return DriverError(f"{self.chip}: {error.strerror or error}")
