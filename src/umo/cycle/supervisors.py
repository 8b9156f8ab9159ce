"""The laws that look after the sequences of their parts, such as state machines (`umo.operation`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from umo.cycle.acting_laws import ActingLaws
from umo.cycle.directory import Directory
from umo.cycle.equipment import Containment, Equipment
from umo.cycle.not_awaited import expects_errors
from umo.errors import forget_frames
from umo.objects import Compound
from umo.objects.node import outwards
from umo.user_code import refuse_exit

METHODS = ("begin", "supervise", "note_faults", "describe")
"""The methods by which a law is a `Supervisor`."""


class Supervisor(Protocol):
    """A law that looks after the sequences of its part."""

    part: Compound
    """Its part: what `supervise` raises is a failure of this."""

    def begin(self, path: str) -> None:
        """The machine is being connected; the law has this place in it. DeclarationError where it cannot be."""

    def supervise(self) -> None:
        """Called once per period, before the sequences; also in manual mode, and while its part is in fault."""

    def note_faults(self) -> None:
        """Equipment has come into fault, perhaps that around its part. It may be cleared before the next period; what
        was under way in it is ended after this call."""

    def describe(self) -> Mapping[str, Any]:
        """Its path, its states and its commands, as plain data."""


class Supervisors:
    """The laws of one machine that look after sequences."""

    def __init__(self, directory: Directory, equipment: Containment, laws: ActingLaws) -> None:
        self._equipment, self._laws = equipment, laws
        self.all: list[Supervisor] = []
        self._within: dict[int, list[Supervisor]] = {}
        """Those of the parts in each compound, by its id."""
        for path, law in directory.having(*METHODS):
            law.begin(path)
            self.all.append(law)
            for node in outwards(law.part):
                self._within.setdefault(id(node), []).append(law)

    def note_faults(self, faults: Iterable[Equipment]) -> None:
        """This equipment has come into fault."""
        found = [law for each in faults for law in self._within.get(id(each.compound), ())] if self.all else []
        for law in {id(law): law for law in found}.values():
            law.note_faults()

    @expects_errors
    def act(self) -> None:
        """One after the other. What comes into fault is settled together."""
        self._equipment.gather()
        try:
            for each in self.all:
                try:
                    each.supervise()
                except BaseException as error:
                    if not self._contain(each, error):
                        refuse_exit(error, "supervise")
                        raise
        finally:
            self._equipment.settle()

    def _contain(self, law: Supervisor, error: BaseException) -> bool:
        """Its part fails; False if that is the machine itself. While the part is in fault, the law is called all the
        same, and what it raises is not told in every period."""
        if self._laws.containing(law.part, error) is None:
            return False
        if not self._equipment.is_in_fault(law.part):
            self._equipment.contain(law.part, error)
        forget_frames(error)
        return True
