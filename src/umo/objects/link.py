"""The interface between connected objects and the process image and running machine.

The image is implemented in `umo.cycle`, above this layer. Objects use only these protocols.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NoReturn, Protocol

from umo.errors import EquipmentFault, NotConnected
from umo.objects.claims import Claim
from umo.objects.scaling import ByteArray, FloatArray, IntArray

if TYPE_CHECKING:
    from random import Random

    from umo.objects.node import Node


class Claims(Protocol):
    """The claims on actuators."""

    def inhibited(self, slot: int) -> str | None: ...
    def claim(self, slot: int) -> Claim: ...
    def acknowledge(self, slots: frozenset[int]) -> bool: ...


class Columns(Protocol):
    """The numbers of the process image as arrays. An object's slot is an index into each of these arrays."""

    values: FloatArray
    pending: FloatArray
    quality: ByteArray


class Image(Protocol):
    """The process image. An object's slot is an index into each of these columns."""

    write: Callable[[int, float], bool]
    """The function that writes a value within the range to the actuator with this slot. It returns True if the value
    was accepted."""
    values: memoryview[float]
    """The values: for sensors as last kept, for actuators as last accepted by the hardware."""
    pending: memoryview[float]
    """The values of actuators that were written and are to be sent."""
    raws: memoryview
    """The raw integers that belong to `values`."""
    quality: memoryview
    times: memoryview[float]
    """The times of the values in s on the cycle's clock."""
    wire_texts: Sequence[str]
    """The wiring of each object, such as `box:coil:3 inverted`."""
    sampled_good: bool | None
    """True if all synchronous sensors are GOOD; None if not known."""

    @property
    def columns(self) -> Columns: ...
    @property
    def claims(self) -> Claims: ...
    def read_now(self, slot: int) -> Any: ...
    def sample_some(self, slots: Sequence[int]) -> bool: ...
    def update_some(self, slots: Sequence[int]) -> bool: ...
    def reset_some(self, slots: Sequence[int]) -> None: ...
    def set_reading(self, slot: int, value: float) -> None: ...
    def velocity(self, slot: int) -> float: ...
    def set_referenced(self, slot: int, referenced: bool) -> None: ...
    def write_many(self, slots: slice | IntArray, each: Sequence[int], values: FloatArray) -> bool: ...


class Task(Protocol):
    """A started sequence. Another sequence may await the task; it gets the task's result, or TaskFailed if the task
    failed or was cancelled."""

    paused: bool
    """True if the task takes no steps, so that no time passes for it; default: False. A program may set this
    attribute."""

    @property
    def done(self) -> bool:
        """True if the task has ended, for any reason."""

    @property
    def result(self) -> Any:
        """The result of the task; None before its end, and if it failed or was cancelled."""

    def cancel(self) -> None:
        """Raise Cancelled inside the sequence, which may clean up."""

    def __await__(self) -> Generator[Any, Any, Any]: ...


class Clock(Protocol):
    """The cycle's clock. Times are in s."""

    period: float
    dt: float
    ticks: int
    """The number of ticks that the last reading of the timer consumed; above 1 if periods were missed."""

    @property
    def now(self) -> float: ...


class Machine(Protocol):
    """The connected machine as its compounds see it."""

    @property
    def clock(self) -> Clock: ...
    @property
    def period(self) -> float: ...
    @property
    def running(self) -> bool: ...
    @property
    def is_manual(self) -> bool: ...
    @property
    def random(self) -> Random: ...
    @property
    def laws(self) -> Sequence[tuple[Any, str, Any]]:
        """The laws that have loops, found when the machine was connected: each with the compound that has the law, and
        the path of the law."""

    @property
    def current_task(self) -> Task | None:
        """The started sequence that now takes a step or is being cancelled; None if there is none."""

    def sample(self, part: Node) -> bool: ...
    def update(self, part: Node) -> bool: ...
    def reset(self, part: Node) -> None: ...
    def acknowledge(self, part: Node) -> bool: ...
    def progress(self, text: str, done: int | None, total: int | None) -> None: ...
    def result(self, so_far: Any) -> None: ...
    def tell(self, path: str, text: str) -> None: ...
    def facts(self) -> Mapping[str, str]: ...
    def start(self, sequence: Coroutine[Any, Any, Any], part: Node) -> Task: ...
    def fault_of(self, part: Node) -> EquipmentFault | None: ...
    def is_in_fault(self, part: Node) -> bool: ...
    def fail(self, part: Node, error: BaseException) -> bool: ...
    def clear(self, part: Node) -> list[str]: ...


class Cycle:
    """The running cycle as a compound sees it: `m.cycle`. Outside `connect` all members except `connected` and
    `running` raise NotConnected."""

    __slots__ = ("_machine", "_part")

    def __init__(self, machine: Machine, part: Node) -> None:
        self._machine, self._part = machine, part

    def start(self, sequence: Coroutine[Any, Any, Any]) -> Task:
        """Start a sequence of this object. It runs from the next period on, in parallel with the other sequences.

        If the sequence fails, a sequence that awaits it gets TaskFailed. If no sequence of the same equipment awaits
        it, the equipment enters a fault; outside of equipment, `control` raises the error and the run ends. Raises
        EquipmentFault if the equipment is already in fault.
        """
        return self._machine.start(sequence, self._part)

    @property
    def fault(self) -> str | None:
        """The reason of the fault if the equipment that contains this object is in fault; otherwise None."""
        found = self._machine.fault_of(self._part)
        return None if found is None else found.reason

    def clear(self) -> list[str]:
        """End the fault of the equipment that contains this object, and of all equipment in it. Return their paths.

        Actuators, and the sensors that had failed, are initialised again; incremental sensors among them become
        UNREFERENCED. Then the equipment may be started again. Raises EquipmentFault while one of its sensors cannot be
        read, DriverError if an object cannot be initialised; then the equipment stays in fault.
        """
        return self._machine.clear(self._part)

    def progress(self, text: str, done: int | None = None, total: int | None = None) -> None:
        """Report what the machine is doing, and how much of its work is done: `m.cycle.progress("turning", 1, 3)`.

        The progress is shown by `umo run`, `umo show stations`, `umo show values` and the plot, and its first 64 bytes
        are in the frames. Numbers that are not given do not change. Raises RangeError unless the numbers are whole and
        0 or more.
        """
        self._machine.progress(text, done, total)

    def result(self, so_far: Any) -> None:
        """Report what the run has produced so far: plain data, or a function that returns them.

            m.cycle.result({"accepted": accepted, "rejected": rejected})
            m.cycle.result(lambda: shift.report())  # called once, at the end

        Unless the application returns a result, this is the result of the run, in its table and its summary. This holds
        however the run ends: an operator stops it, its time is over, or it fails. A later call replaces the result.
        Data are read at the end, so a dict can still be changed until then. A function is called when every actuator is
        at its default and the machine is no longer connected: the function may use counts of the program, but must not
        read objects.
        """
        self._machine.result(so_far)

    def tell(self, text: str) -> None:
        """Record an event of this object. `umo show stations`, the page, frames and black boxes show it. If the text is
        longer than 448 bytes, other processes see only its beginning."""
        self._machine.tell(self._part._path, text)

    @property
    def manual(self) -> bool:
        """True if the machine is in manual mode: the application waits."""
        return self.connected and self._machine.is_manual

    @property
    def connected(self) -> bool:
        return not isinstance(self._machine, Unconnected)

    @property
    def running(self) -> bool:
        """False after a request to stop (SIGINT, SIGTERM, SIGHUP), or if not connected."""
        return self.connected and self._machine.running

    @property
    def random(self) -> Random:
        """The random numbers of the machine. They are the same in each run with the same seed (`connect.seed`; default:
        0), so that a recording of the run can be replayed."""
        return self._machine.random

    @property
    def period(self) -> float:
        """The sampling period in s. For a part with another rate (`every`), or on a controller with a `cycle`, the
        period of the part."""
        return self._machine.period


class Unconnected:
    """Placeholder for image and machine outside `connect`: every access raises NotConnected."""

    __slots__ = ("_owner",)

    def __init__(self, owner: Node) -> None:
        self._owner = owner

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("_"):  # Python itself looks for these, `copy` even before there is an owner
            raise AttributeError(name)
        owner = self._owner
        raise NotConnected(
            f"{owner._path or type(owner).__name__} is not connected; "
            "use it inside `with connect(machine, wiring) as m:`"
        )
