"""The connected machine: what `sample`, `control`, `update` and `reset` of the root and its parts come to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from time import monotonic_ns
from typing import Any

from umo.cycle.clock import Clock
from umo.cycle.frame import Frame, Observer, show
from umo.cycle.guards import Event, Guards
from umo.cycle.image import Image
from umo.cycle.sequences import Sequences, Task
from umo.cycle.signals import StopFlag
from umo.drivers.contract import Direction
from umo.errors import DriverError
from umo.objects import Compound, Node


class ConnectedMachine:
    """Behind the compounds of one machine from `connect` to its end (`umo.objects.link.Machine`)."""

    def __init__(self, root: Compound, image: Image, stop: StopFlag) -> None:
        self.root = root
        self.image = image
        self.clock: Clock = image.clock
        self.stop = stop
        self.sequences = Sequences()
        self.observers: list[Observer] = []
        """Called after every period with its frame."""
        self.frame = Frame(image)
        self._slots: dict[int, tuple[list[int], list[int], list[int]]] = {}
        self._acts: dict[int, list[Callable[[], None]]] = {}
        self._started = 0
        try:
            self.guards = Guards(root, image)
        except BaseException:
            image.disconnect()
            raise
        self.clock.on_tick = self._tick
        self._compounds = [root, *(node for node in root.walk() if isinstance(node, Compound))]
        for compound in self._compounds:
            compound._connect(self)
        self._root_acts = self._overrides(root)
        if type(root).sample is Compound.sample:
            # the loop's own calls, without the way over `self.sample`
            root.__dict__["sample"] = self._guarded_sample if self.guards else image.sample
        if type(root).update is Compound.update:
            root.__dict__["update"] = self._update

    def disconnect(self) -> None:
        self.root.__dict__.pop("sample", None)
        self.root.__dict__.pop("update", None)
        for compound in self._compounds:
            compound._disconnect()

    @property
    def running(self) -> bool:
        return not self.stop.requested

    @property
    def period(self) -> float:
        return self.clock.period

    @property
    def dt(self) -> float:
        return self.clock.dt

    @property
    def now(self) -> float:
        return self.clock.now

    def sample(self, part: Compound) -> bool:
        if part is self.root:
            return self._guarded_sample()
        return self.image.sample_some(self._slots_of(part)[0])

    def _guarded_sample(self) -> bool:
        """The guards are looked at when sensors failed, too; one DriverError lists what both could not reach."""
        try:
            good = self.image.sample()
        except DriverError as unread:
            try:
                self.guards.evaluate()
            except DriverError as unreset:
                raise DriverError("could not be read or reset", [*unread.failures, *unreset.failures]) from unread
            raise
        self.guards.evaluate()
        return good

    @property
    def events(self) -> deque[Event]:
        """What guards did, the last thousand times."""
        return self.guards.events

    def control(self, part: Compound) -> None:
        """Sequences first (the root's alone), then each overridden `control`, a parent before its parts."""
        if part is self.root:
            self.sequences.advance(self.clock)
            acts = self._root_acts
        else:
            acts = self._overrides(part)
        for act in acts:
            act()

    def update(self, part: Compound) -> bool:
        return self._update() if part is self.root else self.image.update_some(self._slots_of(part)[1])

    def _update(self) -> bool:
        try:
            return self.image.update()
        finally:
            if self.observers:
                self._show()

    def reset(self, part: Compound) -> None:
        self.image.reset_some(self._slots_of(part)[2])

    def start(self, sequence: Coroutine[Any, Any, Any]) -> Task:
        return self.sequences.start(sequence)

    def _tick(self) -> None:
        self._started = monotonic_ns()

    def _show(self) -> None:
        frame, clock = self.frame, self.clock
        frame.began = self._started
        frame.execution = (monotonic_ns() - self._started) * 1e-9
        frame.number, frame.time, frame.missed = clock.number, clock.now, clock.missed
        show(frame, self.observers)

    def _slots_of(self, part: Compound) -> tuple[list[int], list[int], list[int]]:
        """The slots to sample, to update and to reset."""
        if id(part) not in self._slots:
            slot_of = self.image.slot_of
            atoms = list(part.atoms())
            moved = [atom for atom in atoms if atom.synchronous]
            self._slots[id(part)] = (
                [slot_of[id(atom)] for atom in moved if atom.direction is Direction.INPUT],
                [slot_of[id(atom)] for atom in moved if atom.direction is Direction.OUTPUT],
                [slot_of[id(atom)] for atom in atoms],
            )
        return self._slots[id(part)]

    def _overrides(self, part: Compound) -> list[Callable[[], None]]:
        """The `control` of every class that has its own, in pre-order; collected once, called flat."""
        if id(part) not in self._acts:
            nodes: list[Node] = [part, *part.walk()]
            self._acts[id(part)] = [_bound(node) for node in nodes if type(node).control is not Node.control]
        return self._acts[id(part)]


def _bound(node: Node) -> Callable[[], None]:
    own = type(node).control  # not node.control: on a connected compound that drives the whole part
    return partial(own, node)
