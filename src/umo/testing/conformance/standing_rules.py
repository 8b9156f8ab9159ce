"""Rules of every call: what it returns and raises. They come last, as they judge the calls of the others too, and are
tried at any rate."""

from __future__ import annotations

from contextlib import suppress

from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import NOTHING, NotTried, RuleBroken, rule
from umo.testing.conformance.trial import Trial
from umo.text import some


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


@rule("end", "At the end every output is at its default. Closing a driver moves none.", NOTHING)
def end(trial: Trial) -> str | None:
    """A new driver looks at the outputs."""
    if not trial.subject.outputs:
        raise NotTried("the driver has no outputs")
    trial.restore(always=True)
    if trial.unreached:
        raise RuleBroken(f"{some(trial.unreached)} could not be brought to the default")
    with trial.leaving(trial.new()) as probe:
        probe.open()
        for output in trial.visible:  # reset again: a model that is opened anew knows nothing of the reset before
            probe.reset(output.channel, output.default)
            trial.expect(probe, output, output.default, f"reset({output.default}) at the end")
    _check_closed(trial, probe)
    return trial.looked()


def _check_closed(trial: Trial, closed: Probe) -> None:
    """A device may let go of its outputs by itself when a connection ends: it does so without a `close` too."""
    line, outputs = trial.subject.line, trial.visible
    if line is None or trial.subject.levels is None:
        return
    for output in outputs:
        if not trial.is_at(closed, output, output.default):
            text = f"{output.channel} is at {trial.last_level} since the driver was closed, not at {output.default}"
            with trial.opened() as probe:
                line.drop()
                if trial.is_at(probe, output, output.default):
                    raise RuleBroken(text)
