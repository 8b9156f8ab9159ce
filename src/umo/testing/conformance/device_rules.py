"""Rules of the device: it vanishes and returns, has two clients; its errors name the objects of a machine."""

from __future__ import annotations

from typing import Any

from umo.cycle import connect
from umo.errors import DriverError
from umo.objects import Compound, DigitalActuator, DigitalSensor
from umo.system.custody import Custody
from umo.testing.conformance.probe import Probe
from umo.testing.conformance.rules import NotTried, RuleBroken, rule
from umo.testing.conformance.timing_rules import in_time
from umo.testing.conformance.trial import Trial
from umo.text import reported

WIDEST = 1 << 40
"""Raw levels of the machine that the kit makes."""


@rule("vanish", "While the device is away each call fails in time; when it is back the next call works.")
def vanish(trial: Trial) -> str | None:
    loss = trial.loss
    with trial.opened() as probe:
        trial.hurry(probe)
        with loss():
            for call, arguments in trial.transfers(probe, default=False):
                if in_time(trial, probe, call, *arguments) is None:
                    raise RuleBroken(f"{trial.watch.doing} succeeded while the device was away")
            _not_opened(trial)
        probe.driver.timeout = trial.patience
        for call, arguments in trial.transfers(probe, default=False):
            if (error := trial.failure(call, *arguments)) is not None:
                raise RuleBroken(f"the device is back, but {trial.watch.doing} failed: {reported(error)}")
        _right(trial, probe, "the device was away")
        with loss():
            pass  # nobody has noticed
        for call, arguments in trial.transfers(probe):
            if trial.failure(call, *arguments) is not None and (error := trial.failure(call, *arguments)) is not None:
                raise RuleBroken(f"the device was away and is back, but {trial.watch.doing} fails: {reported(error)}")
    return trial.looked()


def _not_opened(trial: Trial) -> None:
    """Another driver cannot be opened, or not be used, and can be closed."""
    probe = trial.new()
    trial.hurry(probe)
    error = in_time(trial, probe, probe.open)
    if error is None:
        call, arguments = trial.transfers(probe)[0]
        if trial.failure(call, *arguments) is None:
            raise RuleBroken(f"{trial.watch.doing} of a new driver succeeded while the device was away")
    probe.close()


def _right(trial: Trial, probe: Probe, after: str) -> None:
    """The outputs obey, as far as they can be seen."""
    for number, output in enumerate(trial.visible):
        probe.write(output.channel, output.other(number))
        trial.expect(probe, output, output.other(number), f"write({output.other(number)}), since {after},")


@rule("two clients", "A second driver of the device is refused by an OSError, or works; the first goes on working.")
def two_clients(trial: Trial) -> str | None:
    with trial.opened() as first:
        second = trial.new()
        try:
            refusal = trial.failure(_join, trial, second)
            if refusal is None:
                _right(trial, second, "it is the second client")
                _right(trial, first, "there is a second client")
        finally:
            error = trial.failure(trial.leave, second)
        if error is not None and refusal is None:
            raise RuleBroken(f"the second client could not leave: {reported(error)}")
        for call, arguments in trial.transfers(first):
            if (error := trial.failure(call, *arguments)) is not None:
                raise RuleBroken(f"since a second client came and left, {trial.watch.doing} failed: {reported(error)}")
        _right(trial, first, "a second client came and left")
    remark = trial.looked()
    return remark if refusal is None else f"the second is refused: {reported(refusal)}"


def _join(trial: Trial, second: Probe) -> None:
    second.open()
    for text in trial.channels:
        second.initialize(text, trial.default(text))
    for call, arguments in trial.transfers(second):
        call(*arguments)


class Machine(Compound):
    """What the kit makes of a subject."""

    outputs: list[DigitalActuator]
    inputs: list[DigitalSensor]


@rule("errors are named", "A failure in a connected machine names the objects, their channels and the driver.")
def errors_named(trial: Trial) -> None:
    loss = trial.subject.line.silent if trial.subject.line is not None else trial.loss
    machine, wiring = _machine(trial)
    connection = connect(machine, wiring)
    connection.custody = Custody((), "conformance")
    connection.pause = lambda seconds: None
    texts = {path: entry["channel"] for path, entry in wiring["wire"].items()}
    failed: DriverError | None = None
    with connection as m:
        connection.driver("subject").timeout = trial.subject.timeout
        with loss():
            for step in (m.sample, m.update):
                try:
                    step()
                except DriverError as error:
                    failed = error
                    _check_names(error, texts)
        connection.driver("subject").timeout = trial.patience
    if failed is None:
        raise NotTried("no transfer of a connected machine has failed without an answer")


def _check_names(error: DriverError, texts: dict[str, str]) -> None:
    if not error.failures:
        raise RuleBroken(f"the error names no object: {error}")
    for failure in error.failures:
        if texts.get(failure.path) != failure.channel:
            raise RuleBroken(f"the error names {failure.path} (channel {failure.channel}), which was not transferred")


def _machine(trial: Trial) -> tuple[Machine, dict[str, Any]]:
    outputs = [
        each
        for each in trial.subject.outputs
        if each.least < each.greatest and max(abs(each.least), abs(each.greatest)) <= WIDEST
    ]
    inputs = [text for text in trial.readable if text not in {each.channel for each in outputs}]
    machine = Machine(
        outputs=[
            DigitalActuator("count", default=o.default, minimum=o.least, maximum=o.greatest, resolution=1)
            for o in outputs
        ],
        inputs=[_sensor(trial, text) for text in inputs],
    )
    wire = {f"outputs.{i}": {"driver": "subject", "channel": each.channel} for i, each in enumerate(outputs)}
    wire |= {f"inputs.{i}": {"driver": "subject", "channel": text} for i, text in enumerate(inputs)}
    drivers = {"subject": {"type": trial.new().driver, "timeout": trial.patience}}
    return machine, {"drivers": drivers, "wire": wire}


def _sensor(trial: Trial, text: str) -> DigitalSensor:
    channel = trial.new().channel(text)
    low, high = max(channel.lowest, -WIDEST), min(channel.highest, WIDEST)
    return DigitalSensor("count", minimum=low, maximum=high, resolution=1)
