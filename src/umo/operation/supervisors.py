"""The capability (`umo.cycle.capability`) that carries out the states of parts (`UnitStates`) in a machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from umo.cycle.capability import Capability
from umo.cycle.equipment import Equipment
from umo.cycle.not_awaited import expects_errors
from umo.errors import forget_frames
from umo.objects import Compound
from umo.objects.node import outwards
from umo.user_code import refuse_exit


class Supervisor(Protocol):
    """A law that supervises the sequences of its part."""

    part: Compound
    """The part of the supervisor, to which an error of `supervise` belongs."""

    def begin(self, path: str) -> None:
        """Set the path of the law while the machine is being connected. Raises DeclarationError if the part cannot have
        states."""

    def supervise(self) -> None:
        """Supervise the part. Called once per period, before the sequences, also in manual mode and while the part is
        in fault."""

    def note_faults(self) -> None:
        """Record that equipment has entered a fault. It may be the equipment around the part. The fault may be cleared
        before the next period. The sequences of the equipment are ended after this call."""

    def describe(self) -> Mapping[str, Any]:
        """Return the path, the states and the commands of the part, as plain data."""


class Supervisors(Capability):
    """The laws of one machine that supervise sequences."""

    def __init__(self, laws: Sequence[tuple[str, Supervisor]]) -> None:
        """`laws`: the laws, each with its path."""
        self._laws = laws
        self._within: dict[int, list[Supervisor]] = {}
        """The supervisors of the parts in each compound, by the id of the compound."""

    def attach(self, machine: Any) -> None:
        """Attach the supervisors. Raises DeclarationError for a supervisor whose part cannot have states."""
        self._machine = machine
        machine.directory.units = [law for _, law in self._laws]
        for path, law in self._laws:
            law.begin(path)
            for node in outwards(law.part):
                self._within.setdefault(id(node), []).append(law)
        machine.phases.commanding.append(self.act)
        machine.under_way.noting.append(self.note_faults)

    def note_faults(self, faults: Sequence[Equipment]) -> None:
        """Record that this equipment has entered a fault."""
        found = [law for each in faults for law in self._within.get(id(each.compound), ())]
        for law in {id(law): law for law in found}.values():
            law.note_faults()

    @expects_errors
    def act(self) -> None:
        """Advance all units one after another. Units that enter a fault are settled together."""
        equipment = self._machine.equipment
        equipment.gather()
        try:
            for _, each in self._laws:
                try:
                    each.supervise()
                except BaseException as error:
                    if not self._contain(each, error):
                        refuse_exit(error, "supervise")
                        raise
        finally:
            equipment.settle()

    def _contain(self, law: Supervisor, error: BaseException) -> bool:
        """Put the equipment around the part of the law into fault. Return False if only the machine itself contains the
        part. The law is still called while the part is in fault, but its errors are then not recorded in every
        period."""
        equipment = self._machine.equipment
        if self._machine.acting_laws.containing(law.part, error) is None:
            return False
        if not equipment.is_in_fault(law.part):
            equipment.contain(law.part, error)
        forget_frames(error)
        return True
