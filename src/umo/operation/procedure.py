"""The states of procedural elements of batch control (ANSI/ISA-88.00.01-2010, section 6.3; IEC 61512-1)."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import ClassVar

from umo.objects import action
from umo.operation.model import ABORT, CLEAR, STOP, StateModel
from umo.operation.unit_states import UnitStates


class ProcedureState(IntEnum):
    """The states. The standard gives no numbers; umo has chosen these."""

    IDLE = 1
    RUNNING = 2
    COMPLETE = 3
    PAUSING = 4
    PAUSED = 5
    HOLDING = 6
    HELD = 7
    RESTARTING = 8
    STOPPING = 9
    STOPPED = 10
    ABORTING = 11
    ABORTED = 12


_S = ProcedureState
_AT_WORK = (_S.RUNNING, _S.PAUSING, _S.PAUSED, _S.HOLDING, _S.HELD, _S.RESTARTING)

PROCEDURE = StateModel(
    name="ISA-88",
    first=_S.IDLE,
    execute=_S.RUNNING,
    acting={
        _S.RUNNING: _S.COMPLETE,
        _S.PAUSING: _S.PAUSED,
        _S.HOLDING: _S.HELD,
        _S.RESTARTING: _S.RUNNING,
        _S.STOPPING: _S.STOPPED,
        _S.ABORTING: _S.ABORTED,
    },
    commands={
        "start": {_S.IDLE: _S.RUNNING},
        "pause": {_S.RUNNING: _S.PAUSING},
        "resume": {_S.PAUSED: _S.RUNNING},
        "hold": dict.fromkeys((_S.RUNNING, _S.PAUSING, _S.PAUSED, _S.RESTARTING), _S.HOLDING),
        "restart": {_S.HELD: _S.RESTARTING},
        STOP: dict.fromkeys(_AT_WORK, _S.STOPPING),
        ABORT: {state: _S.ABORTING for state in _S if state not in (_S.ABORTING, _S.ABORTED)},
        CLEAR: {_S.ABORTED: _S.STOPPED},
        "reset": {_S.COMPLETE: _S.IDLE, _S.STOPPED: _S.IDLE},
    },
    waiting=(_S.PAUSING, _S.PAUSED, _S.HOLDING, _S.HELD, _S.RESTARTING),
    stopped=_S.STOPPED,
    aborting=_S.ABORTING,
    aborted=_S.ABORTED,
    places={
        _S.RESTARTING: (1, 0),
        _S.HELD: (2, 0),
        _S.HOLDING: (3, 0),
        _S.IDLE: (0, 1),
        _S.RUNNING: (1, 1),
        _S.COMPLETE: (2, 1),
        _S.STOPPED: (0, 2),
        _S.STOPPING: (1, 2),
        _S.PAUSED: (2, 2),
        _S.PAUSING: (3, 2),
        _S.ABORTED: (0, 3),
        _S.ABORTING: (1, 3),
    },
)


class Procedure(UnitStates):
    """A part that makes batches, with the states of ISA-88: `execute` is the state Running.

    Define a sequence for each acting state in which the part has something to do: `execute`, `pausing`, `holding`,
    `restarting`, `stopping`, `aborting`. When a sequence ends, the next state follows. While the part is paused or
    held, `execute` waits; afterwards it continues from where it was. `clear`, a command from PackML, ends a fault: it
    leads from Aborted to Stopped.
    """

    model: ClassVar[StateModel] = PROCEDURE
    changes_mode: ClassVar[Sequence[IntEnum]] = (_S.IDLE, _S.COMPLETE, _S.STOPPED, _S.ABORTED)

    @property
    def state(self) -> ProcedureState:
        """The present state. A part in fault is ABORTED."""
        found: ProcedureState = self._state_now()
        return found

    @action(harmless=True)
    def start(self) -> str:
        """Go from Idle to Running."""
        return self.command("start")

    @action(harmless=True)
    def pause(self) -> str:
        """Go to Paused, at a safe place in the procedure."""
        return self.command("pause")

    @action(harmless=True)
    def resume(self) -> str:
        """Go from Paused to Running."""
        return self.command("resume")

    @action(harmless=True)
    def hold(self) -> str:
        """Go to Held, a known state, from which `restart` continues."""
        return self.command("hold")

    @action(harmless=True)
    def restart(self) -> str:
        """Go from Held to Running."""
        return self.command("restart")

    @action(harmless=True)
    def reset(self) -> str:
        """Go from Complete or Stopped to Idle. An application that waits for this continues immediately: the machine
        may move."""
        return self.command("reset")
