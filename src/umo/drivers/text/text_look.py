"""The search for a device that speaks in lines, without waiting for it."""

from __future__ import annotations

from time import monotonic

from umo.drivers.streams import Look, Lost, Stream
from umo.drivers.streams.stream import Dial
from umo.drivers.text.channel import Ends
from umo.drivers.text.link_settings import LinkSettings, is_blank
from umo.drivers.text.pattern import shown


class TextLook(Look):
    """A look that connects, waits until the device has started and the line is quiet, sends a query and checks for a
    line with the answer."""

    def __init__(self, dial: Dial, dialogue: LinkSettings) -> None:
        super().__init__(dial)
        self._dialogue = dialogue

    def ask(self, query: str, ends: Ends, seconds: float, boots: bool) -> None:
        """Begin a look with this query, or with `identify`. `boots`: whether the connection starts the device."""
        dialogue = self._dialogue
        if not query and dialogue.identify:
            query, ends = dialogue.identify.ask, dialogue.identify.ends
        boot_time = dialogue.boot_time if boots else 0.0
        request, end = dialogue.encoded(query, ends) if query else b"", dialogue.end(ends)
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
            if len(data) > (1 + dialogue.echo) * (dialogue.longest_answer + len(end)):
                raise Lost(f"the answer to {shown(query)} is longer than {dialogue.longest_answer} bytes")
            lines = data.split(end)[:-1]
            return sum(not (dialogue.skip_empty_lines and is_blank(line)) for line in lines) > dialogue.echo

        self.begin(request, has_answered, seconds + boot_time + dialogue.quiet, is_ready)
