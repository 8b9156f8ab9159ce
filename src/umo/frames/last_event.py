"""The last event of a run: why it ends, for whoever watches it."""

from __future__ import annotations

from types import WrapperDescriptorType
from typing import Any

from umo.cycle import connect
from umo.cycle.events import CommandState, Event
from umo.cycle.machine import ConnectedMachine
from umo.cycle.stopping import signal_name
from umo.errors import text_of
from umo.frames.reader import Reader
from umo.text import in_brackets, place_of
from umo.user_code import attempt

END = "end"
"""`Event.asked` of the last event of a run. Its state is DONE (the application has ended), CANCELLED (the run was
stopped) or FAILED; it has no number of a command."""


PLAIN_TYPES = (str, int, float, bool, type(None))
"""Types of arguments of exceptions whose text is umo's or Python's own work."""


def is_end(event: Event) -> bool:
    return event.asked == END and not event.command


def end_of(reader: Reader) -> Event | None:
    """The last event of a run that has ended; None: it could not tell any more."""
    return next((each.event for each in reversed(reader.events()) if is_end(each.event)), None)


def tell_end(connection: connect[Any], error: BaseException | None) -> None:
    """Add the last event, unless the run has told its end before. `error` is what ended the run, if it failed."""
    machine = connection.machine
    if machine.events and is_end(machine.events[-1]):
        return
    if error is not None:
        text, failed = attempt(_text, error)
        tell(machine, CommandState.FAILED, text if failed is None else type(error).__name__)
    elif connection.stop.requested:
        tell(machine, CommandState.CANCELLED, f"stopped by {_stopper(connection)}")
    else:
        tell(machine, CommandState.DONE, "the application has ended")


def tell(machine: ConnectedMachine, state: CommandState, text: str) -> None:
    machine.events.add(Event(machine.clock.now, "", text, state=state, asked=END))


def _stopper(connection: connect[Any]) -> str:
    """Name of who has asked for the stop: a client, a signal, a time limit, or else the program itself."""
    stops = (event for event in reversed(connection.machine.events) if event.asked == "stop")
    who = next((event.who for event in stops if event.state is CommandState.DONE), "")
    signal = connection.stop.signal
    program = "its time limit" if connection.stop.time_over else "the program"
    return who or (program if signal is None else signal_name(signal))


def _text(error: BaseException) -> str:
    """The text of an exception, as far as that calls no code of the user's: the outcome is not reported yet."""
    written, plain = type(error).__str__, all(type(arg) in PLAIN_TYPES for arg in error.args)
    if not plain or not (isinstance(written, WrapperDescriptorType) or written.__module__.startswith("umo.")):
        return type(error).__name__ + in_brackets(place_of(error))
    return text_of(error)
