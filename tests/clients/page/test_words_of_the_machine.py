"""The words by which the scripts of the page know events and reasons are words that the machine writes."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import umo
from helpers.machines import bench
from umo.cycle.inhibition import latched
from umo.objects.interlock import Interlock
from umo.operation.alarms.alarm_states import AlarmState

SOURCE = Path(umo.__file__).parent
STATIC = SOURCE / "clients" / "page" / "static"
PATTERNS = {
    name: text
    for script in ("app.js", "marks.js")
    for name, text in re.findall(r"^const (\w+) = /\^?(.*)/;", (STATIC / script).read_text("utf-8"), re.MULTILINE)
}


def strings(words: list[str], *rooms: str) -> list[str]:
    """The strings in the code of these rooms, also those that are parts of an f-string: of the files that have one of
    the words."""
    codes = [file.read_text("utf-8") for room in rooms for file in (SOURCE / room).rglob("*.py")]
    found = (node for code in codes if any(word in code for word in words) for node in ast.walk(ast.parse(code)))
    return [node.value for node in found if isinstance(node, ast.Constant) and isinstance(node.value, str)]


def test_each_word_that_a_script_looks_for_is_in_a_string_of_the_machine() -> None:
    found = [word.strip(" ^()") for name in ("ENDS", "GUARDED", "LATCHED") for word in PATTERNS[name].split("|")]
    assert len(found) == 9
    words = [word.removesuffix(" inhibited") for word in found]  # another part of the text
    written = strings(words, "cycle", "objects", "operation")
    for word in words:
        assert any(word in text for text in written), word


def test_the_page_knows_a_latched_interlock_by_its_reason() -> None:
    assert re.search(PATTERNS["LATCHED"], latched(Interlock(lambda: False, [bench().valve], "the tank is full")))


def test_the_page_knows_an_alarm_that_comes_by_its_state() -> None:
    come = {state for state in AlarmState if re.match(PATTERNS["COMES"], f"{state} is active")}
    assert come == {AlarmState.UNACKNOWLEDGED, AlarmState.BAD_UNACKNOWLEDGED, AlarmState.SHELVED_ACTIVE}
