"""Identities: the names of a machine in the alphabet of a protocol. They are unique and constant, and all protocols use
the same escape.

A character that a protocol cannot represent, or that has another meaning in the protocol, is written as `_xHHHH_`: its
code point in four or eight hexadecimal digits (ISO/IEC 9075-14). A `_` before characters that look like such a code is
escaped, too. Nothing is left out or replaced, so that two names never have one identity, and an identity depends on no
other name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from hashlib import sha256

Kept = Callable[[str], bool]
"""The function that returns True if a protocol can represent a character."""
NO_NAME = "\0"
"""The escape for a part without a name. It occurs nowhere else."""
DIGEST = 16
"""Number of hexadecimal digits of the digest at the end of a shortened identity: 64 bits."""
_CODE = re.compile(r"_x([0-9A-F]{8}|[0-9A-F]{4})_")
_LOOKS_CUT = re.compile(rf"\.[0-9a-f]{{{DIGEST}}}\Z")
_LOOKS_CODED = re.compile(r"_x[0-9A-F]{4}")


def is_word(character: str) -> bool:
    """True for ASCII letters, digits and `_`."""
    return character.isascii() and (character.isalnum() or character == "_")


def is_encodable(character: str) -> bool:
    """Return True if UTF-8 can encode the character. The name of a folder may have other characters, which stand for
    bytes."""
    return not 0xD800 <= ord(character) < 0xE000


def is_text(character: str) -> bool:
    """Return True if a UTF-8 string of MQTT or OPC UA may have the character. A slash divides strings and is
    excluded."""
    code = ord(character)
    is_control = code < 0x20 or 0x7F <= code < 0xA0
    is_no_character = code & 0xFFFE == 0xFFFE or 0xFDD0 <= code < 0xFDF0
    return character != "/" and not (is_control or is_no_character) and is_encodable(character)


def is_topic(character: str) -> bool:
    """Return True if one level of a topic of MQTT may have the character."""
    return is_text(character) and character not in "+#"


def escaped(text: str, kept: Kept, words: Collection[str] = ()) -> str:
    """Return a string in an alphabet. `words`: strings with another meaning; their first character is escaped."""
    text = text or NO_NAME
    first = text in words
    return "".join(
        coded(each) if not kept(each) or (first and not place) or _LOOKS_CODED.match(text, place) else each
        for place, each in enumerate(text)
    )


def unescaped(text: str) -> str:
    """Return the original of an escaped string."""
    return _CODE.sub(lambda found: chr(int(found[1], 16)), text).replace(NO_NAME, "")


def shortened(identity: str, length: int) -> str:
    """Return an identity with at most this number of characters. The end of a longer identity is replaced by a digest
    of the whole. The same is done to an identity that looks shortened, because it could equal a shortened identity."""
    if len(identity) < length or (len(identity) == length and not _LOOKS_CUT.search(identity)):
        return identity
    return f"{identity[: length - DIGEST - 1]}.{sha256(identity.encode()).hexdigest()[:DIGEST]}"


@dataclass(frozen=True)
class Identities:
    """The identities of one protocol."""

    separator: str
    """The character that replaces the dots of a path. It is outside the alphabet, or is a dot."""
    mark: str
    """The text between kind and path, if the kind precedes the path."""
    kept: Kept
    words: frozenset[str] = frozenset()
    """Paths that have another meaning in the protocol."""

    def of(self, path: str, kind: str = "") -> str:
        """Return the identity of the item with this path. `kind`: as in `tunable:cell.gain`; "" if the path is
        enough."""
        parts = [escaped(path, self.kept, self.words)] if path in self.words else map(self.part, path.split("."))
        inside = self.separator.join(parts) if path else ""
        return f"{kind}{self.mark}{inside}" if kind else inside

    def part(self, name: str) -> str:
        """Return the identity of one part of a path."""
        return escaped(name, self.kept)

    def path(self, identity: str) -> str:
        """Return the path of an identity without a kind."""
        return ".".join(map(unescaped, identity.split(self.separator)))


def coded(character: str) -> str:
    """Return the escape of a character."""
    code = ord(character)
    return f"_x{code:0{4 if code < 0x10000 else 8}X}_"
