"""The tree of a machine: its objects, their paths, and patterns of paths."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from umo.errors import PathError
from umo.objects.atomic import Atomic
from umo.objects.node import Node
from umo.objects.presentation.rows import ANY
from umo.text import did_you_mean


def path_of(node: Node) -> str:
    """Return the path of an object in its machine, without the root: `z.motor`, `axes.0`. The path of the root is
    ''."""
    return node._path


def children(node: Node) -> Mapping[str, Node]:
    """Return the parts of a compound by name; a part in a list or dict is named `axes.0`."""
    return node._children


def walk(node: Node) -> Iterator[Node]:
    """Return every object below this one, in declared order, a compound before its parts."""
    waiting = [iter(node._children.values())]
    while waiting:
        for child in waiting[-1]:
            yield child
            if child._children:
                waiting.append(iter(child._children.values()))
                break
        else:
            waiting.pop()


def is_within(node: Node | None, compound: Node) -> bool:
    """Return True if an object is this compound, or is below it."""
    while node is not None and node is not compound:
        node = node._parent
    return node is not None


def atoms(node: Node) -> Iterator[Atomic]:
    """Return every atomic object below this one, in declared order."""
    return (each for each in walk(node) if isinstance(each, Atomic))


def find(node: Node, path: str) -> Node:
    """Return the object at a path below this one, such as "z.motor". Raises PathError, with the nearest path, if there
    is none."""
    known = _below(node)
    if path not in known:
        raise _no_object(node, path, known)
    return known[path]


def named(node: Node, pattern: str) -> list[Node]:
    """Return the objects below this one that the pattern names, in declared order. The pattern can be a path, the path
    of a list or dict (which names all objects in it), or a pattern such as `zones.*.heater`. Raises PathError if there
    is no such object, except for an empty list or dict."""
    known = _below(node)
    found = [each for path, each in known.items() if matches(pattern, path) or _is_in(pattern, path, each)]
    held = getattr(node, pattern.partition(".")[0], None)
    if not found and (held or not isinstance(held, list | tuple | Mapping)):
        raise _no_object(node, pattern, known)
    return found


def is_pattern(path: str) -> bool:
    return ANY in path.split(".")


def matches(pattern: str, path: str) -> bool:
    """Return True if a path matches the pattern, in which `*` stands for one part of a path."""
    parts, names = pattern.split("."), path.split(".")
    return len(parts) == len(names) and all(part in (ANY, name) for part, name in zip(parts, names, strict=True))


def _below(node: Node) -> dict[str, Node]:
    start = f"{node._path}." if node._path else ""
    return {each._path.removeprefix(start): each for each in walk(node)}


def _is_in(pattern: str, path: str, node: Node) -> bool:
    """Return True if an object is in a list or dict that the pattern names."""
    return "." in node._name and matches(pattern, path.rpartition(".")[0])


def _no_object(node: Node, path: str, known: Mapping[str, Node]) -> PathError:
    return PathError(f"there is no object {path!r} in {node._path or type(node).__name__}{did_you_mean(path, known)}")
