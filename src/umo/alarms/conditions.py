"""The conditions of the alarms of a machine, evaluated once a period: data as arrays, the user's functions in turn."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Protocol

import numpy as np

from umo.alarms.collecting import BadQuality, DeclaredAlarm, Free, InFault, Threshold
from umo.errors import forget_frames
from umo.objects.atomic import Atomic
from umo.objects.quality import Quality
from umo.objects.scaling import ByteArray, FloatArray
from umo.user_code import briefly, is_interrupt, told

FREE_PER_PERIOD = 20
"""Number of the user's functions that are called in a period at most."""
MAX_RESULT_TEXT = 100
"""Length of a wrong result in its message at most, characters."""
FALSE, TRUE, BAD = 0, 1, 2
"""The results of a condition; BAD: it cannot be evaluated."""
IN_FAULT = 1
"""Number of the state of equipment in fault (`umo.cycle.equipment`)."""


class AlarmColumns(Protocol):
    """The numbers of the process image, as far as alarms read and write them."""

    values: FloatArray
    quality: ByteArray
    equipment: ByteArray
    alarms: ByteArray


class AlarmImage(Protocol):
    """The process image, as far as alarms need it."""

    @property
    def columns(self) -> AlarmColumns: ...
    @property
    def items(self) -> Sequence[Atomic]: ...


class Conditions:
    """The results of all conditions, by alarm: `results`. Alarms stand in the order of `KINDS`."""

    def __init__(self, declared: Sequence[DeclaredAlarm], image: AlarmImage) -> None:
        columns = image.columns
        self._values, self._quality, self._equipment = columns.values, columns.quality, columns.equipment
        slot_of = {id(item): slot for slot, item in enumerate(image.items)}
        tests = [each.test for each in declared]
        limits = [test for test in tests if isinstance(test, Threshold)]
        bad = [test for test in tests if isinstance(test, BadQuality)]
        faults = [test for test in tests if isinstance(test, InFault)]
        self._free = [test.call for test in tests if isinstance(test, Free)]
        self.results = np.zeros(len(tests), np.uint8)
        """FALSE, TRUE or BAD."""
        ends = np.cumsum([len(limits), len(bad), len(faults)]).tolist()
        self._limited = self.results[: ends[0]].view(bool)
        self._marked = self.results[ends[0] : ends[1]].view(bool)
        self._failed = self.results[ends[1] : ends[2]].view(bool)
        self._first_free = ends[2]
        self._slots = np.array([slot_of[id(test.item)] for test in limits], np.intp)
        self._signs = np.array([test.sign for test in limits], float)
        self._bounds = np.array([[test.limit, test.back] for test in limits], float).reshape(len(limits), 2)
        self._now = self._bounds[:, 0].copy()
        """The bound of each threshold as of now: its limit while it is not exceeded, else where it ends."""
        self._read, self._before = np.empty(len(limits)), np.zeros(len(limits), bool)
        self._qualities = np.empty(len(limits), np.uint8)
        self._bad_slots = np.array([slot_of[id(test.item)] for test in bad], np.intp)
        self._bad_qualities = np.empty(len(bad), np.uint8)
        self._numbers = np.array([test.number for test in faults], np.intp)
        self._turn = 0
        self.causes: dict[int, str] = {}
        """Why a condition cannot be evaluated, by alarm."""

    @property
    def turns(self) -> int:
        """Number of periods after which each of the user's functions was called."""
        return turns_of(len(self._free))

    def hold(self, alarm: int, result: int) -> None:
        """Its condition had this result, TRUE or BAD, before the first evaluation. A threshold ends by its deadband."""
        if alarm < len(self._limited):
            self._before[alarm], self._now[alarm] = True, self._bounds[alarm, 1]
        else:
            self.results[alarm] = result

    def evaluate(self) -> None:
        """Bring `results` up to date. It raises nothing."""
        if len(self._limited):
            self._compare()
        if len(self._marked):
            self._quality.take(self._bad_slots, out=self._bad_qualities, mode="clip")
            np.equal(self._bad_qualities, Quality.BAD, out=self._marked)
        if len(self._failed):
            np.equal(self._equipment[self._numbers], IN_FAULT, out=self._failed)
        if self._free:
            self._ask()

    def _compare(self) -> None:
        """All thresholds. What has no value that can be trusted stays as it is."""
        self._values.take(self._slots, out=self._read, mode="clip")
        np.multiply(self._read, self._signs, out=self._read)
        np.greater(self._read, self._now, out=self._limited)
        self._quality.take(self._slots, out=self._qualities, mode="clip")
        if self._qualities.any():
            unknown = (self._qualities == Quality.BAD) | (self._qualities == Quality.UNREFERENCED)
            np.copyto(self._limited, self._before, where=unknown)
        if self._limited.tobytes() != self._before.tobytes():
            self._before[:] = self._limited
            np.copyto(self._now, np.where(self._before, self._bounds[:, 1], self._bounds[:, 0]))

    def _ask(self) -> None:
        """The functions whose turn it is."""
        count = len(self._free)
        for _ in range(min(count, FREE_PER_PERIOD)):
            number = self._turn
            self._turn = (number + 1) % count
            alarm = self._first_free + number
            try:
                found = self._free[number]()
                if found is True or found is False:
                    self.results[alarm] = found
                    continue
                if isinstance(found, np.bool_):
                    self.results[alarm] = bool(found)
                    continue
                cause = f"it gives {briefly(found, MAX_RESULT_TEXT)}, which is not True or False"
            except BaseException as error:
                if self.results[alarm] == BAD and alarm in self.causes and not is_interrupt(error):
                    forget_frames(error)  # its text costs more than a condition may
                    continue
                cause = told(error).text
            if self.results[alarm] != BAD or alarm not in self.causes:
                self.results[alarm], self.causes[alarm] = BAD, cause


def turns_of(count: int) -> int:
    """Number of periods in which each of so many functions is called once."""
    return max(1, -(-count // FREE_PER_PERIOD))


NEVER = inf
"""Time in s of what is not due."""
