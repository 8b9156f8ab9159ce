"""The laws of a connected machine, compiled (`[process] compile = true`).

At first Python runs the laws, and the results of the compiled laws are compared with those of Python, one law per
period: the values that are written, and every attribute. If they differ, Python continues to run the laws. Otherwise
the attributes of the laws become fields of the compiled library (`bound_fields.py`), and the machine calls the library.
Sequences, clients and faces read and set the attributes as before. If the library cannot do something, or some code
sets a value that translation took as known (`known_watch.py`), the laws run in Python again and a notice says so."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from ctypes import c_void_p, cast
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from types import MethodType
from typing import Any
from weakref import proxy

import numpy as np

from umo.cycle.capability import Capability
from umo.cycle.columns import Source
from umo.cycle.conversion import extension
from umo.cycle.events import Event
from umo.cycle.machine import ConnectedMachine
from umo.errors import BadInput, DeclarationError, DriverError, Interlocked, RangeError, StateError, text_of
from umo.generate.bound_deques import BoundDeque
from umo.generate.bound_fields import BoundFields
from umo.generate.c_types import ArrayType, CType, OptionalType, TupleType
from umo.generate.compiled_conditions import CompiledConditions, only_in_python
from umo.generate.controller_model import ControllerModel, laid_out, model_of, too_many
from umo.generate.known_values import KnownName, is_installed
from umo.generate.known_watch import KnownWatch
from umo.generate.law_library import (
    BESIDE_PYTHON,
    CHANGED,
    HOST_CALL,
    READ,
    TEXT_CALLBACK,
    WRITE,
    WRITE_MANY,
    ColumnPointers,
    LawLibrary,
    library_of,
    source_of_laws,
)
from umo.generate.lower.lowered_rings import DequeFields
from umo.generate.lower.text_makers import error_as_written
from umo.generate.struct_memory import WRONG, ValueDoesNotFit
from umo.generate.translation import Translation
from umo.generate.translator import translate
from umo.objects import Compound, Quality, Vector
from umo.objects.atomic import Binary
from umo.wiring.wired import Wired

COMPARED = 20
"""Number of periods in which each law is compared."""
BAD_INPUT, NEVER_READ, NO_HOST = 6, 7, 10
NUMBERS: tuple[tuple[type[BaseException], int], ...] = (
    (Interlocked, 8),
    (StateError, 9),
    (BadInput, BAD_INPUT),
    (RangeError, 4),
    (DriverError, 2),
)
"""The numbers of the runtime's faults (umo.h) for errors of Python."""
OWN_TEXTS: dict[type[BaseException], str] = {
    ZeroDivisionError: "division by zero",
    IndexError: "list index out of range",
}


class NotCompiled(DeclarationError):
    """Raised if laws stay in Python. `reasons` has all obstacles, the message has the first."""

    def __init__(self, reasons: Sequence[str]) -> None:
        first, *more = reasons
        super().__init__(f"{first}, and {len(more)} more" if more else first)
        self.reasons = list(reasons)


@dataclass(frozen=True)
class PreparedLaws:
    """The compiled laws of a machine that is not connected yet."""

    wired: Wired
    source: str
    library: Path


@dataclass(frozen=True)
class TranslatedLaws:
    """The laws of a machine in C."""

    laws: list[MethodType]
    translation: Translation
    conditions: int
    """The number of translated conditions of interlocks: all or 0."""
    left_out: str
    """The reason why the conditions are not translated; empty if they are."""
    source: str


def prepare(root: Compound, wired: Wired) -> PreparedLaws:
    """Compile the laws of a machine before it is connected. Raises DeclarationError with all obstacles."""
    source = source_of(root, wired)
    return PreparedLaws(wired, source, library_of(source))


def source_of(root: Compound, wired: Wired) -> str:
    """Return the laws of a machine that is not connected, in C. Raises NotCompiled with all obstacles."""
    if wired.controllers:
        raise NotCompiled(["parts of it run on controllers"])
    with laid_out(root, wired) as model:
        return translated_laws(root, model).source


def translated_laws(root: Compound, model: ControllerModel) -> TranslatedLaws:
    """Return the laws, in C, of a machine that is connected, or laid out as if it were. Raises NotCompiled with all
    obstacles."""
    laws = [law.control for law in model.laws]
    if not laws:
        raise NotCompiled(["it has no laws"])
    if problems := list(too_many(model)):
        raise NotCompiled([str(each) for each in problems])
    asked = model.conditions
    translation = translate(root, asked, laws, BESIDE_PYTHON)
    if left_out := only_in_python(translation, asked) or next(_not_on_columns(translation), ""):
        asked = []
        translation = translate(root, asked, laws, BESIDE_PYTHON)
    if wrong := [str(each) for each in translation.problems] or [*_not_on_columns(translation)]:
        raise NotCompiled(wrong)
    conditions = [translation.entry[each] for each in asked]
    model = replace(model, objects=[replace(each, linearization=None, invalid_raws=()) for each in model.objects])
    source = source_of_laws(model, translation, conditions)
    return TranslatedLaws(laws, translation, len(conditions), left_out, source)


def _not_on_columns(translation: Translation) -> Iterator[str]:
    """Yield the reasons why translated parts cannot work on Python's memory."""
    for struct in translation.structs:
        if isinstance(struct.owner, DequeFields):
            continue
        if isinstance(struct.owner, type) or not hasattr(struct.owner, "__dict__"):
            yield f"{struct.path} is not an object whose attributes can be stored elsewhere"
        for name, of in struct.fields.items():
            if any(map(_has_array, _inside(of))):
                yield (
                    f"{struct.path or type(struct.owner).__name__}.{name} has a list or an array within another value "
                    "or in the place of None: changes through other references could not be seen"
                )
    for owner, name in translation.hosts:
        if name in vars(owner) and not is_installed(str(getattr(vars(owner)[name], "__module__", ""))):
            yield f"{name} of a {type(owner).__name__} is a function that only Python can call"


def _inside(of: CType) -> list[CType]:
    """Return the types of the parts of a value of this type."""
    if isinstance(of, TupleType):
        return [each for _, each in of.members]
    return [of.of] if isinstance(of, OptionalType | ArrayType) else []


def _has_array(of: CType) -> bool:
    return isinstance(of, ArrayType) or any(map(_has_array, _inside(of)))


class CompiledLaws(Capability):
    """The compiled laws of one connected machine: `state` is "compared", "compiled" or "python".

    The laws are translated again in their current state, because the wiring or a restart may have called `setup` again,
    and `setup` may have made other laws. The library is compiled again only if the code differs."""

    def __init__(self, prepared: PreparedLaws) -> None:
        self._prepared = prepared

    def attach(self, machine: ConnectedMachine) -> None:
        """Attach the laws to the machine. Raises DeclarationError with all obstacles."""
        prepared = self._prepared
        self._machine, self._image = machine, machine.image
        found = translated_laws(machine.root, model_of(machine, prepared.wired))
        self._python, self._translation, self._known = found.laws, found.translation, found.translation.known
        self._columns = self._columns_of()
        library = prepared.library if found.source == prepared.source else library_of(found.source)
        self._library = LawLibrary(library, self._columns)
        structs = self._translation.structs
        self._memories = self._library.structs(structs)
        pairs = list(zip(self._memories, structs, strict=True))
        states = {(each.path, each.name) for each in self._translation.layout if each.owner == "STATE"}
        self._fields = [
            BoundFields(
                memory,
                struct.owner,
                {name for name in struct.fields if (struct.path, name) in states},
                self.give_up,
                self._known.names_of(struct.owner),
            )
            for memory, struct in pairs
            if not isinstance(struct.owner, DequeFields)
        ]
        self._deques = [
            BoundDeque(memory, struct.owner) for memory, struct in pairs if isinstance(struct.owner, DequeFields)
        ]
        self._waiting: list[BoundFields] = []
        for each in self._fields:
            each.was_given = self._was_given
        self._native: list[Any] = []
        self._vectors: dict[tuple[int, ...], Vector[Any]] = {}
        self._left = [COMPARED] * len(self._python)
        """The remaining number of comparisons of each law. One law is compared per period, one after the other."""
        inhibitions = machine.claims.inhibitions[: found.conditions]
        first, why = len(self._python), found.left_out
        self._conditions = CompiledConditions(self._library, first, inhibitions, machine.clock, COMPARED, why)
        self._period = -1
        self._shadow: Any = None
        self._called: Callable[[], bool] | None = None
        """The function that is called before the laws."""
        self._asked = False
        self._error: tuple[int, BaseException] | None = None
        self.state = "compared"
        self._watch = KnownWatch(self._known, self._changed)
        if self.state == "python":
            return
        self._watch.on_renewal = self._use_watch
        self._use_watch()
        machine.acting_laws.replace(
            [MethodType(self._comparing(n, law), law.__self__) for n, law in enumerate(self._python)]
        )

    @property
    def has_deques(self) -> bool:
        """True if Python copies elements of deques before and after the laws."""
        return bool(self._deques)

    def _use_watch(self) -> None:
        self._look_first(self._look if self._deques else self._watch.look)

    def _look_first(self, look: Callable[[], bool]) -> None:
        """Call `look` before conditions and laws."""
        if self.state != "python":
            self._call_before_laws(look)
            self._conditions.look_first(look)

    def _call_before_laws(self, look: Callable[[], bool] | None) -> None:
        """Replace the function that is called before the laws."""
        phases, before = self._machine.phases, self._called
        others = [each for each in phases.before_laws if each is not before]
        phases.before_laws, self._called = [*([look] if look is not None else []), *others], look

    def _was_given(self, fields: BoundFields) -> None:
        """Record that an object was given a list or an array, so that it is checked before the laws."""
        self._waiting.append(fields)
        self._look_first(self._look)

    def _look(self) -> bool:
        """Return True if all values that translation took as known are unchanged. If not, Python runs the laws from now
        on."""
        while self._waiting:
            self._waiting.pop().take_given()
            self._use_watch()
        self._push_deques()
        return self.state != "python" and self._watch.look()

    def _push_deques(self) -> None:
        """Copy the elements of deques that somebody has changed to the library."""
        try:
            for each in self._deques if self.state == "compiled" else ():
                each.push()
        except ValueDoesNotFit as error:
            self.give_up(str(error))

    def _pull_deques(self) -> None:
        """Copy the elements of deques that laws have changed to Python."""
        for each in self._deques:
            each.pull()

    # Python drives, and C is compared ------------------------------------------------------------------

    def _comparing(self, number: int, law: MethodType) -> Callable[[Any], None]:
        def act(_: Any) -> None:
            now = self._machine.clock.number
            fault = None
            if self.state == "compared" and self._period != now and (self._conditions.left or self._left[number]):
                self._period = now
                if not self._conditions.left:
                    fault = self._tried(number)
                elif self._push():
                    self._conditions.compare()
            try:
                law()
            except BaseException as error:
                self._judge(number, fault, error)
                raise
            self._judge(number, fault, None)

        return act

    def _tried(self, number: int) -> int | None:
        """Call a compiled law on copies and return its fault; None if it needed Python."""
        if not self._push():
            return None
        self._shadow, self._asked = self._image.columns.pending.copy(), False
        self._columns.pending, noted, self._columns.written = self._shadow.ctypes.data, self._columns.written, None
        try:
            fault = self._library.call(number, self._machine.clock)
        finally:
            self._columns.pending, self._columns.written = self._image.columns.pending.ctypes.data, noted
        return None if self._asked else fault

    def _push(self) -> bool:
        """Copy the attributes of Python to the library. If one does not fit, return False, and Python runs the laws."""
        for memory in self._memories:
            try:
                memory.push()
            except WRONG as error:
                self.give_up(text_of(error))
                return False
        return True

    def _judge(self, number: int, fault: int | None, error: BaseException | None) -> None:
        """Compare the effect of the compiled law with what Python has done since."""
        if self.state != "compared" or fault is None:
            return
        kind = None if fault == 0 else self._kind(fault)
        if (kind is None) != (error is None) or (kind is not None and not isinstance(error, kind)):
            self._differs(number, f"Python {_told(error)}, C {_told(kind)}")
            return
        difference = next((line for each in self._memories for line in each.differences()), "")
        if not difference and self._shadow.tobytes() != self._image.columns.pending.tobytes():
            slots = np.flatnonzero(self._shadow != self._image.columns.pending)
            difference = f"what is written to {self._image.items[slots[0]].path}" if len(slots) else ""
        if difference:
            self._differs(number, difference)
            return
        self._left[number] -= 1
        if not any(self._left) and not self._conditions.left:
            self._bind()

    def _differs(self, number: int, what: str) -> None:
        law = self._python[number]
        self.give_up(f"{type(law.__self__).__name__}.control is not the same: {what}")

    # C drives ------------------------------------------------------------------------------------------

    def _bind(self) -> None:
        self._known.settle()
        try:
            for fields in self._fields:
                fields.bind()
            for held in self._deques:
                held.bind()
        except WRONG as error:
            self.give_up(text_of(error))
            return
        self._known.bind(each.owner for each in self._fields)
        self.state = "compiled"
        self._watch = KnownWatch(self._known, self._changed, [(each.owner, each.names) for each in self._fields])
        if self.state != "compiled":
            return
        self._conditions.use()
        self._watch.on_renewal = self._use_watch
        self._use_watch()
        self._tell("the laws are compiled: so far their results were the same as in Python")
        if self._translation.notes:
            self._tell(f"the compiled laws leave out code that only makes texts: {'; '.join(self._translation.notes)}")
        if mixed := [f"{each.label}.{name}" for each in self._memories for name in each.mixed]:
            self._tell(f"numbers whose class varies in Python are read as one class: {', '.join(mixed)}")
        if self._conditions.left_out:
            self._tell(f"the conditions of interlocks run in Python: {self._conditions.left_out}")
        self._machine.acting_laws.replace([self._compiled(number, law) for number, law in enumerate(self._python)])

    def _compiled(self, number: int, law: MethodType) -> MethodType:
        clock = self._machine.clock
        native = getattr(extension, "Law", None)
        if native is not None and not self._deques:
            self._native.append(native(*self._library.addresses, number, clock, self._failed))
            return MethodType(self._native[-1].act, law.__self__)

        def act(_: Any) -> None:
            if self.state == "python":  # since the laws of this period have begun
                law()
                return
            fault = self._library.call(number, clock)
            self._pull_deques()
            if fault:
                self._failed(fault)

        return MethodType(act, law.__self__)

    def _changed(self, names: list[KnownName]) -> None:
        """Let Python run the laws: somebody has set values that translation took as known."""
        first = names[0]
        by = next((each.setter(first.name) for each in self._fields if each.owner is first.owner), "")
        more = f", and {len(names) - 1} more" if len(names) > 1 else ""
        read = f", which {first.place} has read" if first.file else ""
        self.give_up(f"{first.label} was set{f' ({by})' if by else ''}{read}{more}")

    def give_up(self, reason: str) -> None:
        """Let Python run the laws from now on."""
        if self.state == "python":
            return
        self._release()
        self._machine.acting_laws.replace(self._python)
        text = f"the laws run in Python, not compiled: {reason}"
        self._tell(text, logged=True)

    def _tell(self, text: str, logged: bool = False) -> None:
        self._machine.events.add(Event(self._machine.clock.now, "", text), logged=logged)

    def _release(self) -> None:
        """Give the attributes back to the objects."""
        self.state = "python"
        self._call_before_laws(None)
        self._conditions.release()
        for each in self._fields:
            each.release()
        for law, python in zip(self._native, self._python, strict=False):
            law.end(python)  # those of this period that are still to come

    # Errors --------------------------------------------------------------------------------------------

    def _kind(self, fault: int) -> type[BaseException]:
        runtime = {2: DriverError, 4: RangeError, BAD_INPUT: BadInput, NEVER_READ: BadInput, 8: Interlocked}
        found = self._translation.kinds.get(fault) or runtime.get(fault)
        return found or RuntimeError

    def _failed(self, fault: int) -> None:
        """Raise the error that Python would have raised, at the place where it would have."""
        stored, self._error = self._error, None
        if stored is not None and stored[0] == fault:
            _raise(stored[1], *self._place(fault))
        slot = self._library.fault_object
        if fault in (BAD_INPUT, NEVER_READ) and slot >= 0:
            path, quality = self._image.items[slot].path, Quality(int(self._image.quality[slot]))
            why = "it was never read" if fault == NEVER_READ else ""
            _raise(BadInput(path, quality, why=why), *self._place(fault))
        kind, text = self._kind(fault), f"fault {fault} of a compiled law"
        text = next((each.text for each in self._translation.faults if each.number == fault), text)
        _raise(error_as_written(kind, OWN_TEXTS.get(kind, text)), *self._place(fault))

    def _place(self, fault: int) -> tuple[str, int]:
        """Return the file and the line of Python that raise a fault, or that call the function of the runtime that
        raises it. They are "" and 0 if unknown."""
        file, line = self._library.fault_place
        of_runtime = (self._translation.files[file], line) if line else ("", 0)
        return next(((each.file, each.line) for each in self._translation.faults if each.number == fault), of_runtime)

    # What only Python does -----------------------------------------------------------------------------

    def _columns_of(self) -> ColumnPointers:
        columns, groups = self._image.columns, self._machine.groups.parts
        self._clocks = (c_void_p * len(groups))(*(each.clock.in_c.buffer_info()[0] for each in groups))
        here = proxy(self)  # what C calls is not collected in a circle
        address = getattr(self._machine.sequences.current, "address", None)  # where umo's extension is built
        return ColumnPointers(
            c_void_p(columns.values.ctypes.data),
            c_void_p(columns.raws.ctypes.data),
            c_void_p(columns.quality.ctypes.data),
            c_void_p(columns.restrictions.ctypes.data),
            c_void_p(columns.pending.ctypes.data),
            c_void_p(address and columns.written.ctypes.data),
            c_void_p(columns.owners.ctypes.data),
            c_void_p(address and address()),
            cast(self._clocks, c_void_p),
            CHANGED(lambda slot, value: here._image.writes.note(slot, here._image.pending[slot], value)),
            WRITE(lambda *given: here._write(*given)),
            WRITE_MANY(lambda *given: here._write_many(*given)),
            READ(lambda slot, out: here._velocity(slot, out)),
            READ(lambda slot, out: here._read_now(slot, out)),
            HOST_CALL(lambda *given: here._host_call(*given)),
            TEXT_CALLBACK(lambda number, given: here._tell_text(number, given)),
        )

    def _done(self, work: Callable[[], Any]) -> int:
        """Carry out work that needs Python, and return the number of its fault."""
        if self.state == "compared":
            self._asked = True
            return NO_HOST
        self._pull_deques()
        try:
            work()
        except BaseException as error:  # a signal's, too: it is raised once the law has returned
            number = next((number for kind, number in NUMBERS if isinstance(error, kind)), NO_HOST)
            self._error = number, error
            return number
        finally:
            self._push_deques()
        return 0

    def _write(self, slot: int, value: float, taken: Any) -> int:
        if self.state == "compared":
            return self._foresee([(slot, value)], taken)
        item = self._image.items[slot]

        def work() -> None:
            given = (item.one if value else item.zero) if isinstance(item, Binary) else value
            taken[0] = item.write(given)  # type: ignore[attr-defined]

        return self._done(work)

    def _write_many(self, slots: Any, count: int, values: Any, where: Any, taken: Any) -> int:
        if self.state == "compared":
            return self._foresee([(slots[n], values[n]) for n in range(count) if not where or where[n]], taken)

        def work() -> None:
            key = tuple(slots[:count])
            if key not in self._vectors:
                self._vectors[key] = Vector([self._image.items[slot] for slot in key])
            mask = np.array(where[:count]) if where else None
            taken[0] = self._vectors[key].write(np.array(values[:count]), where=mask)

        return self._done(work)

    def _foresee(self, given: list[tuple[int, float]], taken: Any) -> int:
        """Write these values, as Python will change and admit them, to the copy of the pending values. Return the fault
        that this would cause, or 0. Nothing else is changed."""
        taken[0] = True
        try:
            values = [(slot, self._limited(slot, value, taken)) for slot, value in given]
            admitted = [self._is_admitted(slot, value) for slot, value in values]
        except (RangeError, Interlocked) as error:
            return next(number for kind, number in NUMBERS if isinstance(error, kind))
        for (slot, value), yes in zip(values, admitted, strict=True):
            if yes:
                self._shadow[slot] = value
        taken[0] = taken[0] and all(admitted)
        return 0

    def _limited(self, slot: int, value: float, taken: Any) -> float:
        item: Any = self._image.items[slot]
        if isinstance(item, Binary) or item.minimum <= value <= item.maximum:
            return value
        if item.limits != "clamp" or not isfinite(value):
            raise RangeError("the value is outside the range")
        taken[0] = False
        return min(max(value, item.minimum), item.maximum)  # type: ignore[no-any-return]

    def _is_admitted(self, slot: int, value: float) -> bool:
        command = self._machine.claims.by_slot.get(slot)
        return command is None or command.admits(value, Source.PROGRAM)

    def _read_now(self, slot: int, out: Any) -> int:
        def work() -> None:
            out[0] = self._image.read_now(slot)

        return self._done(work)

    def _velocity(self, slot: int, out: Any) -> int:
        out[0] = self._image.velocity(slot)
        return 0

    def _tell_text(self, number: int, given: Any) -> int:
        """Make an error or a text from these variables. While Python runs the laws, Python's own code makes errors and
        texts."""
        if self.state != "compiled":
            return 0
        text_maker = self._translation.text_makers[number]

        def work() -> None:
            made = text_maker.make(*(self._library.variable(given[n], of) for n, of in enumerate(text_maker.given)))
            if text_maker.field is not None:
                setattr(*text_maker.field, made)
            elif text_maker.fault:
                self._error = text_maker.fault, made

        return self._done(work)

    def _host_call(self, call: int, numbers: Any, count: int) -> int:
        owner, name = self._translation.hosts[call]
        return self._done(lambda: getattr(owner, name)(*numbers[:count]))


def _told(error: Any) -> str:
    if error is None:
        return "has no error"
    return f"raises {error.__name__ if isinstance(error, type) else type(error).__name__}"


def _raise(error: BaseException, file: str, line: int) -> None:
    """Raise an error as if from this line of a file; without a file, from where it was raised."""
    if not file:
        raise error
    exec(compile("\n" * max(0, line - 1) + "raise error", file, "exec"), {"error": error})
