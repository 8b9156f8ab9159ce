"""The end of a run whose starter is gone, for the terminal: nobody else is left to say it there."""

from __future__ import annotations

from contextlib import suppress

from umo.process.messages import MessageSocket
from umo.process.outcome import Outcome
from umo.system.streams import say_without_waiting
from umo.text import printable

STARTER_END_TIMEOUT = 0.3
"""Time in s that a starter which is killed together with another process may take to end: its memory is given back
before its end of the channel is closed."""
MAX_LENGTH = 1000
"""Length of the message at most, characters."""


def tell_final_message(channel: MessageSocket, name: str, outcome: Outcome) -> None:
    """If the process that started the run has ended, say on stderr how the run did. It waits for no terminal, and is
    called when the machine has been reset and everything is recorded; no error of it changes how the run ended."""
    with suppress(Exception):
        if channel.peer_is_gone(STARTER_END_TIMEOUT if outcome.unsafe else 0.0):
            text = f"umo: {name}: the process that started it is gone; {how(outcome)}"
            say_without_waiting(printable(text.replace("\n", "; "))[:MAX_LENGTH])


def how(outcome: Outcome) -> str:
    """How a run ended and what the actuators are at."""
    if outcome.failure is not None:
        return outcome.failure.message
    return "the run has ended, " + ("every actuator is at its default" if outcome.driven else "no actuator was driven")
