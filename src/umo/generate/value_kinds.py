"""The kinds of values and objects that translated code may use. The class of a value must not change its behaviour.

Everything here is a whitelist. For each operation that a class may define itself (`__eq__`, `__bool__`, `__setattr__`,
`__getattribute__`, a descriptor) the object is accepted only if it has Python's definition."""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from enum import Enum, Flag
from functools import cached_property
from types import (
    BuiltinFunctionType,
    FunctionType,
    MappingProxyType,
    MemberDescriptorType,
    MethodType,
    ModuleType,
    WrapperDescriptorType,
)
from typing import Any

import numpy as np

from umo.objects import Compound, Node, Vector
from umo.objects.attributes import DeclaredAttributes
from umo.states import TwoState

MOST_STATES = 256
"""Maximum number of members of an Enum. The number of a member is stored in a byte."""
COMPARED = ("__eq__", "__ne__", "__hash__")
TRUTH = ("__bool__", "__len__")
OF_TUPLES = (*COMPARED, *TRUTH, "__getitem__", "__iter__", "__contains__", "__getattribute__", "__add__", "__mul__",
             "__lt__", "__le__", "__gt__", "__ge__")  # fmt: skip
OF_RECORDS = (*TRUTH, "__getattribute__", "__getattr__", "__post_init__", "__new__", "__getitem__", "__iter__")
MADE = "__init__", "__eq__", "__hash__", "__setattr__", "__delattr__"
"""Methods that `dataclass` generates."""
SCALARS = (bool, int, float, str, bytes, type(None))
CONTAINERS = (tuple, list, dict, str, range, set, frozenset, MappingProxyType, np.ndarray)
"""Classes of containers whose elements Python itself finds."""
WITHOUT_FIELDS = (
    *SCALARS,
    *CONTAINERS,
    type,
    ModuleType,
    FunctionType,
    MethodType,
    BuiltinFunctionType,
    Enum,
    np.generic,
)
"""Classes whose objects have no attributes that can be assigned."""
REFUSING = (TwoState, Node)
"""Classes whose objects are equal only to themselves, and refuse comparison with numbers, strings and other states."""
OWN_MODULES = ("builtins", "enum", "typing", "collections")
PLAIN_READING: tuple[Any, ...] = (object.__getattribute__, tuple.__getattribute__)
NUMPY_NUMBERS = (np.float64, np.int64, np.bool_)


def static_attribute(kind: type, name: str) -> Any:
    """Return the unevaluated attribute of a class or its metaclass, or None."""
    metaclass: type = type(kind)
    return next((vars(each)[name] for each in (*kind.__mro__, *metaclass.__mro__) if name in vars(each)), None)


def own_methods(kind: type, names: Iterable[str]) -> list[str]:
    """Return those of these methods that a class defines itself."""
    found = []
    for name in names:
        for each in kind.__mro__:
            if name in vars(each):
                if each.__module__ not in OWN_MODULES:
                    found.append(name)
                break
    return found


def own_equality(kind: type, names: Iterable[str] = COMPARED) -> bool:
    """True if a class itself defines which of its objects are equal."""
    of_umo = [vars(each).get(name) for each in REFUSING for name in names]
    return any(getattr(kind, name) not in of_umo for name in own_methods(kind, names))


def refuse_comparison(one: type, other: type) -> bool:
    """Return True if objects of these classes refuse comparison by `==`."""
    return one is not other and any(
        issubclass(refusing, REFUSING) and issubclass(plain, (Enum, *SCALARS[:-1], np.generic))
        for refusing, plain in ((one, other), (other, one))
    )


def made_by_code(kind: type) -> bool:
    """True if code outside Python and umo makes the objects of this class."""
    own = [each for each in kind.__mro__ if each.__module__.partition(".")[0] not in (*OWN_MODULES, "umo")]
    return any(name in vars(each) for each in own for name in ("__init__", "__new__", "__post_init__"))


def is_plain_enum(kind: type) -> bool:
    """True if members of this Enum are equal only to themselves, or to their number or string."""
    return (
        not issubclass(kind, Flag)
        and len(kind) <= MOST_STATES  # type: ignore[arg-type]
        and not own_equality(kind)
        and not own_methods(kind, ("__getattribute__", "__setattr__"))
    )


def is_bare_enum(kind: type) -> bool:
    """True if members of this Enum are equal only to themselves, because they are neither numbers nor strings."""
    return all(each in (object, Enum) or issubclass(each, Enum) for each in kind.__mro__)


def is_plain_record(kind: type) -> bool:
    """True if this is a NamedTuple that defines nothing but the names of its fields."""
    if kind is tuple:
        return True
    names: tuple[str, ...] = getattr(kind, "_fields", ())
    base = next((each for each in kind.__mro__ if "_fields" in vars(each)), None)
    if base is None or own_methods(kind, (name for name in OF_TUPLES)):
        return False
    if any("__new__" in vars(each) or "__init__" in vars(each) for each in kind.__mro__[: kind.__mro__.index(base)]):
        return False
    return all(type(inspect.getattr_static(kind, name)).__name__ == "_tuplegetter" for name in names)


def is_plain_dataclass(kind: Any) -> bool:
    """True if this is a frozen dataclass that is compared by its fields and has only generated methods."""
    parameters = vars(kind).get("__dataclass_params__") if isinstance(kind, type) else None
    if parameters is None or not (parameters.frozen and parameters.eq) or own_methods(kind, OF_RECORDS):
        return False
    own = [vars(each)[name] for each in kind.__mro__[:-1] for name in MADE if name in vars(each)]
    is_made = all(type(each) is FunctionType and each.__code__.co_filename == "<string>" for each in own)
    return is_made and all(each.init and not each.kw_only for each in fields(kind))


def parts_of(value: Any) -> tuple[Any, ...]:
    """Return the values of a tuple, or of the fields of a dataclass."""
    return tuple(getattr(value, each.name) for each in fields(value)) if is_dataclass(value) else tuple(value)


def is_container(value: Any) -> bool:
    """True if Python itself finds the elements of this value."""
    return (
        type(value) in (*CONTAINERS, zip, enumerate, reversed)
        or isinstance(value, Vector)
        or (isinstance(value, tuple) and is_plain_record(type(value)))
    )


def is_ring(value: Any) -> bool:
    """True if this is a deque."""
    return type(value) is deque


def is_fixed_ring(value: Any) -> bool:
    """True if this is a deque with a `maxlen`. Its elements are fields; those of other deques are known values."""
    return is_ring(value) and value.maxlen is not None


def is_immutable(value: Any) -> bool:
    """True if comparing this value always gives the same result."""
    if isinstance(value, Enum):
        return is_plain_enum(type(value))
    if isinstance(value, tuple):
        return is_plain_record(type(value)) and all(map(is_immutable, value))
    return type(value) in SCALARS


def compares_by_identity(value: Any) -> bool:
    """True if the value is equal only to itself."""
    return not own_equality(type(value), ("__eq__", "__ne__")) and type(value) not in CONTAINERS


def refused_truth(value: Any) -> bool:
    """True if code of the value's class decides whether the value is true."""
    return type(value) not in (*SCALARS, *CONTAINERS) and bool(own_methods(type(value), TRUTH))


def attribute_kind(owner: Any, name: str) -> str:
    """Return what an attribute is when it is read: "property", "function" or "value". Otherwise return the reason why
    it cannot be translated."""
    kind = type(owner)
    static = static_attribute(kind, name)
    if kind.__getattribute__ not in PLAIN_READING:
        return f"{kind.__name__} has a __getattribute__"
    if type(static) is property:
        return "property" if static.fget is not None else f"{name} has no getter"
    in_instance = name in getattr(owner, "__dict__", ())
    if isinstance(static, cached_property):
        return "value" if in_instance else f"{name} is a cached_property: it is computed when first read"
    if isinstance(static, FunctionType | staticmethod | classmethod):
        return "function of the instance" if in_instance else "function"
    if isinstance(static, MemberDescriptorType) or (in_instance and not hasattr(type(static), "__set__")):
        return "value"
    if static is None or not hasattr(type(static), "__get__"):
        found = inspect.getattr_static(owner, name, owner) is not owner
        return "value" if found or not hasattr(kind, "__getattr__") else f"{kind.__name__} has a __getattr__"
    if isinstance(static, WrapperDescriptorType) or kind.__module__.partition(".")[0] == "builtins":
        return "function"
    return f"{name} is a {type(static).__name__}, a user-defined descriptor"


def refused_store(owner: Any, name: str) -> str:
    """Return the reason why an attribute cannot be assigned in translated code; empty if it can."""
    kind = type(owner)
    if isinstance(owner, WITHOUT_FIELDS):
        what = f"the class {owner.__name__}" if isinstance(owner, type) else f"a {kind.__name__}"
        return f"an attribute of {what} is assigned"
    if isinstance(owner, Compound):
        if kind.__setattr__ is not vars(Compound)["__setattr__"]:
            return f"{kind.__name__} has a __setattr__"
        return f"{name} is a part, and parts cannot be replaced" if name in owner._fixed else ""
    if isinstance(owner, Node):
        return f"an attribute of a {kind.__name__} is assigned"
    setters: tuple[Any, ...] = object.__setattr__, DeclaredAttributes.__setattr__
    if kind.__setattr__ not in setters:
        return f"{kind.__name__} has a __setattr__, or is frozen"
    return ""
