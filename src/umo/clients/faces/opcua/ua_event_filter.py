"""Selects the events that a monitored item reports, and their fields (OPC 10000-4, 7.7 and 7.22.3)."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace

from umo.clients.faces.opcua.ua_attributes import bounds
from umo.clients.faces.opcua.ua_data_filter import is_none
from umo.clients.faces.opcua.ua_types import below, is_structure, lineage

_C = ua.StatusCodes
_F = ua.FilterOperator
_A = ua.AttributeIds
BASE_EVENT = ua.NodeId(ua.ObjectIds.BaseEventType)
MAX_ELEMENTS, MAX_CLAUSES = 100, 200
"""Largest numbers of elements of a where clause, and of fields."""
COMPARISONS: Mapping[Any, Callable[[Any, Any], Any]] = {
    _F.Equals: operator.eq,
    _F.GreaterThan: operator.gt,
    _F.LessThan: operator.lt,
    _F.GreaterThanOrEqual: operator.ge,
    _F.LessThanOrEqual: operator.le,
}
OPERANDS: Mapping[Any, tuple[int, int]] = {
    **dict.fromkeys(COMPARISONS, (2, 2)),
    _F.IsNull: (1, 1), _F.Not: (1, 1), _F.OfType: (1, 1), _F.Like: (2, 2), _F.And: (2, 2), _F.Or: (2, 2),
    _F.Between: (3, 3), _F.InList: (2, MAX_ELEMENTS),
}  # fmt: skip
"""Supported operators, each with the fewest and most operands. Cast, InView, RelatedTo and the bit operators are not
supported."""


class EventFilter:
    """The checked filter of a client. Raises ServiceError if it cannot be used at all; `result` lists its errors."""

    def __init__(self, space: AddressSpace, given: Any) -> None:
        if is_structure(given, ua.DataChangeFilter) or is_structure(given, ua.AggregateFilter):
            raise ServiceError(_C.BadFilterNotAllowed)
        if is_none(given) or not is_structure(given, ua.EventFilter):
            raise ServiceError(_C.BadEventFilterInvalid)
        self._space = space
        self._select = list(given.SelectClauses or [])
        self._where = list(given.WhereClause.Elements or [])
        clauses = [self._clause(each) for each in self._select[:MAX_CLAUSES]]
        elements = [self._element(place, each) for place, each in enumerate(self._where[:MAX_ELEMENTS])]
        too_many = len(self._select) > MAX_CLAUSES or len(self._where) > MAX_ELEMENTS
        self.result = ua.EventFilterResult(
            SelectClauseResults=[ua.StatusCode(each) for each in clauses],
            WhereClauseResult=ua.ContentFilterResult(ElementResults=elements),
        )
        self.is_whole = not any(clauses)
        """True if every requested field exists."""
        self.is_valid = not too_many and not all(clauses) and all(each.StatusCode.is_good() for each in elements)
        """True if there is at least one valid field, and a where clause that can be evaluated."""
        self.cost = self._cost()
        """The cost of an event, in units of about 2 us. Each field, each element of the where clause, and each text in
        it counts."""

    def _cost(self) -> int:
        operands = [each for element in self._where for each in element.FilterOperands or []]
        values = [each.Value.Value for each in operands if is_structure(each, ua.LiteralOperand) and each.Value]
        texts = sum(len(each) // 5 for each in values if isinstance(each, str))
        return 20 + len(self._select) + 20 * len(self._where) + 2 * len(operands) + texts

    # Fields ------------------------------------------------------------------------------------------------

    def _clause(self, clause: Any) -> int:
        """Return 0 if events can have the field of a clause; otherwise the code of the error."""
        if not below(self._space, clause.TypeDefinitionId, BASE_EVENT):
            return _C.BadTypeDefinitionInvalid
        if clause.AttributeId not in (_A.Value, _A.NodeId):
            return _C.BadAttributeIdInvalid
        if any(each is None or not each.Name for each in clause.BrowsePath or []):
            return _C.BadBrowseNameInvalid
        if clause.IndexRange and bounds(clause.IndexRange) is None:
            return _C.BadIndexRangeInvalid
        if clause.IndexRange:  # no field of an event is an array
            return _C.BadIndexRangeNoData
        if clause.TypeDefinitionId == BASE_EVENT or not clause.BrowsePath:
            return 0
        return 0 if self._has_field(clause.TypeDefinitionId, clause.BrowsePath) else _C.BadNodeIdUnknown

    def _has_field(self, kind: ua.NodeId, path: list[ua.QualifiedName]) -> bool:
        """True if a type of events, or one above it, has a field."""
        for each in lineage(self._space, kind):
            found = [each]
            for name in path:
                nodes = [self._space[one] for one in found if one in self._space]
                found = [
                    ref.NodeId for node in nodes for ref in node.references if ref.IsForward and ref.BrowseName == name
                ]
            if found:
                return True
        return False

    def fields(self, event: Any) -> list[ua.Variant]:
        """Return the requested fields of an event, with null for fields that the event does not have."""
        return [_field(event, each) for each in self._select]

    # Where clause ------------------------------------------------------------------------------------------

    def _element(self, place: int, element: Any) -> ua.ContentFilterElementResult:
        """Return the error of an element of the where clause."""
        operands = list(element.FilterOperands or [])
        codes = [self._operand(place, each) for each in operands]
        code = _C.BadFilterOperandInvalid if any(codes) else 0
        limits = OPERANDS.get(element.FilterOperator)
        if limits is None:
            code = _C.BadFilterOperatorUnsupported
        elif not limits[0] <= len(operands) <= limits[1]:
            code = _C.BadFilterOperandCountMismatch
        return ua.ContentFilterElementResult(ua.StatusCode(code), [ua.StatusCode(each) for each in codes])

    def _operand(self, place: int, operand: Any) -> int:
        if is_structure(operand, ua.LiteralOperand):
            return 0
        if is_structure(operand, ua.ElementOperand):  # elements refer to later ones: there are no loops
            return 0 if place < operand.Index < len(self._where) else _C.BadFilterOperandInvalid
        if is_structure(operand, ua.SimpleAttributeOperand):
            return self._clause(operand)
        return _C.BadFilterOperandInvalid

    def passes(self, event: Any) -> bool:
        """True if an event is sent: the where clause is empty, or is true for the event. It is not sent if the clause
        is false or null."""
        results: list[bool | None] = [None] * len(self._where)
        for place in reversed(range(len(self._where))):  # each once, however often others refer to it
            element = self._where[place]
            values = [self._value(each, event, results) for each in element.FilterOperands]
            results[place] = self._evaluated(element.FilterOperator, values, event)
        return not results or results[0] is True

    def _evaluated(self, kind: Any, values: list[Any], event: Any) -> bool | None:
        """Return the result, or None for null: an operand is missing or cannot be compared."""
        if kind == _F.IsNull:
            return values[0] is None
        if kind in (_F.And, _F.Or):
            decisive = kind == _F.Or
            if any(each is decisive for each in values):
                return decisive
            return None if any(not isinstance(each, bool) for each in values) else not decisive
        if kind == _F.OfType:
            return isinstance(values[0], ua.NodeId) and below(self._space, event.EventType, values[0])
        if kind == _F.InList:
            return None if values[0] is None else any(_compared(operator.eq, values[0], each) for each in values[1:])
        if any(each is None for each in values):
            return None
        if kind == _F.Not:
            return not values[0] if isinstance(values[0], bool) else None
        if kind == _F.Between:
            return _compared(operator.ge, values[0], values[1]) and _compared(operator.le, values[0], values[2])
        return like(*values) if kind == _F.Like else _compared(COMPARISONS[kind], *values)

    def _value(self, operand: Any, event: Any, results: list[bool | None]) -> Any:
        if is_structure(operand, ua.ElementOperand):
            return results[operand.Index]
        if is_structure(operand, ua.LiteralOperand):
            return None if operand.Value is None else _plain(operand.Value.Value)
        return _plain(_field(event, operand).Value)


def _field(event: Any, clause: Any) -> ua.Variant:
    """Return a field of an event. A client requests the NodeId of the condition by the attribute NodeId, without a
    path."""
    path = clause.BrowsePath or []
    if not path and clause.AttributeId == _A.NodeId:
        name = "NodeId"
    elif clause.AttributeId != _A.Value or clause.IndexRange:
        return ua.Variant()
    else:
        name = "/".join(str(each.Name) for each in path)
    kind = event.data_types.get(name)
    value = None if kind is None else getattr(event, name)
    return ua.Variant() if value is None else ua.Variant(value, kind)


def _plain(value: Any) -> Any:
    return value.Text if isinstance(value, ua.LocalizedText) else value


def _compared(how: Callable[[Any, Any], Any], one: Any, other: Any) -> bool | None:
    try:
        return bool(how(one, other))
    except TypeError:
        return None


def like(text: Any, pattern: Any) -> bool | None:
    """Return whether a string matches a pattern, or None if one of the two is not a string. % stands for any
    characters, _ for one character, [ab] or [a-c] for one of these characters, [^ab] for any other one. A backslash
    makes the next character literal."""
    if not isinstance(text, str) or not isinstance(pattern, str):
        return None
    parts = re.findall(r"\\.|\[\^?[^\]]+\]|.", pattern, re.DOTALL)
    at = part = 0
    again: tuple[int, int] | None = None  # the last %: only it is tried again, in linear time
    while at < len(text):
        if part < len(parts) and parts[part] == "%":
            part += 1
            again = at, part
        elif part < len(parts) and _is_like(text[at], parts[part]):
            at, part = at + 1, part + 1
        elif again is not None:
            again = again[0] + 1, again[1]
            at, part = again
        else:
            return False
    return all(each == "%" for each in parts[part:])


def _is_like(character: str, part: str) -> bool:
    if part == "_":
        return True
    if len(part) < 3:
        return character == part[-1]
    inverse = part.startswith("[^")
    listed = re.findall(r".-.|.", part[1 + inverse : -1], re.DOTALL)
    return any(each[0] <= character <= each[-1] for each in listed) != inverse
