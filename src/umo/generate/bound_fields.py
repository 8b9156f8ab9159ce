"""Binds attributes of live objects to the memory of a compiled library. Code reads and sets the attributes as
before."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from types import CodeType
from typing import Any, TypeAlias

import numpy as np

from umo.generate.c_types import INT, MASK, ArrayType, CType, StateType
from umo.generate.function_source import shown_file
from umo.generate.struct_memory import PLAIN, WRONG, StructMemory, ValueDoesNotFit, require

OF_ABSTRACT_CLASSES = "_abc_impl", "__abstractmethods__"
"""Attributes that every class with the metaclass ABCMeta has of its own."""


def _references() -> int:
    names: dict[str, Any] = {"name": []}
    value = names.get("name")
    return sys.getrefcount(value)


REFERENCES_OF_ONE_NAME = _references()
"""The number of references that this version of Python counts for a value with one name."""


class BoundList(list[Any]):
    """A list whose elements are in the memory of a compiled library. The list object itself holds the elements of the
    last reading. Its length is fixed. Code that would change the length causes a call of `refused`, and the change is
    made in the list of the object."""

    def __init__(self, memory: StructMemory, name: str, refused: Callable[[], list[Any]]) -> None:
        super().__init__(memory.read(name))
        self._memory, self._name, self._refused = memory, name, refused
        self._own: list[Any] | None = None
        """The list of the object, once its elements are no longer in the memory."""

    def unbind(self) -> list[Any]:
        """Return the list that the object has from now on. Code that holds the bound list continues with the same
        elements."""
        if self._own is None:
            self._own = self.copy()
        return self._own

    def renew(self) -> BoundList:
        """Read the elements from the memory again."""
        list.__setitem__(self, slice(None), self._memory.read(self._name) if self._own is None else self._own)
        return self

    def take(self, values: list[Any]) -> None:
        """Replace the elements of the list."""
        try:
            if self._own is None:
                require(self._memory.fields[self._name], values)
                self._memory.write(self._name, values)
        except WRONG:
            self._own = self._refused()
        if self._own is not None:
            self._own[:] = values
        self.renew()

    def __len__(self) -> int:
        return super().__len__() if self._own is None else len(self._own)

    def __getitem__(self, place: Any) -> Any:
        if self._own is not None:
            return self._own[place]
        if type(place) is int and -len(self) <= place < len(self):
            return self._memory.element(self._name, place)  # that of one place costs no look at the others
        return list.__getitem__(self.renew(), place)

    def __iter__(self) -> Iterator[Any]:
        place = 0
        while place < len(self):
            yield self[place]
            place += 1

    def __reduce_ex__(self, protocol: Any) -> Any:
        return list, (self.copy(),)


def _reading(name: str) -> Callable[..., Any]:
    """Return a method of a list that does not change the list."""
    of_lists = getattr(list, name)

    def read(self: BoundList, *given: Any, **named: Any) -> Any:
        return of_lists(self.renew(), *given, **named)

    return read


def _joining(self: BoundList, others: list[Any]) -> Any:
    """Return `others + self`. Without this method a list would join its old elements."""
    return others + self.copy() if isinstance(others, list) else NotImplemented


def _changing(name: str) -> Callable[..., Any]:
    """Return a method of a list that changes the list."""
    of_lists = getattr(list, name)

    def change(self: BoundList, *given: Any, **named: Any) -> Any:
        values = self.copy()
        result = of_lists(values, *given, **named)
        self.take(values)
        return result if result is not values else self if self._own is None else self._own

    return change


for _name in ("__contains__", "__reversed__", "__repr__", "__add__", "__mul__", "__rmul__",
              "__eq__", "__ne__", "__lt__", "__le__", "__gt__", "__ge__", "copy", "count", "index"):  # fmt: skip
    setattr(BoundList, _name, _reading(_name))
for _name in ("__setitem__", "__delitem__", "__iadd__", "__imul__", "append", "clear", "extend", "insert", "pop",
              "remove", "reverse", "sort"):  # fmt: skip
    setattr(BoundList, _name, _changing(_name))
BoundList.__radd__ = _joining  # type: ignore[attr-defined]


Get: TypeAlias = Callable[[Any], Any]
Set: TypeAlias = Callable[[Any, Any], None]
SetAny: TypeAlias = Callable[[Any, str, Any], None]


class BoundFields:
    """The fields of one live object. While they are bound, the object has a subclass of its own class. If code sets a
    value that a field cannot hold, `refused` is called, which releases the fields."""

    def __init__(
        self,
        memory: StructMemory,
        owner: Any,
        states: set[str],
        refused: Callable[[str], None],
        taken: frozenset[str] = frozenset(),
    ) -> None:
        """`states`: the fields that compiled code assigns. `taken`: the names of other attributes whose values compiled
        code takes as known. Raises TypeError if an object of this class cannot be bound."""
        self._taken, self._label = taken, memory.label
        self._memory, self.owner, self._refused, self._states = memory, owner, refused, states
        self._own = set[str]()
        """The fields that are attributes of the object itself, not of its class."""
        self._set_at: dict[str, tuple[CodeType, dict[str, Any], int]] = {}
        """The code that has set each name which translation took as known."""
        self._lists: dict[str, BoundList] = {}
        self._given: dict[str, Any] = {}
        """Lists and arrays that were set since the laws last ran."""
        self.was_given: Callable[[BoundFields], None] = lambda fields: None
        """Called when the object is given a list or an array."""
        self._of_class: dict[str, str] = {}
        """The class attributes behind the other fields, as text."""
        self._class = kind = type(owner)
        self._bound = False
        names = {name: self._property(name, of) for name, of in memory.fields.items()}
        self._below = class_below(kind, {**names, "__setattr__": self._setter(), "__delattr__": self._deleter()})

    @property
    def names(self) -> frozenset[str]:
        """The names of the fields."""
        return frozenset(self._memory.fields)

    def bind(self) -> None:
        """Copy the values of the object to the fields. From now on the attributes of the object are the fields."""
        self._memory.push()
        self._memory.forget()
        for name in self._memory.fields:
            if name not in vars(self.owner) and isinstance(getattr(self.owner, name), list | np.ndarray):
                raise ValueError(f"{self._label}.{name} is a list or an array of its class, which other objects share")
            if not self._is_rebound(name) and is_shared(vars(self.owner), name):
                raise ValueError(f"{self._label}.{name} is a list or an array to which other references exist")
        self._own = {name for name in self._memory.fields if name in vars(self.owner)}
        for name in self._memory.fields.keys() - self._own:
            type.__setattr__(self._below, name, self._inherited(name))
        masks = {name: getattr(self.owner, name) for name, of in self._memory.fields.items() if of == MASK}
        object.__setattr__(self.owner, "__class__", self._below)
        for name in self._memory.fields:
            vars(self.owner).pop(name, None)
        self._bound = True
        for name, accepted in masks.items():
            setattr(self.owner, name, accepted)

    def release(self) -> None:
        """Give the attributes back to the object, except those that are attributes of its class and that no code has
        set."""
        if not self._bound:
            return
        values = {name: getattr(self.owner, name) for name in self._memory.fields}
        object.__setattr__(self.owner, "__class__", self._class)
        for name, value in values.items():
            if name in vars(self.owner):
                continue  # somebody has gone around the class
            if name in self._own or repr(value) != self._of_class[name]:
                object.__setattr__(self.owner, name, value if name in self._given else self._for_python(name, value))
        self._given.clear()
        self._bound = False

    def _for_python(self, name: str, value: Any) -> Any:
        """Return the value that an attribute gets when Python runs the laws again: laws in Python may change a list or
        an array in place."""
        if name in self._lists:
            return self._lists[name].unbind()
        is_read = isinstance(value, np.ndarray) and value.dtype.kind == "i" and not value.flags.writeable
        return value.copy() if is_read or (isinstance(value, np.ndarray) and name in self._states) else value

    def take_given(self) -> None:
        """Copy lists and arrays that were set since the last period to the memory. If one of them has other references,
        the laws run in Python again, because changes through those references would not be seen."""
        for name in tuple(self._given):
            try:
                self._memory.check(name, self._given[name])
                self._memory.write(name, self._given[name])
            except ValueDoesNotFit as error:
                self._refused(str(error))
                return
            if not self._is_rebound(name) and is_shared(self._given, name):
                self._refused(f"{self._label}.{name} is set to a list or an array to which other references exist")
                return
            del self._given[name]

    def _is_rebound(self, name: str) -> bool:
        """True if this is an array that compiled code assigns. Then references to the old array do not see the new
        array."""
        return name in self._states and not isinstance(vars(self.owner).get(name, self._given.get(name)), list)

    def _give(self, name: str, value: Any) -> None:
        self._given[name] = value
        self.was_given(self)

    def setter(self, name: str) -> str:
        """Return the file and line that set a name that translation takes as known; "" if the name is not such a
        name."""
        if name not in self._set_at:
            return ""
        code, scope, line = self._set_at[name]
        return f"{shown_file(code.co_filename, scope.get('__name__', ''))}:{line}"

    def _inherited(self, name: str) -> property:
        """Return the field of a class attribute: the object gets its own attribute when it is set."""
        get, put = self._checked(name, self._memory.fields[name])
        self._of_class[name] = repr(get(self.owner))

        def own(owner: Any, value: Any) -> None:
            self._own.add(name)
            put(owner, value)

        return property(get, own)

    def _property(self, name: str, of: CType) -> Any:
        """Return the descriptor of an attribute. It is written in C if the type is plain, because sequences read it in
        each period."""
        get, checked = self._checked(name, of)
        return self._memory.attribute(name, checked) or property(get, checked)

    def _checked(self, name: str, of: CType) -> tuple[Get, Set]:
        get, put = self._access(name, of)

        def checked(owner: Any, value: Any) -> None:
            try:
                self._memory.check(name, value)
            except ValueDoesNotFit as error:
                self._refused(str(error))
                setattr(owner, name, value)
            else:
                put(owner, value)

        return get, checked

    def _setter(self) -> SetAny:
        """Return the function that sets any attribute. An object that replaces a method, such as an experiment, is not
        compiled."""
        kind: Any = self._class
        path, taken = self._label, self._taken

        def put(owner: Any, name: str, value: Any) -> None:
            if name in ("__class__", "__dict__") or callable(getattr(kind, name, None)):
                self._refused(f"{path}.{name} is replaced")
                setattr(owner, name, value)
                return
            if name in taken:
                caller = sys._getframe(1)
                self._set_at[name] = caller.f_code, caller.f_globals, caller.f_lineno
            kind.__setattr__(owner, name, value)

        return put

    def _deleter(self) -> Callable[[Any, str], None]:
        """Return the function that deletes any attribute. The laws then run in Python, because compiled code would
        still use the field."""
        path = self._label

        def delete(owner: Any, name: str) -> None:
            self._refused(f"{path}.{name} is deleted")
            delattr(owner, name)

        return delete

    def _access(self, name: str, of: CType) -> tuple[Get, Set]:
        if of in PLAIN:
            return _of_number(self._memory.view(name, PLAIN[of]))
        if isinstance(of, StateType):
            return _of_state(self._memory.view(name, "B"), list(of.kind))
        if of == MASK:
            return self._of_mask(name)
        if isinstance(of, ArrayType) and of.listed:
            return self._of_list(name)
        if isinstance(of, ArrayType):
            return self._of_array(name, of)
        return self._of_others(name)

    def _of_mask(self, name: str) -> tuple[Get, Set]:
        """Return the access to accepted qualities. Python reads them as they were set."""
        given: list[Any] = [()]

        def put(_: Any, value: Any) -> None:
            self._memory.write(name, value)
            given[0] = value

        return (lambda _: given[0]), put

    def _of_list(self, name: str) -> tuple[Get, Set]:
        def refused() -> Any:
            self._refused(f"{self._label}.{name} has another length, or an element of another class")
            return getattr(self.owner, name)

        self._lists[name] = found = BoundList(self._memory, name, refused)

        def put(_: Any, value: Any) -> None:
            self._memory.write(name, value)
            self._give(name, value)

        return (lambda _: self._given[name] if name in self._given else found.renew()), put

    def _of_array(self, name: str, of: ArrayType) -> tuple[Get, Set]:
        """Return the access to an array. Python gets a read-only copy of an array that compiled code assigns, as it is
        replaced in each period, and of one of integers, which have 64 bits in numpy."""
        view = self._memory.array(name, of)
        is_given = name not in self._states and of.of != INT
        kind = np.int64 if of.of == INT else view.dtype

        def get(_: Any) -> Any:
            if name in self._given:
                return self._given[name]
            if is_given:
                return view
            copy = view.astype(kind)
            copy.flags.writeable = False
            return copy

        def put(_: Any, value: Any) -> None:
            view[:] = value
            self._give(name, value)

        return get, put

    def _of_others(self, name: str) -> tuple[Get, Set]:
        def put(_: Any, value: Any) -> None:
            self._memory.write(name, value)

        return (lambda _: self._memory.read(name)), put


class _NoSubclassHook:
    """Suppresses `__init_subclass__` of the other bases when a subclass is made."""

    __slots__ = ()

    def __init_subclass__(cls) -> None:
        """Do nothing."""


def _has_subclass_hook(kind: type) -> bool:
    """True if a class is informed of its subclasses by code other than that of typing."""
    own = (each for each in kind.__mro__[:-1] if "__init_subclass__" in vars(each))
    return any(each.__module__ != "typing" for each in own)


def class_below(kind: type, names: dict[str, Any]) -> type:
    """Return a subclass that differs from the class in these names only. Raises TypeError if such a subclass cannot be
    made."""
    inside = {"__slots__": (), "__module__": kind.__module__, "__doc__": kind.__doc__, **names}
    bases = (_NoSubclassHook, kind) if _has_subclass_hook(kind) else (kind,)
    found: type = _metaclass(kind)(kind.__name__, bases, inside)
    type.__setattr__(found, "__qualname__", kind.__qualname__)
    return found


def _metaclass(kind: type) -> Any:
    """Return the metaclass of such a subclass. Attributes set on it are set on the original class: `type(m).limit =
    5.0`."""

    def put(below: type, name: str, value: Any) -> None:
        if name in OF_ABSTRACT_CLASSES:
            type.__setattr__(below, name, value)
        else:
            setattr(kind, name, value)

    def delete(_: type, name: str) -> None:
        delattr(kind, name)

    return type(type(kind).__name__, (type(kind),), {"__setattr__": put, "__delattr__": delete})


def is_shared(names: dict[str, Any], name: str) -> bool:
    """True if a list or an array has references other than these names, or is a view of an array that has such
    references."""
    value = names.get(name)
    if not isinstance(value, list | np.ndarray):
        return False
    base = getattr(value, "base", None)
    return sys.getrefcount(value) > REFERENCES_OF_ONE_NAME or (
        base is not None and sys.getrefcount(base) > REFERENCES_OF_ONE_NAME
    )


def _of_number(view: Any) -> tuple[Get, Set]:
    def put(_: Any, value: Any) -> None:
        view[0] = value

    return (lambda _: view[0]), put


def _of_state(view: Any, members: list[Any]) -> tuple[Get, Set]:
    numbers = {member: number for number, member in enumerate(members)}

    def put(_: Any, value: Any) -> None:
        view[0] = numbers[value]

    return (lambda _: members[view[0]]), put
