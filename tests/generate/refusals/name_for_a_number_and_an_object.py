"""Name for a number and an object."""

from __future__ import annotations

from helpers.written_programs import Program


class NameForANumberAndAnObject(Program):
    def control(self) -> None:
        which = self.u
        # refused: 'which' means different objects; one name per object
        which = self.b
        # refused: the object of this attribute is not known when the code is generated
        which.write(1.0)
