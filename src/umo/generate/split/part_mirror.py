"""Keeps a part on the host equal to the part on its controller: attributes, values of actuators, references."""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from typing import Any, cast

from umo.cycle.machine import ConnectedMachine
from umo.generate.split.link_bodies import ControllerState, FrameItem, item
from umo.generate.split.part_plan import PartPlan
from umo.objects import Compound, Quality, walk


class PartMirror:
    """The values that the controller is known to have, and the values that the host has changed since."""

    def __init__(self, plan: PartPlan, machine: ConnectedMachine, part: Compound) -> None:
        self._plan, self._machine, self._image = plan, machine, machine.image
        slots = {each.path: slot for slot, each in enumerate(machine.image.items)}
        objects = plan.model.objects
        self._outputs = [slots[objects[slot].path] for slot in plan.model.outputs]
        """The slots on the host, by places of the controller."""
        inputs = [slots[each.path] for each in objects[: plan.model.inputs]]
        self._references = [(n, slot) for n, slot in enumerate(inputs) if not self._image.items[slot]._has_states]
        nodes = {each._path: each for each in (part, *walk(part))}
        self._equipment = [cast(Compound, nodes[each.path]) for each in plan.model.equipment]
        self._real = Struct("<d" if plan.real_size == 8 else "<f")
        owners = {each.path: each.owner for each in plan.translation.structs}
        named = (each.rpartition(".") for each in plan.translation.host_calls)
        self._calls = [(owners[path], name) for path, _, name in named]
        self.forget()

    def forget(self) -> None:
        """Record that the state of the controller is unknown, so that everything must be sent."""
        self._fields: list[bytes | None] = [None] * len(self._plan.fields)
        self._pending: list[bytes | None] = [None] * len(self._outputs)
        self._known: dict[int, bytes | None] = {}
        self._given: list[tuple[Any, int, bytes]] = []
        """Values that were sent and not confirmed: the field, its number, and its bytes."""
        self._items: list[bytes] = []
        """The items with these values, and the number of the first frame that had them."""
        self._first = 0
        self._inhibited = [False] * len(self._outputs)
        self._faults = [0] * len(self._equipment)
        self._asked = set[FrameItem]()
        """CLEAR and ACKNOWLEDGE, if they must be sent."""
        self._sent = set[FrameItem]()
        """The items for CLEAR and ACKNOWLEDGE in the last frame."""
        self._planned = 0
        """The number of the last request that was planned."""

    # To the controller -----------------------------------------------------------------------------------

    def inhibited(self) -> list[bool]:
        """Return the outputs that the host inhibits because of its interlocks, faults and clients; in manual mode all
        outputs."""
        if self._machine.is_manual:
            return [True] * len(self._outputs)
        return [self._machine.claims.inhibited(slot) is not None for slot in self._outputs]

    def changes(self, inhibited: list[bool], frame: int, *, all_of_it: bool = False) -> list[bytes]:
        """Return the items of the frame with this number. They make the controller's values equal to the host's, but at
        the start the values of actuators are those of the controller. While a frame is not answered, its items are sent
        again as items of that frame, because the frame may have been accepted, and only its answer lost."""
        if self._items:
            return [item(FrameItem.GIVEN, self._first), *self._items]
        found = []
        for number, each in enumerate(self._plan.fields):
            if (live := each.live()) != self._fields[number]:
                self._given.append((self._fields, number, live))
                found.append(item(FrameItem.FIELD, number, live))
        for place, slot in enumerate(self._outputs):
            wanted = self._real.pack(self._image.pending[slot])
            if wanted != self._pending[place]:
                self._given.append((self._pending, place, wanted))
                if not all_of_it:
                    found.append(item(FrameItem.COMMAND, place, wanted))
        found += self._changed_references()
        if any(was and not now for was, now in zip(self._inhibited, inhibited, strict=True)):
            self._asked.add(FrameItem.ACKNOWLEDGE)
        self._inhibited = inhibited
        self._sent = set(self._asked)
        found += [item(each, 0xFFFF) for each in sorted(self._sent)]
        if self._planned:
            found.append(item(FrameItem.PLANNED, self._planned))
        self._items, self._first = found, frame
        return found

    def _changed_references(self) -> Iterator[bytes]:
        image = self._image
        for number, slot in self._references:
            known = image.base[slot] is not Quality.UNREFERENCED
            data = bytes((known,)) + self._real.pack(float(image.scales.zero_offset[slot]))
            if data != self._known.get(number):
                self._given.append((self._known, number, data))
                yield item(FrameItem.REFERENCE, number, data)

    def confirm(self) -> None:
        """Record that the controller has carried out the last frame."""
        for where, number, data in self._given:
            where[number] = data
        self._given, self._items = [], []
        if FrameItem.CLEAR in self._sent:
            self._faults = [0] * len(self._faults)  # what is still in fault is told again
        self._asked -= self._sent
        self._sent = set()

    def clear(self) -> None:
        """Record that the equipment is cleared on the host."""
        if any(self._faults):
            self._asked.add(FrameItem.CLEAR)

    # From the controller ---------------------------------------------------------------------------------

    def take(self, state: ControllerState) -> None:
        """Copy the controller's values to the fields that the host has not changed."""
        at = 0
        for number, each in enumerate(self._plan.fields):
            if not each.changes:
                continue
            data = state.fields[at : at + each.size]
            at += each.size
            known = self._fields[number]
            if data != known and known is not None and each.live() == known:
                each.assign(data)
                self._fields[number] = data
        pending = self._image.pending
        for place, value in enumerate(state.pending):
            known, slot = self._pending[place], self._outputs[place]
            if known is not None and self._real.pack(pending[slot]) == known:
                pending[slot] = value
                self._pending[place] = self._real.pack(value)

    def plan(self, state: ControllerState) -> None:
        """Plan the motion that the controller has requested, once. The attributes that the plan changes are sent with
        the next frame."""
        if state.asks and state.asks != self._planned:
            self._planned = state.asks
            owner, name = self._calls[state.call]
            getattr(owner, name)(*state.numbers)

    def new_faults(self, state: ControllerState) -> Iterator[tuple[Compound, int]]:
        """Yield each equipment that has entered a fault on the controller, with the number of its fault."""
        for number, fault in enumerate(state.equipment):
            if fault and not self._faults[number]:
                yield self._equipment[number], fault
        self._faults = list(state.equipment)
