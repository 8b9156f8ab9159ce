"""The ways in which the image brings actuators to their defaults, and the continuation of a device after it was
initialised."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum, auto
from math import inf
from typing import Protocol

from umo.cycle.columns import Source
from umo.cycle.deliveries import ImageOutputs
from umo.cycle.readings import ImageInputs
from umo.drivers.contract import Direction
from umo.errors import Failure
from umo.objects import Actuator, Quality, link
from umo.objects.scaling import FloatArray


class ToDefault(Enum):
    """The way in which an actuator is moved when it is brought to its default."""

    RESET = auto()
    """The driver's `reset` is called now, and the rate is not limited."""
    INITIALIZE = auto()
    """The driver's `initialize` is called now, and the rate is not limited."""
    SEND = auto()
    """The period sends the default with its outputs, within the rate; an asynchronous actuator is written now."""
    IS_THERE = auto()
    """Nothing is sent, because the device has already been initialised."""


class Taken(link.Claims, Protocol):
    """The claims of the machine (`umo.cycle.claim_table`)."""

    def end_client(self, slot: int) -> None:
        """Record that the actuator is at its default. A client that had taken the actuator no longer has it."""


class Gate(Protocol):
    """The command stage, which checks writes that the column `restrictions` marks (`umo.cycle.command_stage`)."""

    def accept(self, slot: int, value: float, source: Source = Source.PROGRAM) -> bool:
        """Return True if a value within the range may be written; raises Interlocked if an interlock with the effect
        "stop" inhibits it."""

    def accept_many(self, slots: Sequence[int], values: FloatArray) -> list[bool]:
        """Handle many writes in one call. Return one answer for each write. If the function raises Interlocked, no
        write was accepted."""

    def rest(self, slot: int) -> None:
        """Record that the actuator is being brought to its default, so that earlier writes are void."""


class ImageDefaults(ImageInputs, ImageOutputs):
    """The slots of a connected machine, and the functions that bring them to their defaults."""

    claims: Taken
    commands: Gate

    def settle(self, slots: Iterable[int], way: ToDefault) -> dict[int, Failure]:
        """Bring actuators to their defaults. This function is the only way to do so. Before the first one is written,
        all earlier writes are void, and all defaults are pending. Sensors among the slots are reset or initialised by
        their driver. Return the failures by slot. A failure never prevents the calls for the other slots."""
        return {slot: failure for slot, failure in self.settling(slots, way) if failure is not None}

    def settling(self, slots: Iterable[int], way: ToDefault) -> Iterator[tuple[int, Failure | None]]:
        """Bring outputs to their defaults. Yield each actuator after its write, so that after an interruption it is
        known which actuators remain."""
        slots = list(slots)
        for slot in slots:
            if self.items[slot].direction is Direction.OUTPUT:
                self.commands.rest(slot)
                self.set_default(slot)
                if way is not ToDefault.SEND:
                    self._give_default(slot)
        return _MOVES[way](self, slots)

    def _reset(self, slots: Sequence[int]) -> Iterator[tuple[int, Failure | None]]:
        for slot, failure in self.segments.bring_to_default(slots):
            self._was_reset(slot, failure)
            yield slot, failure

    def _initialize(self, slots: Sequence[int]) -> Iterator[tuple[int, Failure | None]]:
        for slot in slots:
            failure = self.segments.initialize(slot)
            self._was_reset(slot, failure)
            if (conditioner := self.conditioners.get(slot)) is not None:
                conditioner.begin()
            yield slot, failure

    def _send(self, slots: Sequence[int]) -> Iterator[tuple[int, Failure | None]]:
        for slot in slots:
            yield slot, next(iter(self.deliveries[slot].written(slot)), None)

    def _is_there(self, slots: Sequence[int]) -> Iterator[tuple[int, Failure | None]]:
        for slot in slots:
            self.accepted(slot)
            yield slot, None

    def _was_reset(self, slot: int, failure: Failure | None) -> None:
        if failure is not None:
            self.set_quality(slot, Quality.BAD)
        if self.items[slot].direction is not Direction.OUTPUT:
            return
        if failure is None:
            self.accepted(slot)
            return
        if self.values[slot] != self.sent[slot]:
            self.stepped[slot] = inf  # `update` sends the default, without a limit, until it is accepted
        self.deliveries[slot].refused(slot)

    def path_if_default_kept(self, slot: int) -> str:
        """Return the path of an actuator that is away from its default, and that will stay at its default once its
        device is initialised again, because nothing sends its value again. "" for any other object."""
        item = self.items[slot]
        stays = isinstance(item, Actuator) and not (self.deliveries[slot].survives(slot) or self.is_at_default(slot))
        return item.path if stays else ""

    def initialize_again(self, slot: int) -> Failure | None:
        """Initialise an object whose device was away, and return the failure. The object is then at its default;
        `update` continues from there to the pending value. The value of an asynchronous actuator with on_error="retry"
        is sent again; any other asynchronous actuator stays at its default. An incremental sensor becomes
        unreferenced."""
        if (failure := self.segments.initialize(slot)) is None:
            self.was_initialized_again(slot)
        return failure

    def was_initialized_again(self, slot: int) -> None:
        """Record that the driver has initialised the object again."""
        item = self.items[slot]
        if isinstance(item, Actuator):
            if self.deliveries[slot].survives(slot):
                self._goes_on_from_default(slot)
            else:
                self.settle([slot], ToDefault.IS_THERE)
                self.claims.end_client(slot)
            return
        if (conditioner := self.conditioners.get(slot)) is not None:
            conditioner.begin()
        if self.base[slot] is not Quality.UNREFERENCED and item._incremental:
            self.set_referenced(slot, False)

    def _goes_on_from_default(self, slot: int) -> None:
        """Record that the device is at its default, and keep the pending value."""
        self._give_default(slot)
        self.does_not_wait(slot)
        self.accepted(slot)
        self.deliveries[slot].goes_on(slot)

    def initialize(self, slot: int) -> Failure | None:
        return self.settle([slot], ToDefault.INITIALIZE).get(slot)


_MOVES: Mapping[ToDefault, Callable[[ImageDefaults, Sequence[int]], Iterator[tuple[int, Failure | None]]]] = {
    ToDefault.RESET: ImageDefaults._reset,
    ToDefault.INITIALIZE: ImageDefaults._initialize,
    ToDefault.SEND: ImageDefaults._send,
    ToDefault.IS_THERE: ImageDefaults._is_there,
}
