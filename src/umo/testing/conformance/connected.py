"""A machine made of the channels of a subject, for rules of connected machines."""

from __future__ import annotations

from typing import Any

from umo.objects import Compound, DigitalActuator, DigitalSensor
from umo.testing.conformance.trial import Trial

MAX_LEVEL = 1 << 40
"""Raw level of an object at most, up and down."""


class Machine(Compound):
    """What the kit makes of a subject."""

    outputs: list[DigitalActuator]
    inputs: list[DigitalSensor]


def machine_of(trial: Trial) -> tuple[Machine, dict[str, Any]]:
    """A machine with an object of each channel and its wiring, without outputs of one level or of very wide ranges."""
    outputs = [
        each
        for each in trial.subject.outputs
        if each.least < each.greatest and max(abs(each.least), abs(each.greatest)) <= MAX_LEVEL
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
    low, high = max(channel.lowest, -MAX_LEVEL), min(channel.highest, MAX_LEVEL)
    return DigitalSensor("count", minimum=low, maximum=high, resolution=1)
