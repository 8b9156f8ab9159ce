"""Functional mock-up units as plants: models that Modelica, Simulink and others export (FMI 2.0 and 3.0)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from umo.drivers._block_driver import BlockDriver, Plans, in_turn
from umo.drivers.contract import Direction, IntArray
from umo.drivers.fmu.variables import TICK, FmuChannel, channel_of, check_start, described, variables_of
from umo.drivers.option_checks import within
from umo.drivers.optional import KnowsScale, PhysicalScale, Reports
from umo.duration import duration
from umo.errors import ChannelsFailed, DriverError

if TYPE_CHECKING:
    from umo.drivers.fmu.instance import FmuInstance

_FEW_FLOATS = 8
"""Floats of a group up to which plain arithmetic takes less time than arrays; the results are the same."""
_MAX_REPORTED = 40


class Fmu(BlockDriver[FmuChannel], KnowsScale, Reports):
    """A model as a plant: a co-simulation unit of FMI 2.0 or 3.0, run by FMPy.

    Channels: `NAME` for a variable that is an integer, a boolean or an enumeration, `NAME:SCALE` for a float: the
    variable is its raw integer times SCALE, in the model's unit (`tank.level:0.001`). An element of an array is named
    by its indices, from 1: `y[2]:0.001`, `A[1,3]:0.1`. Inputs and tunable parameters of
    the model are outputs of the computer; all other variables are inputs. `tick` is the timer: reading it lets one
    period pass in the model and returns 0.

    Options:
        model: the .fmu file; a relative path in a wiring starts from the station's folder.
        start_values: parameters and start values by name, in the model's units, set before it is initialised.
        substeps: steps of the model in one period.

    `open` unpacks the file into a temporary folder, loads its library and initialises the model: every opening begins
    at the model's start time. Values are set and read between steps, all of one type in one call of FMI. The raw
    integer of a float has 48 bits with its sign; readings are rounded, half to even. If the model description has a
    unit that pint knows, a wiring is checked against SCALE in that unit.

    Errors: DriverError with the message of the model. After an error, or after a step that the model could not
    complete, the model cannot be used until it is opened again. A value that is NaN, infinite or too large is a failure
    of its channel only. A call into a model cannot be interrupted: `timeout` does not bound it.
    """

    simulates_time = True
    forms = ("NAME", "NAME:SCALE (of a float)", "NAME[I,J] and NAME[I,J]:SCALE (of an array, from 1)", "tick")

    def __init__(
        self, *, model: Path, start_values: Mapping[str, int | float | bool | str] | None = None, substeps: int = 1
    ) -> None:
        within("substeps", substeps, 1, 1_000_000)
        self.model = Path(model).absolute()
        self._substeps = substeps
        self._description = described(self.model)
        self._start_values = dict(start_values or {})
        for name, value in self._start_values.items():
            check_start(self._description, name, value)
        self._instance: FmuInstance | None = None
        self._steps = 0
        self._start = 0.0
        self._reads = Plans[FmuChannel, list[_Group]](lambda channels: self._grouped("Get", channels))
        self._writes = Plans[FmuChannel, list[_Group]](lambda channels: self._grouped("Set", channels))

    def channel(self, text: str) -> FmuChannel:
        return channel_of(self._description, text)

    def physical_scale(self, channel: FmuChannel) -> PhysicalScale | None:
        """Return SCALE in the unit of the model description, if pint knows this unit."""
        if channel.scale is None or channel.units is None:
            return None
        return PhysicalScale(channel.scale, 0.0, channel.units)

    # Life ----------------------------------------------------------------------------------------

    def open(self) -> None:
        """Unpack, load and initialise the model."""
        from umo.drivers.fmu.instance import FmuInstance

        self.close()
        self._check_step()
        instance = FmuInstance(self.model, self._description)
        try:
            instance.start(self._start_values)
        except BaseException:
            instance.close()
            raise
        self._instance, self._start, self._steps = instance, instance.time, 0

    def close(self) -> None:
        self._reads.clear()
        self._writes.clear()
        if self._instance is not None:
            self._instance.close()
            self._instance = None

    def _check_step(self) -> None:
        """Check, for FMI 3.0, that a step is a multiple of the model's fixed internal step."""
        fixed, size = self._description.coSimulation.fixedInternalStepSize, self.period / self._substeps
        fixed = float(fixed or 0.0)
        if fixed and size and (size < fixed / 2 or abs(size / fixed - round(size / fixed)) > 1e-6):
            step = f"the model steps by multiples of {duration(fixed)}"
            raise DriverError(f"{step}; the period with its substeps is {duration(size)}")

    # Transfers -----------------------------------------------------------------------------------

    def reset(self, channel: FmuChannel, default: int | None) -> None:
        """Write the default. A model that has failed has no levels any more, so nothing is written to it."""
        if not self._opened().lost:
            super().reset(channel, default)

    def read(self, channel: FmuChannel) -> int:
        if channel.kind == TICK:
            self._advance()
            return 0
        return super().read(channel)

    def read_many(self, channels: Sequence[FmuChannel], out: IntArray) -> None:
        in_turn(self._reads.of(channels), lambda group: group.get(out), _texts_of, self._is_lost)

    def write_many(self, channels: Sequence[FmuChannel], raws: IntArray) -> None:
        groups = self._writes.of(channels)
        for group in groups:
            group.check(raws)  # all of them before the first is set
        in_turn(groups, lambda group: group.set(raws), _texts_of, self._is_lost)

    def _write(self, channels: Sequence[FmuChannel], raws: list[int]) -> None:
        for channel, raw in zip(channels, raws, strict=True):
            channel.fit(raw)
        self.write_many(channels, np.array(raws, np.int64))

    def _is_lost(self, error: DriverError) -> bool:
        """Return True if the model has failed, so that it transfers nothing any more."""
        return bool(self._opened().lost)

    def report(self) -> Mapping[str, Any]:
        """Return the model's time in s and its outputs, at most 40, in its units; a value that is not finite is None.
        If the model does not give a value, return the reason instead."""
        instance = self._opened()
        found: dict[str, Any] = {"time_s": round(instance.time, 9)}
        outputs = [each for each in variables_of(self._description).values() if each.causality == "output"]
        for variable in outputs[:_MAX_REPORTED]:
            try:
                found[variable.name] = instance.value(variable)
            except DriverError as error:
                found[variable.name] = str(error)
        return found

    def _opened(self) -> FmuInstance:
        if self._instance is None:
            raise DriverError("it is not open")
        return self._instance

    def _advance(self) -> None:
        """Advance the model by one period. The steps are counted, so that errors of rounding do not add up."""
        instance = self._opened()
        if not self.period > 0:
            raise DriverError("the period is 0 s; give the timer a period in its wiring")
        size = self.period / self._substeps
        for _ in range(self._substeps):
            instance.step(self._start + self._steps * size, size)
            self._steps += 1

    def _grouped(self, verb: str, channels: Sequence[FmuChannel]) -> list[_Group]:
        """Return the channels grouped by type; each type has a buffer."""
        instance = self._opened()
        _check_directions(verb, channels)
        return [_Group(instance, verb, kind, channels) for kind in dict.fromkeys(each.kind for each in channels)]


class _Group:
    """Variables of one type, transferred by one call of FMI."""

    def __init__(self, instance: FmuInstance, verb: str, kind: str, channels: Sequence[FmuChannel]) -> None:
        places = [i for i, channel in enumerate(channels) if channel.kind == kind]
        self._channels = [channels[i] for i in places]
        self.texts = [channel.text for channel in self._channels]
        self._places: Any = ... if len(places) == len(channels) else np.array(places)
        sizes = {channel.reference: channel.size for channel in self._channels}
        starts = dict(zip(sizes, accumulate(sizes.values(), initial=0), strict=False))
        buffer = instance.buffer(kind, sum(sizes.values()))
        self._buffer: npt.NDArray[Any] = np.ctypeslib.as_array(buffer)
        index = [starts[channel.reference] + channel.element for channel in self._channels]
        self._index: Any = ... if index == list(range(len(self._buffer))) else np.array(index)
        self._get_others = (
            instance.transfer("Get", kind, list(sizes), buffer)
            if verb == "Set" and any(size > 1 for size in sizes.values())
            else None
        )
        """The call that reads the elements that are not set, because FMI sets arrays as a whole; None if it is not
        needed."""
        scales = [channel.scale for channel in self._channels]
        self._scales = None if None in scales else np.array(scales, float)
        self._few = scales if None not in scales and len(scales) <= _FEW_FLOATS else []
        self._counts = np.zeros(len(places))
        self._lowest, self._highest = self._channels[0].lowest, self._channels[0].highest  # the same for one type
        self._call, self._transfer = instance.call, instance.transfer(verb, kind, list(sizes), buffer)

    def get(self, out: IntArray) -> None:
        self._call(self._transfer)
        values = self._buffer if self._index is ... else self._buffer[self._index]
        if self._few and (few := self._rounded(values)):
            out[self._places] = few
            return
        if self._scales is not None:
            counts: Any = self._counts
            np.divide(values, self._scales, counts)
            np.rint(counts, counts)
            fits = hypot(*counts.tolist()) <= self._highest  # in one look: false for NaN and infinity too
        else:
            counts = values if self._highest > 1 else values != 0
            fits = values.dtype != np.uint64 or bool((counts <= self._highest).all())
        if fits:
            out[self._places] = counts
        else:
            self._keep_good(values, counts, out)

    def _rounded(self, values: npt.NDArray[Any]) -> list[int]:
        """Return the raw integers of a few floats; empty if one of them does not fit."""
        try:
            found = [round(value / scale) for value, scale in zip(values.tolist(), self._few, strict=True)]
        except (ValueError, OverflowError):  # NaN, infinity
            return []
        return found if min(found) >= self._lowest and max(found) <= self._highest else []

    def _keep_good(self, values: npt.NDArray[Any], counts: npt.NDArray[Any], out: IntArray) -> None:
        """Store the readings that are raw integers. Raises ChannelsFailed for the others."""
        good = (counts >= self._lowest) & (counts <= self._highest)  # a NaN is neither
        out[np.arange(len(out))[self._places][good]] = counts[good]
        bad = np.flatnonzero(~good)
        if len(bad):
            raise ChannelsFailed({self.texts[i]: f"the model gives {values[i]!s}" for i in bad})

    def check(self, raws: IntArray) -> None:
        mine = raws[self._places].tolist()
        if min(mine) < self._lowest or max(mine) > self._highest:
            place = next(i for i, raw in enumerate(mine) if not self._lowest <= raw <= self._highest)
            self._channels[place].fit(mine[place])

    def set(self, raws: IntArray) -> None:
        if self._get_others is not None:
            self._call(self._get_others)
        if self._scales is None:
            self._buffer[self._index] = raws[self._places]
        elif self._index is ...:
            np.multiply(raws[self._places], self._scales, self._buffer)
        else:
            self._buffer[self._index] = raws[self._places] * self._scales
        self._call(self._transfer)


def _texts_of(group: _Group) -> list[str]:
    return group.texts


def _check_directions(verb: str, channels: Sequence[FmuChannel]) -> None:
    needed = Direction.INPUT if verb == "Get" else Direction.OUTPUT
    for channel in channels:
        if channel.kind == TICK:
            raise DriverError("tick is the timer: it is read by itself" if verb == "Get" else "tick is an input")
        if needed not in channel.direction:
            raise DriverError(f"{channel.text} is an {'output' if verb == 'Get' else 'input'}")
