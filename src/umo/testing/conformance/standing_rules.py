"""Rules of every call: what it returns and raises. They come last, as they judge the calls of the others too."""

from __future__ import annotations

from contextlib import suppress

from umo.testing.conformance.rules import Cost, NotTried, RuleBroken, rule
from umo.testing.conformance.trial import Trial
from umo.text import some

NOTHING = Cost(opens=0, each=0)
"""These are tried at any rate."""


@rule("readings", "A reading is an int, within the bits of its channel.", NOTHING)
def readings(trial: Trial) -> None:
    """Also of all readings of the rules before."""
    if not trial.readable:
        raise NotTried("the driver has no inputs")
    with suppress(OSError), trial.opened() as probe:
        for text in trial.readable:
            probe.read(text)
        probe.read_many(trial.readable)
    if trial.watch.wrong_types:
        raise RuleBroken(trial.watch.wrong_types[0])


@rule("kind of errors", "A call that fails raises an OSError, whatever failed.", NOTHING)
def kind_of_errors(trial: Trial) -> None:
    """Also of all calls of the rules before."""
    with suppress(OSError, NotTried), trial.opened() as probe:
        trial.fail_some(probe)
    if trial.watch.wrong_kinds:
        raise RuleBroken(trial.watch.wrong_kinds[0])


@rule("end", "At the end every output is at its default.", NOTHING)
def end(trial: Trial) -> str | None:
    """By a new driver."""
    if not trial.subject.outputs:
        raise NotTried("the driver has no outputs")
    trial.restore(always=True)
    if trial.unreached:
        raise RuleBroken(f"{some(trial.unreached)} could not be brought to the default")
    probe = trial.new()
    try:
        probe.open()
        for output in trial.visible:  # reset again: a model that is opened anew knows nothing of the reset before
            probe.reset(output.channel, output.default)
            trial.expect(probe, output, output.default, f"reset({output.default}) at the end")
    finally:
        with trial.own_error_first():
            trial.leave(probe)
    return trial.looked()
