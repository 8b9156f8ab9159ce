"""The linearization of a wiring entry."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Any

from umo.errors import DeclarationError
from umo.objects.linearization import Linearization, LookupTable, Polynomial
from umo.objects.thermocouple import Thermocouple
from umo.text import did_you_mean


def from_table(given: Any) -> Linearization:
    """The linearization of `{ thermocouple = "K" }`, `{ polynomial = [c0, c1, ...] }`, with
    `domain = [from, to]` where it is needed, or `{ table = [[inputs], [values]] }`. DeclarationError for anything
    else."""
    if not isinstance(given, Mapping) or not given:
        raise DeclarationError(f'must be a table such as {{ thermocouple = "K" }}, not {given!r}')
    kinds = ("thermocouple", "polynomial", "table")
    known = (*kinds, "domain") if "polynomial" in given else kinds
    for key in given:
        if key not in known:
            raise DeclarationError(f"unknown key {key!r}{did_you_mean(str(key), known)}; known: {', '.join(known)}")
    if len([key for key in given if key in kinds]) > 1:
        raise DeclarationError(f"has more than one of {', '.join(kinds)}")
    if "thermocouple" in given:
        return Thermocouple(given["thermocouple"])
    if "polynomial" in given:
        return Polynomial(given["polynomial"], given.get("domain", (-inf, inf)))
    columns = given["table"]
    if not isinstance(columns, list | tuple) or len(columns) != 2:
        raise DeclarationError(f"table must be two lists, [[inputs], [values]], not {columns!r}")
    return LookupTable(*columns)
