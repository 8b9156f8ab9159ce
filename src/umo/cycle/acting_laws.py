"""The laws of a connected machine: the choice of the laws that act in a period, and their calls.

A law is the `control` of a class that defines one. The law of a parent acts before those of its parts; laws of
equipment in fault do not act.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from types import MethodType

from umo.cycle.equipment import Containment, Equipment, fault_reason
from umo.cycle.image import Image
from umo.cycle.not_awaited import expects_errors
from umo.cycle.rate_groups import RateGroups
from umo.cycle.writes import Turn
from umo.errors import forget_frames
from umo.objects import Node, walk
from umo.user_code import is_interrupt, refuse_exit

_IS_IN_FAULT = attrgetter("in_fault")


def _idle(part: Node) -> None:
    """Do nothing: the law of equipment in fault."""


class ActingLaws:
    """The laws of one machine, distributed to its rate groups."""

    def __init__(self, root: Node, image: Image, equipment: Containment, turn: Turn) -> None:
        self._root, self._equipment = root, equipment
        self.groups = RateGroups(image)
        """The groups of parts with one rate."""
        self.whole = self.groups.whole
        """The group of the whole machine."""
        self._turn = turn
        """The code that now takes a step."""
        self._of: dict[int, list[MethodType]] = {}
        """The laws of each part whose laws were requested, by the id of the part."""
        self._elsewhere: set[int] = set()
        """The ids of the parts and laws that capabilities carry out."""
        self._places: dict[int, list[tuple[list[MethodType], int]]] = {}
        """The indices of the laws of each equipment, by the id of the equipment. They are computed at the first fault
        of the equipment after the laws were chosen."""
        self.stale = False
        """True if equipment was cleared, or has entered a fault, since the laws were chosen."""

    # Which laws act -----------------------------------------------------------------------------------

    def of(self, part: Node) -> list[MethodType]:
        """Return the laws of a part, in the order in which they act. They are collected once."""
        if id(part) not in self._of:
            nodes = [node for node in (part, *walk(part)) if id(node) not in self._elsewhere]
            own = [(type(node).control, node) for node in nodes if type(node).control is not Node.control]
            # not node.control: that of a connected compound drives the whole part
            self._of[id(part)] = [MethodType(control, node) for control, node in own]
        return self._of[id(part)]

    def choose(self) -> None:
        """Distribute the laws, without those of equipment in fault. The lists are new, so that a law of cleared
        equipment does not act in the period in progress."""
        self.stale, self._places = False, {}
        for group in self.groups.all:
            group.laws = []
        for law in self.of(self._root):
            if not any(map(_IS_IN_FAULT, self._around(law))):
                self.groups.of(law.__self__).laws.append(law)  # type: ignore[arg-type]

    def let_idle(self, equipment: Equipment) -> None:
        """Stop calling the laws of equipment, even if laws are being called now."""
        if not self._places:
            for group in self.groups.all:
                for number, law in enumerate(group.laws):
                    for each in self._around(law):
                        self._places.setdefault(id(each), []).append((group.laws, number))
        for laws, number in self._places.get(id(equipment), ()):
            laws[number] = MethodType(_idle, laws[number].__self__)

    def replace(self, laws: Sequence[MethodType]) -> None:
        """Replace the laws of the whole machine by other functions, each of the same object, in the same order."""
        self._of[id(self._root)] = list(laws)
        self.choose()

    def leave_out(self, part: Node) -> None:
        """Stop calling the laws of this part, because a capability carries them out."""
        self._elsewhere.update(map(id, (part, *walk(part))))
        self._of.clear()
        self.choose()

    def _around(self, law: MethodType) -> tuple[Equipment, ...]:
        return self._equipment.around(law.__self__ if isinstance(law.__self__, Node) else None)

    # Calling them ---------------------------------------------------------------------------------------

    @expects_errors
    def act(self, acting: Sequence[MethodType]) -> None:
        """Call the laws of a group. An error that equipment contains does not keep the other laws from acting."""
        turn, laws = self._turn, iter(acting)
        before = turn.law
        try:
            for law in laws:
                turn.law = law
                law()
        except BaseException as error:
            equipment = self.containing(law.__self__, error)
            if equipment is None:
                refuse_exit(error, "control")
                raise
            failed = {equipment: fault_reason(equipment, error)}
            forget_frames(error)
            self._act_on(laws, failed)
        finally:
            turn.law = before

    @expects_errors
    def _act_on(self, laws: Iterator[MethodType], failed: dict[Equipment, Callable[[], str]]) -> None:
        """Call the remaining laws of a group after one law has failed."""
        turn = self._turn
        while True:
            try:
                for law in laws:
                    turn.law = law
                    law()
                break
            except BaseException as error:
                equipment = self.containing(law.__self__, error)
                if equipment is None:
                    refuse_exit(error, "control")
                    raise
                failed.setdefault(equipment, fault_reason(equipment, error))
                forget_frames(error)
            finally:
                turn.law = None
        self._equipment.enter(failed)

    @expects_errors
    def act_for(self, part: Node) -> None:
        """Call the laws of a part, for a program that has its own loop. An error of one law ends the call."""
        turn = self._turn
        before = turn.law
        try:
            for law in self.of(part):
                turn.law = law
                law()
        except BaseException as error:
            refuse_exit(error, "control")
            raise
        finally:
            turn.law = before

    def containing(self, part: object, error: BaseException) -> Equipment | None:
        """Return the equipment that contains an error; None if it is an error of the machine."""
        return self._equipment.innermost(part) if isinstance(part, Node) and not is_interrupt(error) else None
