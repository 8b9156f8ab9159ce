"""Looking for a device that speaks in lines, without waiting for it."""

from __future__ import annotations

from time import monotonic

from umo.drivers.streams import Look, Lost, Stream
from umo.drivers.streams.stream import Dial
from umo.drivers.text.link_settings import LinkSettings
from umo.drivers.text.pattern import shown


class TextLook(Look):
    """Connects, lets the device start and the line fall silent, sends a query and looks for a line of answer."""

    def __init__(self, dial: Dial, dialogue: LinkSettings) -> None:
        super().__init__(dial)
        self._dialogue = dialogue
        self._end = dialogue.answer_terminator.encode(dialogue.encoding)

    def ask(self, query: str, seconds: float, boots: bool) -> None:
        """Begin a look with this query, or with `identify`. `boots`: whether the connection starts the device."""
        dialogue = self._dialogue
        query = query or (dialogue.identify.ask if dialogue.identify else "")
        boot_time = dialogue.boot_time if boots else 0.0
        request = (query + dialogue.terminator).encode(dialogue.encoding) if query else b""
        started = heard = 0.0

        def is_ready(stream: Stream) -> bool:
            nonlocal started, heard
            now = monotonic()
            started, heard = started or now + boot_time, heard or now
            if not stream.idle():
                stream.waiting()
                heard = now
            return now >= max(started, heard + dialogue.quiet)

        def has_answered(data: bytes) -> bool:
            if len(data) > (1 + dialogue.echo) * (dialogue.longest_answer + len(self._end)):
                raise Lost(f"the answer to {shown(query)} is longer than {dialogue.longest_answer} bytes")
            return data.count(self._end) > dialogue.echo

        self.begin(request, has_answered, seconds + boot_time + dialogue.quiet, is_ready)
