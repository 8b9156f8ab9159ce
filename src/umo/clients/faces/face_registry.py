"""Finds a face by its name: an entry point of the group `umo.faces`, or `module:Class`. A face is imported only when it
is named."""

from __future__ import annotations

import importlib

from umo.clients.faces.face import Face
from umo.errors import OptionError, text_of
from umo.system.packages import how_to_install, registered
from umo.text import did_you_mean

GROUP = "umo.faces"


class FaceNotInstalled(OptionError):
    """Raised if the library of a face is not installed. The text says how to install it."""


def known_faces() -> dict[str, str]:
    """Return the registered faces by name, each as `module:Class`. None of them is imported."""
    return {point.name: point.value for point in registered(GROUP)}


def find_face(name: str) -> type[Face]:
    """Return the class of a face. Raises OptionError if no face has this name, and FaceNotInstalled if its library is
    missing."""
    points = known_faces()
    place = name if ":" in name else points.get(name)
    if place is None:
        raise OptionError(
            f"there is no face {name!r}{did_you_mean(name.lower(), points)}; "
            f"known: {', '.join(points)}, or module:Class"
        )
    module, _, attribute = place.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        if ":" in name or (error.name or "").startswith("umo"):
            raise OptionError(f"face {name!r} cannot be imported: {error}") from error
        raise FaceNotInstalled(f"the face {name} needs {error.name}: {how_to_install(name)}") from None
    except (Exception, SystemExit) as error:  # a module may raise anything
        raise OptionError(f"face {name!r} cannot be imported: {text_of(error)}") from error
    if not (isinstance(found, type) and issubclass(found, Face)):
        raise OptionError(f"{name!r} is not a umo face")
    return found
