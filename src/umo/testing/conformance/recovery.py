"""After something went wrong on the line: what the channels read, and that the driver works again."""

from __future__ import annotations

from collections.abc import Mapping

from umo.errors import text_of
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import RuleBroken
from umo.testing.conformance.subject import Output

TRIES = 3
"""Calls within which a driver recovers."""


def values(context: RuleContext, probe: Probe) -> dict[str, int | None]:
    """Readings of the channels, None for those that move by themselves. Every output is brought to another level than
    its default; the inputs that read them are waited for."""
    probe.timeout = context.patience
    outputs = context.subject.outputs
    for number, output in enumerate(outputs):
        rewrite(context, probe, output, output.other(number), "what was tried before")
    for number, output in enumerate(outputs):
        if output in context.viewed:
            context.is_read(probe, output, output.other(number))
    return {text: probe.read(text) if text in context.known else None for text in context.readable}


def recovers(
    context: RuleContext, probe: Probe, expected: Mapping[str, int | None], after: str, tries: int = TRIES
) -> None:
    """Each channel reads its value, at the last of the tries at the latest, and no other one before."""
    probe.timeout = context.patience
    for text, raw in expected.items():
        for left in range(tries - 1, -1, -1):
            try:
                found = probe.read(text)
            except OSError as error:
                if not left:
                    raise RuleBroken(f"read of {text} still fails after {after}: {text_of(error)}") from error
                continue
            if raw is not None and not (context.alike(text, raw, found) or context.fallen(text, found)):
                raise RuleBroken(f"{text} read {found} after {after}; it is at {raw}", f"reading of {text}")
            break


def rewrite(context: RuleContext, probe: Probe, output: Output, raw: int, after: str) -> None:
    """The output takes a level, at the third call at the latest."""
    probe.timeout = context.patience
    for left in range(TRIES - 1, -1, -1):
        error = context.failure(probe.write, output.channel, raw)
        if error is None:
            return
        if not left:
            raise RuleBroken(f"{context.watch.doing} still fails after {after}: {text_of(error)}")
