"""Browsing the address space (OPC 10000-4, 5.9)."""

from __future__ import annotations

import secrets
from collections import OrderedDict
from dataclasses import replace
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace

from umo.clients.faces.opcua.ua_attributes import missing
from umo.clients.faces.opcua.ua_limits import MAX_CONTINUATIONS, MAX_READ
from umo.clients.faces.opcua.ua_types import below

_C = ua.StatusCodes
FORWARD, INVERSE, BOTH = range(3)
"""Values of BrowseDirection."""
RESULTS = (
    (1, "ReferenceTypeId", ua.NodeId()),
    (2, "IsForward", False),
    (4, "NodeClass", ua.NodeClass.Unspecified),
    (8, "BrowseName", ua.QualifiedName()),
    (16, "DisplayName", ua.LocalizedText()),
    (32, "TypeDefinition", ua.NodeId()),
)
"""Bits of a result mask. Each row contains the bit, the field of a reference, and the value that replaces the field if
it is not requested."""
REFERENCES = ua.NodeId(ua.ObjectIds.References)
NO_PATH_LEFT = (1 << 32) - 1
"""RemainingPathIndex of a target in this server."""
MAX_PATH = 100
"""Largest number of elements of a browse path, and largest number of its targets."""


class Browsing:
    """Browses for one session, and keeps the session's continuation points."""

    def __init__(self, space: AddressSpace) -> None:
        self._space = space
        self._rest: OrderedDict[bytes, tuple[list[Any], int]] = OrderedDict()
        """The remaining results, and the largest number that is returned at once, by continuation point."""

    def browse(self, asked: Any, most: int) -> ua.BrowseResult:
        """Return the references of one node, at most the given number. 0 means as many as the server returns."""
        code = self._refusal(asked)
        if code is not None:
            return ua.BrowseResult(StatusCode=code)
        kinds: dict[Any, bool] = {}
        references = self._space[asked.NodeId].references
        found = [self._shown(each, asked.ResultMask) for each in references if self._is_asked(each, asked, kinds)]
        return self._portion(found, min(most or MAX_READ, MAX_READ))

    def _refusal(self, asked: Any) -> ua.StatusCode | None:
        if asked.NodeId not in self._space:
            return missing(asked.NodeId)
        if asked.BrowseDirection not in (FORWARD, INVERSE, BOTH):
            return ua.StatusCode(_C.BadBrowseDirectionInvalid)
        kind = asked.ReferenceTypeId
        if not kind.is_null() and not below(self._space, kind, REFERENCES):
            return ua.StatusCode(_C.BadReferenceTypeIdInvalid)
        return None

    def _is_asked(self, reference: Any, asked: Any, kinds: dict[Any, bool]) -> bool:
        if asked.BrowseDirection != BOTH and reference.IsForward != (asked.BrowseDirection == FORWARD):
            return False
        if asked.NodeClassMask and not asked.NodeClassMask & reference.NodeClass:
            return False
        return self._is_kind(reference.ReferenceTypeId, asked.ReferenceTypeId, asked.IncludeSubtypes, kinds)

    def _is_kind(self, kind: ua.NodeId, wanted: ua.NodeId, subtypes: bool, kinds: dict[Any, bool]) -> bool:
        """True if a reference has the type `wanted` or, with `subtypes`, one of its subtypes. `kinds` caches the
        answers for types."""
        if wanted.is_null() or kind == wanted:
            return True
        if not subtypes:
            return False
        if kind not in kinds:
            kinds[kind] = below(self._space, kind, wanted)
        return kinds[kind]

    def _shown(self, reference: Any, mask: int) -> Any:
        hidden = {name: nothing for bit, name, nothing in RESULTS if not mask & bit}
        return replace(reference, **hidden) if hidden else reference

    def _portion(self, found: list[Any], most: int) -> ua.BrowseResult:
        if len(found) <= most:
            return ua.BrowseResult(References=found)
        if len(self._rest) >= MAX_CONTINUATIONS:
            return ua.BrowseResult(StatusCode=ua.StatusCode(_C.BadNoContinuationPoints))
        point = secrets.token_bytes(16)
        self._rest[point] = found[most:], most
        return ua.BrowseResult(ContinuationPoint=point, References=found[:most])

    def browse_next(self, point: bytes, release: bool) -> ua.BrowseResult:
        """Return the next results of a Browse."""
        rest = self._rest.pop(point or b"", None)
        if rest is None:
            return ua.BrowseResult(StatusCode=ua.StatusCode(_C.BadContinuationPointInvalid))
        return ua.BrowseResult() if release else self._portion(*rest)

    # Paths -------------------------------------------------------------------------------------------------

    def translate(self, path: Any) -> ua.BrowsePathResult:
        """Return the nodes at the end of a browse path."""
        elements = list(path.RelativePath.Elements or [])
        if path.StartingNode not in self._space:
            return ua.BrowsePathResult(missing(path.StartingNode))
        if not elements:
            return ua.BrowsePathResult(ua.StatusCode(_C.BadNothingToDo))
        if len(elements) > MAX_PATH:
            return ua.BrowsePathResult(ua.StatusCode(_C.BadQueryTooComplex))
        if not all(each.TargetName is not None and each.TargetName.Name for each in elements):
            return ua.BrowsePathResult(ua.StatusCode(_C.BadBrowseNameInvalid))
        nodes: dict[Any, None] = {path.StartingNode: None}
        for element in elements:
            kind = element.ReferenceTypeId
            if not kind.is_null() and not below(self._space, kind, REFERENCES):
                return ua.BrowsePathResult(ua.StatusCode(_C.BadReferenceTypeIdInvalid))
            nodes = {each: None for node in nodes for each in self._targets(node, element)}
        if len(nodes) > MAX_PATH:
            return ua.BrowsePathResult(ua.StatusCode(_C.BadTooManyMatches))
        targets = [ua.BrowsePathTarget(each, NO_PATH_LEFT) for each in nodes]
        return ua.BrowsePathResult(ua.StatusCode(0 if targets else _C.BadNoMatch), targets)

    def _targets(self, node: Any, element: Any) -> list[Any]:
        data = self._space.get(node)
        kinds: dict[Any, bool] = {}
        return [
            each.NodeId
            for each in (data.references if data is not None else ())
            if each.BrowseName == element.TargetName
            and each.IsForward != element.IsInverse
            and self._is_kind(each.ReferenceTypeId, element.ReferenceTypeId, element.IncludeSubtypes, kinds)
        ]
