"""Makes names in C for paths in Python."""

from __future__ import annotations

import re
from collections.abc import Iterable

WORDS_OF_C = frozenset(
    """
    alignas alignof and and_eq asm atomic_cancel auto bitand bitor bool break case catch char class compl concept
    const consteval constexpr constinit const_cast continue co_await co_return co_yield decltype default delete do
    double dynamic_cast else enum errno explicit export extern false float for friend goto if inline int linux long
    main mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public register
    reinterpret_cast requires restrict return short signed sizeof static static_assert static_cast struct switch
    template this thread_local throw true try typedef typeid typename typeof union unix unsigned using virtual void
    volatile wchar_t while xor xor_eq _Alignas _Alignof _Atomic _Bool _Complex _Generic _Imaginary _Noreturn
    _Pragma _Static_assert _Thread_local stdin stdout stderr signbit isnan isinf isfinite
    """.split()  # noqa: SIM905
)
"""Words with a meaning in C, in C++ or in their headers."""
OF_OTHERS = "umo_", "machine_", "__"
"""Beginnings of names that umo or a compiler defines."""


def identifier(path: str) -> str:
    """Return the last part of a C name for a path, such as `zones_3_heater`."""
    return re.sub(r"\W", "_", path, flags=re.ASCII)


def identifiers(paths: Iterable[str]) -> list[str]:
    """Return different C names for these paths."""
    found: list[str] = []
    for path in paths:
        name = identifier(path)
        while name in found:
            name += "_"
        found.append(name)
    return found


def member_name(name: str) -> str:
    """Return the name in C of an attribute. The name is not a keyword, macro or type of C, and not a name that umo
    uses. No other attribute has the same name.

    Names in upper case are those of macros; names that end with `_t` are those of types. The suffix that is added to
    such a name is also added to a name that already ends with it."""
    if not name.isascii():
        return "".join(each if re.match("[A-Za-z0-9]", each) else f"_{ord(each):x}_" for each in name) + "_u"
    is_taken = name in WORDS_OF_C or name.isupper() or name.startswith(OF_OTHERS) or name.endswith("_t")
    return f"{name}_" if is_taken or name.endswith(("_", "_u")) else name
