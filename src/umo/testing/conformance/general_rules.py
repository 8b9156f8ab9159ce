"""Rules about the results and errors of every call. They are always tried, and come last, because they also judge the
calls of the other rules."""

from __future__ import annotations

from contextlib import suppress

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rule_context import RuleContext
from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.taps import Tap
from umo.text import some


@rule(Cost(each=1, calls=2))
def readings(context: RuleContext) -> None:
    """A reading is an int, within the bits of its channel. `read_many` also stores only ints."""
    # Also of all readings of the rules before
    if not context.readable:
        raise NotTried("the driver has no inputs")
    with suppress(OSError), context.opened() as probe:
        for text in context.readable:
            probe.read(text)
        probe.read_many(context.readable)
    if context.watch.wrong_type:
        beyond = context.watch.beyond
        causes = [f"reading of {beyond}", f"reading of {beyond} in a block"] if beyond else []
        raise RuleBroken(context.watch.wrong_type, *causes)


@rule(Cost(calls=4, connects=2, waits=2))
def kind_of_errors(context: RuleContext) -> str | None:
    """A call that fails raises an OSError, whatever the cause."""
    # Also of all calls of the rules before
    remark = None
    try:
        with suppress(OSError), context.opened() as probe:
            context.fail_some(probe)
    except NotTried as reason:
        remark = str(reason)
    if context.watch.wrong_kind:
        raise RuleBroken(context.watch.wrong_kind)
    return remark


@rule(Cost(opens=2, calls=3))
def end(context: RuleContext) -> str | None:
    """At the end every output is at its default. Closing a driver changes no output."""
    # A new driver looks at the outputs
    if not context.subject.outputs:
        raise NotTried("the driver has no outputs")
    context.restore(always=True)
    if context.unreached:
        raise RuleBroken(f"{some(context.unreached)} could not be brought to the default")
    with context.leaving(context.new()) as probe:
        probe.open()
        for output in context.visible:  # reset again: a model that is opened anew knows nothing of the reset before
            context.bring_to_default(probe, output)
            context.expect(probe, output, output.default, f"reset({output.default}) at the end")
    if context.subject.line is None or context.subject.levels is None:
        return context.looked(
            "it could not be seen whether closing moves an output: this needs a line and a record of levels"
        )
    _check_closed(context, probe, context.subject.line)
    return context.looked()


def _check_closed(context: RuleContext, closed: Probe, line: Tap) -> None:
    """Check that `close` changes no output. A device may release its outputs by itself when a connection ends; then it
    does so without `close`, too."""
    outputs = context.visible
    for output in outputs:
        if not context.is_at(closed, output, output.default):
            text = f"{output.channel} is at {context.last_level} since the driver was closed, not at {output.default}"
            with context.opened() as probe:
                line.drop()
                if context.is_at(probe, output, output.default):
                    raise RuleBroken(text)
