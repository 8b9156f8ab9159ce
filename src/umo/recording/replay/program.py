"""The program of a replay: the station of a recording, or a machine and its loop given by a program."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from umo.cycle.run import drive
from umo.errors import OptionError, UmoError, WiringError, text_of
from umo.objects import Compound
from umo.objects.numbers import numbers_of
from umo.process.job import Plan
from umo.recording.replay.code_given import NOTHING_GIVEN, CodeGiven, job_of, other_code
from umo.recording.replay.tape import NotReplayable, Tape
from umo.text import did_you_mean
from umo.wiring import Wired
from umo.wiring.wired import Parameter


@dataclass
class Program:
    """A machine with its wiring, and the loop that drives it."""

    machine: Compound
    wired: Wired
    drive: Callable[[Any], Any]
    """The loop, which is called with the connected machine, and returns when the work is done."""
    name: str = ""
    manual: bool = False
    """True if the run began in manual mode."""

    code: str = ""
    """A remark if the code differs from that of the recorded run, or "" if it is the same."""

    @classmethod
    def of(cls, tape: Tape, given: CodeGiven = NOTHING_GIVEN) -> Program:
        """Return the program that runs the recorded run with the code `given`. Raises NotReplayable if there is no such
        program."""
        try:
            job = job_of(tape.job, given)
            plan = Plan(job)
        except NotReplayable:
            raise
        except UmoError as error:
            why = str(error.mistakes[0]) if isinstance(error, WiringError) and error.mistakes else text_of(error)
            raise NotReplayable(f"the machine of the recording cannot be created: {why}") from error
        loop = partial(drive, application=plan.application)
        return cls(plan.machine, plan.wired, loop, plan.name, job.manual, other_code(tape.job, plan.place))

    def set(self, settings: Mapping[str, object]) -> None:
        """Give numbers other values than in the recording. Raises OptionError for an unknown number, or an invalid
        value."""
        known = {path: each for path, each in numbers_of(self.machine).items() if each.settable}
        parameters = [each for each in self.wired.parameters if each.number.path not in settings]
        for path, value in settings.items():
            if path not in known:
                raise OptionError(f"--set {path}: there is no such number{did_you_mean(path, known)}")
            number = known[path]
            try:
                parameters.append(
                    Parameter(number, number.checked(value) if number.is_field else number.of_its_type(value))
                )
            except UmoError as error:
                raise OptionError(f"--set {error}") from None
        self.wired = dataclasses.replace(self.wired, parameters=parameters)
