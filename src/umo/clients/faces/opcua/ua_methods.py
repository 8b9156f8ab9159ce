"""Methods: checks which methods an object has, and whether arguments match their declarations (OPC 10000-4, 5.12)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace

from umo.clients.faces.opcua.ua_attributes import missing
from umo.clients.faces.opcua.ua_types import encoding, fits, lineage

_C = ua.StatusCodes
_O = ua.ObjectIds
COMPONENT, KIND, PROPERTY = (ua.NodeId(each) for each in (_O.HasComponent, _O.HasTypeDefinition, _O.HasProperty))


def refusal(space: AddressSpace, request: ua.CallMethodRequest) -> ua.StatusCode | None:
    """Return the StatusCode that says why this method of an object cannot be called, or None if it can."""
    if request.ObjectId not in space:
        return missing(request.ObjectId)
    if request.MethodId.is_null():
        return ua.StatusCode(_C.BadNodeIdInvalid)
    return None if has_method(space, request.ObjectId, request.MethodId) else ua.StatusCode(_C.BadMethodInvalid)


def has_method(space: AddressSpace, node: ua.NodeId, method: ua.NodeId) -> bool:
    """True if a method is a component of an object, of its type, or of a type above."""
    data = space.get(method)
    if data is None or data.attributes[ua.AttributeIds.NodeClass].value.Value.Value != ua.NodeClass.Method:
        return False
    kinds = [each.NodeId for each in space[node].references if each.IsForward and each.ReferenceTypeId == KIND]
    owners = [node, *lineage(space, kinds[0] if kinds else node)]
    return any(
        each.IsForward and each.ReferenceTypeId == COMPONENT and each.NodeId == method
        for owner in owners
        for each in space[owner].references
    )


def declared(space: AddressSpace, method: ua.NodeId) -> list[Any]:
    """Return the arguments that a method takes."""
    for each in space[method].references:
        if each.IsForward and each.ReferenceTypeId == PROPERTY and each.BrowseName.Name == "InputArguments":
            value = space.read_attribute_value(each.NodeId, ua.AttributeIds.Value).Value
            return list(value.Value or []) if value is not None else []
    return []


def check(space: AddressSpace, method: ua.NodeId, given: list[ua.Variant], optional: frozenset[str]) -> Any | None:
    """Return the result of a call with wrong arguments, or None if the arguments match their declarations. Optional
    arguments may be null. The last ones may also be left out."""
    wanted = declared(space, method)
    if len(given) > len(wanted):
        return ua.CallMethodResult(ua.StatusCode(_C.BadTooManyArguments))
    if any(each.Name not in optional for each in wanted[len(given) :]):
        return ua.CallMethodResult(ua.StatusCode(_C.BadArgumentsMissing))
    codes = [
        0 if _fits(space, argument, variant, argument.Name in optional) else _C.BadTypeMismatch
        for argument, variant in zip(wanted, given, strict=False)
    ]
    return wrong(codes) if any(codes) else None


def wrong(codes: list[int]) -> ua.CallMethodResult:
    """Return the result of a call with wrong arguments, with a status code for each argument."""
    return ua.CallMethodResult(
        ua.StatusCode(_C.BadInvalidArgument), InputArgumentResults=[ua.StatusCode(each) for each in codes]
    )


def _fits(space: AddressSpace, argument: Any, variant: ua.Variant, is_optional: bool) -> bool:
    if variant.Value is None and not variant.is_array:
        return is_optional or variant.VariantType == encoding(space, argument.DataType)  # a null text
    if argument.ValueRank == ua.ValueRank.Scalar and variant.is_array:
        return False
    if argument.ValueRank > 0 and not variant.is_array:
        return False
    return fits(space, argument.DataType, variant)


# Methods of the server -------------------------------------------------------------------------------------


def _refresh(session: Any, given: list[Any]) -> list[Any]:
    session.monitoring.refresh(session.monitoring.of(session, given[0].Value))
    return []


def _refresh_one(session: Any, given: list[Any]) -> list[Any]:
    session.monitoring.refresh(session.monitoring.of(session, given[0].Value), given[1].Value)
    return []


def _items(session: Any, given: list[Any]) -> list[Any]:
    """Return the server's handles and the client's handles of the items of a subscription."""
    items = session.monitoring.of(session, given[0].Value).items
    numbers = [list(items), [each.handle for each in items.values()]]
    return [ua.Variant(each, ua.VariantType.UInt32, is_array=True) for each in numbers]


def _resend(session: Any, given: list[Any]) -> list[Any]:
    for item in session.monitoring.of(session, given[0].Value).items.values():
        item.resend()
    return []


STANDARD: Mapping[Any, Callable[[Any, list[Any]], list[Any]]] = {
    ua.NodeId(_O.ConditionType_ConditionRefresh): _refresh,
    ua.NodeId(_O.ConditionType_ConditionRefresh2): _refresh_one,
    ua.NodeId(_O.Server_GetMonitoredItems): _items,
    ua.NodeId(_O.ServerType_GetMonitoredItems): _items,
    ua.NodeId(_O.Server_ResendData): _resend,
    ua.NodeId(_O.ServerType_ResendData): _resend,
}
"""The methods of the standard that this server has. The first argument of each is a subscription of the session."""


def call_standard(session: Any, request: ua.CallMethodRequest) -> ua.CallMethodResult:
    """Call a method of the server. The caller has checked that the object has this method."""
    do = STANDARD.get(request.MethodId)
    if do is None:
        return ua.CallMethodResult(ua.StatusCode(_C.BadNotExecutable))
    given = list(request.InputArguments or [])
    space = session.iserver.aspace
    if (result := check(space, request.MethodId, given, frozenset())) is not None:
        return result
    try:
        return ua.CallMethodResult(OutputArguments=do(session, given))
    except ServiceError as error:
        return ua.CallMethodResult(ua.StatusCode(error.code))
