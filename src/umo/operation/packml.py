"""The states of PackML (ISA-TR88.00.02-2015; OPC 30050). The tests compare them with the NodeSet2 of OPC 30050."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import ClassVar

from umo.objects import action
from umo.operation.model import ABORT, CLEAR, STOP, StateModel
from umo.operation.unit_states import UnitStates


class PackMLState(IntEnum):
    """The states; the numbers are those of PackTags."""

    CLEARING = 1
    STOPPED = 2
    STARTING = 3
    IDLE = 4
    SUSPENDED = 5
    EXECUTE = 6
    STOPPING = 7
    ABORTING = 8
    ABORTED = 9
    HOLDING = 10
    HELD = 11
    UNHOLDING = 12
    SUSPENDING = 13
    UNSUSPENDING = 14
    RESETTING = 15
    COMPLETING = 16
    COMPLETE = 17


_S = PackMLState
_ENDED = (_S.ABORTING, _S.ABORTED)
_STOPPED = (*_ENDED, _S.CLEARING, _S.STOPPING, _S.STOPPED)
_HELD_FROM = (_S.STARTING, _S.EXECUTE, _S.UNHOLDING, _S.SUSPENDING, _S.SUSPENDED, _S.UNSUSPENDING)

PACKML = StateModel(
    name="PackML",
    first=_S.STOPPED,
    execute=_S.EXECUTE,
    acting={
        _S.RESETTING: _S.IDLE,
        _S.STARTING: _S.EXECUTE,
        _S.EXECUTE: _S.COMPLETING,
        _S.COMPLETING: _S.COMPLETE,
        _S.HOLDING: _S.HELD,
        _S.UNHOLDING: _S.EXECUTE,
        _S.SUSPENDING: _S.SUSPENDED,
        _S.UNSUSPENDING: _S.EXECUTE,
        _S.STOPPING: _S.STOPPED,
        _S.ABORTING: _S.ABORTED,
        _S.CLEARING: _S.STOPPED,
    },
    commands={
        "reset": {_S.STOPPED: _S.RESETTING, _S.COMPLETE: _S.RESETTING},
        "start": {_S.IDLE: _S.STARTING},
        "hold": dict.fromkeys(_HELD_FROM, _S.HOLDING),
        "unhold": {_S.HELD: _S.UNHOLDING},
        "suspend": {_S.EXECUTE: _S.SUSPENDING},
        "unsuspend": {_S.SUSPENDED: _S.UNSUSPENDING},
        "complete": {_S.EXECUTE: _S.COMPLETING},
        STOP: {state: _S.STOPPING for state in _S if state not in _STOPPED},
        ABORT: {state: _S.ABORTING for state in _S if state not in _ENDED},
        CLEAR: {_S.ABORTED: _S.CLEARING},
    },
    waiting=(_S.HOLDING, _S.HELD, _S.UNHOLDING, _S.SUSPENDING, _S.SUSPENDED, _S.UNSUSPENDING),
    stopped=_S.STOPPED,
    aborting=_S.ABORTING,
    aborted=_S.ABORTED,
    places={
        _S.UNHOLDING: (1, 0),
        _S.HELD: (2, 0),
        _S.HOLDING: (3, 0),
        _S.IDLE: (0, 1),
        _S.STARTING: (1, 1),
        _S.EXECUTE: (2, 1),
        _S.COMPLETING: (3, 1),
        _S.COMPLETE: (4, 1),
        _S.UNSUSPENDING: (1, 2),
        _S.SUSPENDED: (2, 2),
        _S.SUSPENDING: (3, 2),
        _S.RESETTING: (0, 2),
        _S.STOPPED: (0, 3),
        _S.STOPPING: (1, 3),
        _S.CLEARING: (2, 3),
        _S.ABORTED: (3, 3),
        _S.ABORTING: (4, 3),
    },
)


class PackML(UnitStates):
    """A part with the states of PackML.

        class FillerStates(PackML):
            part: Filler

            async def starting(self) -> None:
                await self.part.lift()

            async def execute(self) -> None:
                while True:
                    await self.part.fill_one()
                    self.produced += 1

            def refusal(self, command: str) -> str | None:
                return "the guard is open" if command == "start" and self.part.is_open() else None

        class Filler(Compound, equipment=True):
            ...
            def setup(self) -> None:
                self.unit = FillerStates(self)

    Define a sequence for each acting state in which the part has something to do: `resetting`, `starting`, `execute`,
    `completing`, `holding`, `unholding`, `suspending`, `unsuspending`, `stopping`, `aborting`, `clearing`. When a
    sequence ends, the next state follows. While the part is held or suspended, the sequence of `execute` waits;
    afterwards it continues from where it was. A motion in progress continues to its end unless `holding` stops it.
    """

    model: ClassVar[StateModel] = PACKML
    changes_mode: ClassVar[Sequence[IntEnum]] = (_S.STOPPED, _S.IDLE, _S.ABORTED)

    @property
    def state(self) -> PackMLState:
        """The present state. A part in fault is ABORTED."""
        found: PackMLState = self._state_now()
        return found

    @action(harmless=True)
    def reset(self) -> str:
        """Go from Stopped or Complete to Idle. An application that waits for this continues immediately: the machine
        may move."""
        return self.command("reset")

    @action(harmless=True)
    def start(self) -> str:
        """Go from Idle to Execute."""
        return self.command("start")

    @action(harmless=True)
    def hold(self) -> str:
        """Go to Held, for a cause in the machine itself; Execute continues from there after `unhold`."""
        return self.command("hold")

    @action(harmless=True)
    def unhold(self) -> str:
        """Go from Held to Execute."""
        return self.command("unhold")

    @action(harmless=True)
    def suspend(self) -> str:
        """Go to Suspended, for a cause outside of the machine, such as missing material."""
        return self.command("suspend")

    @action(harmless=True)
    def unsuspend(self) -> str:
        """Go from Suspended to Execute."""
        return self.command("unsuspend")

    @action(harmless=True)
    def complete(self) -> str:
        """End Execute, and go to Complete."""
        return self.command("complete")
