"""The states of one part of a machine, the commands of the part, and the sequences that carry out the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, ClassVar

from umo.cycle.sequences import one_period
from umo.errors import CommandRefused, DeclarationError, TaskFailed
from umo.objects import Compound, Number, action
from umo.objects.attributes import DeclaredAttributes
from umo.objects.laws import laws_in
from umo.objects.link import Task, Unconnected
from umo.operation.model import ABORT, CLEAR, STOP, StateModel, UnitMode, sequence_name, title
from umo.operation.resting import Resting
from umo.operation.supervisors import Supervisors
from umo.operation.unit_checks import check_excluded, check_sequences
from umo.user_code import attempt, briefly, check_overrides

MAX_RESULT_TEXT = 100
"""Largest length of a wrong result of `refusal` in its message, in characters."""
MANUAL_COMMANDS = {STOP: "abort it", ABORT: "", CLEAR: "clear only the fault (`umo do STATION clear`)"}
"""The commands that are possible in manual mode. For each: what to do instead if the command would have to wait for a
sequence."""


class UnitStates(DeclaredAttributes):
    """Base of `PackML` and `Procedure`: the states of a part that is equipment.

    A part makes this object in its `setup`. A subclass defines the work in the acting states, as sequences of the part.
    Each sequence belongs to the part: if a sequence fails, the part is in fault, which is the state `aborted`.

    `part` is the compound. Raises DeclarationError on connect if the part is not declared with `equipment=True`, or is
    the machine itself, because a failure of the machine itself ends the run.
    """

    _capability: ClassVar = Supervisors
    model: ClassVar[StateModel]
    excluded: ClassVar[Mapping[UnitMode, Sequence[IntEnum]]] = {}
    """The states that a mode does not have: no command leads to them, and an acting state among them is skipped. Every
    mode must have the first state and the states to which stop, abort and clear lead."""
    changes_mode: ClassVar[Sequence[IntEnum]] = ()
    """The states in which the mode may be changed."""
    numbers: ClassVar[Mapping[str, Number]] = {
        "state": Number(shown=True),
        "mode": Number(shown=True),
        "produced": Number(shown=True, kept=True),
        "rejected": Number(shown=True, kept=True),
    }
    """The numbers of every unit; a subclass adds further numbers."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        check_overrides(cls)
        if hasattr(cls, "model"):
            check_sequences(cls, cls.model)
            check_excluded(cls, cls.model, cls.excluded)
        declared = (vars(each).get("numbers", {}) for each in reversed(cls.__mro__))
        cls.numbers = {name: number for each in declared for name, number in each.items()}

    def __init__(self, part: Compound) -> None:
        self.part = part
        self.path = ""
        """The path of this object in the machine, such as `filler.unit`. It is known only while the machine is
        connected."""
        self._state = self.model.first
        self._mode = UnitMode.PRODUCTION
        self.produced = self.rejected = 0
        """The numbers of good and of bad products. The program counts them."""
        self._task: Task | None = None
        """The sequence of an acting state."""
        self._work: Task | None = None
        """The sequence of `execute`; it waits in the states in `model.waiting`."""
        self._resting = Resting(part, [])

    # States --------------------------------------------------------------------------------------------

    @property
    def state(self) -> IntEnum:
        """The present state. A part in fault is aborted. While the run is being stopped, other parts are stopped."""
        found: IntEnum = self._state_now()
        return found

    def _state_now(self) -> Any:
        machine = self.part._machine
        if isinstance(machine, Unconnected):
            return self._state
        if machine.is_in_fault(self.part):
            return self.model.aborted
        return self._state if machine.running else self.model.stopped

    @property
    def mode(self) -> UnitMode:
        return self._mode

    @property
    def possible(self) -> list[str]:
        """The commands that are possible now."""
        return [name for name in self.model.possible(self.state) if self._refusal(name) is None]

    @property
    def _in_fault(self) -> bool:
        machine = self.part._machine
        return not isinstance(machine, Unconnected) and machine.is_in_fault(self.part)

    def refusal(self, command: str) -> str | None:
        """Return the reason why a command must not be carried out now, or None. Override this method for interlocks on
        transitions. If the method fails, or returns something other than a string, the command is refused; stop and
        abort are carried out all the same."""
        return None

    async def execute(self) -> None:
        """Do the main work of the part. The end of this sequence leads to the next state; by default it does not
        end."""
        while True:
            await one_period()

    # Commands ------------------------------------------------------------------------------------------

    def command(self, name: str) -> str:
        """Carry out a command, and return the resulting state. Raises CommandRefused if the command is not possible
        now; then nothing is changed. Raises EquipmentFault or DriverError if a fault cannot be cleared."""
        if (why := self._refusal(name)) is not None:
            raise CommandRefused(f"{self.path or type(self).__name__}: {why}")
        target = self.model.commands[name][self.state]
        if name == CLEAR:
            self.part.cycle.clear()
        self._enter(target)
        return title(self.state)

    def _refusal(self, name: str) -> str | None:
        state, targets = self.state, self.model.commands[name]
        if state not in targets:
            known = ", ".join(self.model.possible(state))
            return f"{name} is not possible in the state {title(state)}; possible: {known}"
        if not self._has(targets[state]):
            return f"{name} is not possible in the mode {title(self.mode)}"
        if self.part.cycle.manual and (why := self._refusal_in_manual(name, targets[state])) is not None:
            return f"{name} is not possible in manual mode: {why}"
        return self._asked_refusal(name)

    def _refusal_in_manual(self, name: str, target: IntEnum) -> str | None:
        """Return why a command is refused in manual mode, or None. In manual mode no sequence takes a step. Abort needs
        no sequence; any other command that leads to a sequence would be accepted but not carried out."""
        if name not in MANUAL_COMMANDS:
            return "the application waits (change the mode: `umo do STATION mode automatic`)"
        if name == ABORT or not self._has_sequence(target):
            return None
        sequence = sequence_name(self.model, target)
        instead = MANUAL_COMMANDS[name]
        change = "change the mode (`umo do STATION mode automatic`)"
        return f"its sequence `{sequence}` waits with the application; {change}, or {instead}"

    def _has(self, state: IntEnum) -> bool:
        """Return True if the mode has a state and, for an acting state, also the state that follows it."""
        model, excluded = self.model, self.excluded.get(self.mode, ())
        then = state if state is model.execute else model.acting.get(state, state)
        return state not in excluded and then not in excluded

    def _asked_refusal(self, name: str) -> str | None:
        """Return the result of `refusal`. If it fails, a command is refused, unless it brings the part to
        standstill."""
        why, error = attempt(self.refusal, name)
        if error is None and (why is None or isinstance(why, str)):
            return why
        cause = error.text if error else f"`refusal` gives {briefly(why, MAX_RESULT_TEXT)}, which is not a string"
        return None if name in (STOP, ABORT) else f"it is unknown whether {name} is possible: {cause}"

    @action(harmless=True, apart=True)
    def stop(self) -> str:
        """Go to Stopped by an orderly end of the work."""
        return self.command(STOP)

    @action(harmless=True, apart=True)
    def abort(self) -> str:
        """Go to Aborted: outputs go to their defaults, and the part is in fault until it is cleared."""
        return self.command(ABORT)

    @action(harmless=True)
    def clear(self) -> str:
        """Go from Aborted to Stopped: end the fault. An application that waits for this continues immediately: the
        machine may move."""
        return self.command(CLEAR)

    @action(harmless=True)
    def change_mode(self, mode: UnitMode) -> None:
        """Change the unit's mode."""
        if mode is not self._mode and self.state not in self.changes_mode:
            states = ", ".join(map(title, self.changes_mode))
            raise CommandRefused(f"{self.path}: the mode can be changed in the states {states}")
        self._mode = mode

    @action(harmless=True)
    def reset_counters(self) -> None:
        """Set the counts of products to 0."""
        self.produced = self.rejected = 0

    # Each period ---------------------------------------------------------------------------------------

    def begin(self, path: str) -> None:
        """Set the path of the states in the machine, while the machine is being connected."""
        part = self.part
        if part._settings.equipment is not True or part._parent is None:
            need = f"class {type(part).__name__}(Compound, equipment=True)"
            what = "is the machine itself" if part._parent is None else "is not declared as equipment"
            raise DeclarationError(f"{path}: only a part that is equipment can have states ({need}); {part!r} {what}")
        self.path, self._state, self._task, self._work = path, self.model.first, None, None
        others = [owner for owner, _, law in laws_in(part) if isinstance(law, UnitStates) and owner is not part]
        self._resting = Resting(part, others)

    def supervise(self) -> None:
        """Go to the next state after the end of a fault or of a sequence."""
        if self._in_fault:
            return
        if self._state is self.model.aborted:
            self._enter(self.model.commands[CLEAR][self.model.aborted])
        if self._state is self.model.aborting and self.part.cycle.manual:  # no sequence runs
            self._fail()
            return
        while self._has_ended():
            then = self.model.acting[self._state]
            if then is self.model.aborted:
                self._fail()
                return
            self._enter(then)

    def note_faults(self) -> None:
        """Record that equipment has entered a fault and that its sequences end. The part is aborted even if the fault
        is cleared before the next call of `supervise`."""
        if self._in_fault and self._state is not self.model.aborted:
            self._state, self._task, self._work = self.model.aborted, None, None
            self._tell_state()

    def _has_ended(self) -> bool:
        """Begin the work of an acting state if it has not begun. Return True if this work is done."""
        state = self._state
        if state not in self.model.acting:
            return False
        if state is self.model.execute:
            if self._work is None:
                self._work = self.part.cycle.start(self.execute())
            return self._work.done
        if self._task is None and self._has_sequence(state):
            self._task = self.part.cycle.start(getattr(self, sequence_name(self.model, state))())
        return self._task is None or self._task.done

    def _has_sequence(self, state: IntEnum) -> bool:
        """Return True if an acting state has a sequence in this mode."""
        return self._is_overridden(state) and state not in self.excluded.get(self.mode, ())

    def _is_overridden(self, state: IntEnum) -> bool:
        return hasattr(type(self), sequence_name(self.model, state))

    def _enter(self, state: IntEnum) -> None:
        self._state = state
        self._tell_state()
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
        self._rest_or_go_on(state)
        if self._work is None:
            return
        self._work.paused = state in self.model.waiting
        if state is not self.model.execute and not self._work.paused:
            work, self._work = self._work, None
            work.cancel()

    def _rest_or_go_on(self, state: IntEnum) -> None:
        """Bring driven outputs to their defaults on the way to a waiting state, unless the part has a sequence for
        this. Restore the outputs when the work continues."""
        model = self.model
        if state is model.execute:
            self._resting.end()
        elif state not in model.waiting:
            self._resting.forget()
        elif model.acting.get(state) in model.waiting and not self._is_overridden(state):
            self._resting.begin()

    def _fail(self) -> None:
        """Abort: put the part into fault, which brings its outputs to their defaults."""
        self.part._machine.fail(self.part, TaskFailed("aborted by a command"))

    def _tell_state(self) -> None:
        self.part._machine.tell(self.path, f"state: {title(self._state)}")

    def describe(self) -> dict[str, Any]:
        """Return the states as plain data."""
        modes = {str(int(each)): title(each) for each in UnitMode}
        possible = [name for name in MANUAL_COMMANDS if self._is_possible_in_manual(name)]
        about = {"path": self.path, "part": self.part._path, "modes": modes, "in_manual": possible}
        return {**about, **self.model.describe()}

    def _is_possible_in_manual(self, name: str) -> bool:
        """Return True if a command is possible in manual mode and needs no sequence."""
        targets = set(self.model.commands[name].values())
        return name == ABORT or not any(self._is_overridden(target) for target in targets)
