"""The conditions of the alarms of a machine, evaluated once per period. Conditions that are data are evaluated in
arrays, the user's functions are called in turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from umo.errors import forget_frames
from umo.objects.atomic import Atomic
from umo.objects.quality import Quality
from umo.objects.scaling import ByteArray, FloatArray
from umo.operation.alarms.collecting import BadQuality, DeclaredAlarm, FunctionCondition, InFault, Threshold
from umo.user_code import briefly, is_interrupt, told

FREE_PER_PERIOD = 20
"""Largest number of the user's functions that are called in a period."""
MAX_RESULT_TEXT = 100
"""The largest length of a wrong result in a message, in characters."""
FALSE, TRUE, BAD = 0, 1, 2
"""The results of a condition. BAD: the condition cannot be evaluated."""
FAULT_STATE = 1
"""Number of the state of equipment in fault (`umo.cycle.equipment`)."""


class AlarmColumns(Protocol):
    """The columns of the process image that alarms read and write."""

    values: FloatArray
    quality: ByteArray
    equipment: ByteArray
    alarms: ByteArray


class AlarmImage(Protocol):
    """The part of the process image that alarms need."""

    @property
    def columns(self) -> AlarmColumns: ...
    @property
    def items(self) -> Sequence[Atomic]: ...


class Conditions:
    """The results of all conditions, by alarm: `results`. Alarms are in the order of `KINDS`."""

    def __init__(self, declared: Sequence[DeclaredAlarm], image: AlarmImage) -> None:
        columns = image.columns
        self._values, self._quality, self._equipment = columns.values, columns.quality, columns.equipment
        slot_of = {id(item): slot for slot, item in enumerate(image.items)}
        tests = [each.test for each in declared]
        limits = [test for test in tests if isinstance(test, Threshold)]
        bad = [test for test in tests if isinstance(test, BadQuality)]
        faults = [test for test in tests if isinstance(test, InFault)]
        self.results = np.zeros(len(tests), np.uint8)
        """The result of each condition: FALSE, TRUE or BAD."""
        self._shown = self.results.data
        """The results as a memoryview, whose items are read more quickly than those of an array."""
        ends = np.cumsum([len(limits), len(bad), len(faults)]).tolist()
        self._limited = self.results[: ends[0]].view(bool)
        self._marked = self.results[ends[0] : ends[1]].view(bool)
        self._failed = self.results[ends[1] : ends[2]].view(bool)
        self._has_data = ends[2] > 0
        free = [test.call for test in tests if isinstance(test, FunctionCondition)]
        self._free = list(enumerate(free, ends[2]))
        """The user's functions, each with the number of its alarm."""
        self._slots = np.array([slot_of[id(test.item)] for test in limits], np.intp)
        self._signs = np.array([test.sign for test in limits], float)
        self._bounds = np.array([[test.limit, test.back] for test in limits], float).reshape(len(limits), 2)
        self._now = self._bounds[:, 0].copy()
        """The present bound of each threshold: its limit while it is not exceeded, otherwise the value at which it
        ends."""
        self._read, self._before = np.empty(len(limits)), np.zeros(len(limits), bool)
        self._unknown: Any = None
        """The thresholds whose value cannot be trusted; None if there are none."""
        self._bad_slots = np.array([slot_of[id(test.item)] for test in bad], np.intp)
        self._states = b""
        """The qualities and the states of equipment at the last evaluation."""
        self._numbers = np.array([test.number for test in faults], np.intp)
        self._turn = 0
        self.causes: dict[int, str] = {}
        """The reason why a condition cannot be evaluated, by alarm."""

    @property
    def turns(self) -> int:
        """The number of periods within which each of the user's functions is called once."""
        return turns_of(len(self._free))

    def hold(self, alarm: int, result: int) -> None:
        """Set the result of a condition, TRUE or BAD, before the first evaluation, so that a threshold ends with its
        deadband."""
        if alarm < len(self._limited):
            self._before[alarm], self._now[alarm] = True, self._bounds[alarm, 1]
        else:
            self.results[alarm] = result

    def evaluate(self) -> None:
        """Bring `results` up to date. This function raises no error."""
        if self._has_data and (states := self._quality.tobytes() + self._equipment.tobytes()) != self._states:
            self._states = states
            self._look_at_states()
        if len(self._limited):
            self._compare()
        if self._free:
            self._ask()

    def _look_at_states(self) -> None:
        """A quality, or the state of equipment, is another one."""
        quality = self._quality[self._slots]
        unknown = (quality == Quality.BAD) | (quality == Quality.UNREFERENCED)
        self._unknown = unknown if unknown.any() else None
        np.equal(self._quality[self._bad_slots], Quality.BAD, out=self._marked)
        np.equal(self._equipment[self._numbers], FAULT_STATE, out=self._failed)

    def _compare(self) -> None:
        """Evaluate all thresholds. The state of a condition whose value cannot be trusted does not change."""
        self._values.take(self._slots, out=self._read, mode="clip")
        np.multiply(self._read, self._signs, out=self._read)
        np.greater(self._read, self._now, out=self._limited)
        if self._unknown is not None:
            np.copyto(self._limited, self._before, where=self._unknown)
        if self._limited.tobytes() != self._before.tobytes():
            self._before[:] = self._limited
            np.copyto(self._now, np.where(self._before, self._bounds[:, 1], self._bounds[:, 0]))

    def _ask(self) -> None:
        """The functions whose turn it is."""
        results = self._shown
        for alarm, function in self._in_turn():
            try:
                found = function()
                if found is True or found is False:
                    results[alarm] = found
                    continue
                if isinstance(found, np.bool_):
                    results[alarm] = bool(found)
                    continue
                cause = f"it gives {briefly(found, MAX_RESULT_TEXT)}, which is not True or False"
            except BaseException as error:
                if results[alarm] == BAD and alarm in self.causes and not is_interrupt(error):
                    forget_frames(error)  # its text costs more than a condition may
                    continue
                cause = told(error).text
            if results[alarm] != BAD or alarm not in self.causes:
                results[alarm], self.causes[alarm] = BAD, cause

    def _in_turn(self) -> list[tuple[int, Callable[[], object]]]:
        """Return the functions that are called in this period."""
        count = len(self._free)
        if count <= FREE_PER_PERIOD:
            return self._free
        first, end = self._turn, self._turn + FREE_PER_PERIOD
        self._turn = end % count
        return self._free[first:end] + self._free[: max(end - count, 0)]


def turns_of(count: int) -> int:
    """Return the number of periods in which each of this number of functions is called once."""
    return max(1, -(-count // FREE_PER_PERIOD))
