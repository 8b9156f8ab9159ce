"""The control of the batch plant: a reactor makes batches, the charging line weighs their raw materials (charging.py).
Each reactor and the line are equipment, so that a fault of one does not stop the others. The line's work for a reactor
is a sequence of the line, which the reactor awaits. If the line fails, the line and the reactor whose batch is
interrupted are in fault.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import nan
from typing import Annotated, ClassVar

from umo import Compound, DigitalActuator, DigitalSensor, Interlock, Number
from umo.control import Servo, Task, first, unless, until, value_of, wait
from umo.errors import TimeExpired
from umo.operation import Procedure, ProcedureState
from umo.operation.alarms import Alarm, High, Priority
from umo.operation.recipe_book import RecipeBook, recipe_names

from .batch_recipes import BOOK, FOLDER, STIRRING_TOLERANCE, BatchRecipe
from .charging import CLOSED, OPEN, ChargingLine, Valve, held_open
from .errors import ChargingError, DrainingError, TemperatureError

WAITING = "waiting for the scale"
"""The phase of a reactor while the other reactor uses the charging line, or the line is in fault."""

__all__ = ["BatchPlant", "ChargingLine", "Making", "Reactor"]


class Making(Procedure):
    """The states of a reactor, which makes a batch of its recipe at each start. While it is paused or held, the reactor
    keeps its temperature, the valves are closed, and the charging line waits if it is charging this reactor."""

    numbers: ClassVar[Mapping[str, Number]] = {
        **Procedure.numbers,
        "making": Number(shown=True, names=recipe_names(BOOK, "nothing")),
    }
    part: Reactor
    line: ChargingLine
    recipe: BatchRecipe
    making = 0
    """The number of the reactor's recipe (`RecipeBook.number_of`); 0 if the reactor has made nothing."""

    def take(self, recipe: BatchRecipe, number: int) -> None:
        """Make the next batch by this recipe, which has this number."""
        self.recipe, self.making = recipe, number

    async def execute(self) -> None:
        await self.part.produce(self.recipe, self.line)
        self.produced += 1

    async def pausing(self) -> None:
        self.part.close_valves(self.line)

    async def holding(self) -> None:
        self.part.close_valves(self.line)

    def supervise(self) -> None:
        super().supervise()
        if self.part.in_line is not None:
            self.part.in_line.paused = self.state in self.model.waiting


class Reactor(
    Compound,
    equipment=True,
    stop_order=("heater", "stirrer", "feed", "drain"),
    numbers={
        "heating.gain": Number("percent/K", 0.0, 50.0, tunable=True),
        "heating.integral_time": Number("s", 20.0, 2000.0, tunable=True),
    },
    alarms={
        "hot": Alarm(High("temperature", 95.0, deadband=1.0), "the reactor is hot", priority=Priority.HIGH),
        "full": Alarm(High("level", 140.0, deadband=2.0), "the reactor is nearly full", on_delay="2 s"),
        "waiting": Alarm(lambda reactor: reactor.waits, "the reactor waits for the charging line", on_delay="120 s"),
    },
    max_period="1 s",
):
    """A vessel with a heater and a stirrer. It makes one batch at a time."""

    feed: Valve
    drain: Valve
    stirrer: DigitalActuator
    heater: DigitalActuator
    temperature: DigitalSensor
    level: DigitalSensor
    gain: float = 6.0
    """Gain of the heater's PI, percent per K."""
    integral_time: float = 200.0
    """Integral time of the heater's PI, s."""
    tolerance: Annotated[float, Number("K", 0.2, 2.0, tunable=True)] = 1.0
    """The largest distance from the recipe's temperature at which the holding time is counted, K."""
    heating_time: Annotated[float, Number("s", 60.0, 3600.0, tunable=True)] = 400.0
    """The time within which a batch must reach its temperature, s."""
    rise_time: Annotated[float, Number("s", 10.0, 600.0)] = 60.0
    """The time within which the temperature must rise by `least_rise` while it is below its setpoint by more than this,
    s."""
    least_rise: Annotated[float, Number("K", 0.5, 20.0)] = 5.0
    """Rise of the temperature in `rise_time` that shows that the reactor is heated and its temperature measured, K."""
    line_time: Annotated[float, Number("s", 0.0, 36_000.0)] = 600.0
    """Time for which a batch waits for a charging line in fault, s."""
    draining_time: float = 120.0
    """Time in which the reactor must become empty, s."""
    covered: float = 20.0
    """Level above which the heater is covered, l."""
    full: float = 150.0
    """Level above which the feed valve is inhibited, l."""
    empty: float = 1.0
    """Level below which the reactor is empty, l."""
    hottest: float = 100.0
    """Temperature above which the heater is inhibited, degC."""

    def setup(self) -> None:
        self.heating = Servo(self.temperature, self.heater, gain=self.gain, integral_time=self.integral_time)
        self.number = 0  # among the reactors, and of its outlet of the charging line
        self.setpoint = nan  # degC; NaN: it is neither heated nor stirred
        self.stirring = 0.0  # rpm
        self.unit = Making(self)
        self.in_line: Task | None = None  # what the charging line does for this reactor now
        self.begin()

    def begin(self) -> None:
        """Begin a run, in which the present content belongs to no batch."""
        self._before = self.unit.produced, self.unit.rejected  # the counts are kept over a restart
        self.phase = "idle"
        self._ready = False  # what is in it is a batch that is made, and only to be drained

    @property
    def waits(self) -> bool:
        """True if the reactor waits for the charging line."""
        return self.phase == WAITING

    @property
    def made(self) -> int:
        """Batches made in this run."""
        return self.unit.produced - self._before[0]

    @property
    def dumped(self) -> int:
        """Batches dumped in this run."""
        return self.unit.rejected - self._before[1]

    def interlocks(self) -> Iterator[Interlock]:
        """Return the interlocks. A level or a temperature that cannot be read counts as dangerous."""
        dry = Interlock(lambda: value_of(self.level) < self.covered, [self.heater], "the level is low")
        hot = Interlock(lambda: value_of(self.temperature) > self.hottest, [self.heater], "too hot")
        full = Interlock(lambda: value_of(self.level) > self.full, [self.feed], "the reactor is full")
        fed = Interlock(lambda: self.feed.read() is OPEN, [self.drain], "the feed valve is open")
        drained = Interlock(lambda: self.drain.read() is OPEN, [self.feed], "the drain valve is open")
        yield from (dry, hot, full, fed, drained)

    def control(self) -> None:
        if self.setpoint == self.setpoint:  # not NaN
            self.heating.control(self.setpoint, dt=self.dt)
            self.stirrer.write(self.stirring)

    @property
    def activity(self) -> str:
        """The activity of the reactor in one word: its phase, or the state in which it waits."""
        if self.cycle.fault:
            return "fault"
        state = self.unit.state
        stands = (*self.unit.model.waiting, ProcedureState.STOPPED)
        return state.name.lower() if state in stands else self.phase

    async def produce(self, recipe: BatchRecipe, line: ChargingLine) -> None:
        """Make one batch. The remains of a batch that failed are drained first. A batch that failed while it was
        drained counts as made when the draining is done."""
        try:
            if value_of(self.level) > self.empty and not self._ready:
                self.unit.rejected += 1
                await self._empty("dumping")
            if not self._ready:
                await self._charge(recipe, line)
                await self._heat(recipe)
                await self._hold(recipe)
            self._ready = True
            await self._empty("draining")
            self._ready = False
            self.phase = "idle"
        finally:
            self.rest()

    def rest(self) -> None:
        """Switch heater and stirrer off."""
        self.setpoint = nan
        self.heater.write(0.0)
        self.stirrer.write(0.0)

    def close_valves(self, line: ChargingLine) -> None:
        """Close all valves because the batch is held, including the valves of the charging line if it works for this
        reactor."""
        in_line = () if self.in_line is None else (*line.inlets, *line.outlets, line.waste)
        for valve in (self.feed, self.drain, *in_line):
            valve.write(CLOSED)

    async def _charge(self, recipe: BatchRecipe, line: ChargingLine) -> None:
        self.phase = WAITING
        async with line.lock:
            await self._cleared(line)
            self.phase = "weighing"
            await self._carried_out(line.cycle.start(line.weigh(recipe.amounts)))
            self.phase = "charging"
            discharged = line.cycle.start(line.discharge(self.number))
            await first(self._carried_out(discharged), held_open(self.feed))

    async def _carried_out(self, in_line: Task) -> None:
        """Wait for the end of the charging line's work for this reactor."""
        self.in_line = in_line
        try:
            await in_line
        finally:
            self.in_line = None

    async def _cleared(self, line: ChargingLine) -> None:
        """Wait until the line is no longer in fault. It had failed before this batch."""
        try:
            await until(lambda: line.cycle.fault is None, timeout=self.line_time)
        except TimeExpired:
            raise ChargingError(f"the charging line was in fault for {self.line_time:g} s") from None

    async def _heat(self, recipe: BatchRecipe) -> None:
        self.phase = "heating"
        self.stirring = recipe.stirring
        self.heating.reset()
        self.setpoint = recipe.temperature
        await self._arrive()

    async def _arrive(self) -> None:
        """Wait until the temperature of the recipe is reached."""
        arrived = until(lambda: not self._is_off(), timeout=self.heating_time, stays="5 s")
        try:
            number, _ = await first(arrived, self._standstill())
        except TimeExpired:
            number = 1
        if number == 1:
            found, wanted = self.temperature.read(), self.setpoint
            raise TemperatureError(f"{found:.1f} degC: the temperature does not reach {wanted:g} degC")

    async def _standstill(self) -> None:
        """End when the temperature does not rise although it is too low: the thermometer or the heater has failed."""
        while True:
            before = value_of(self.temperature)
            await wait(self.rise_time)
            now = value_of(self.temperature)
            if now < before + self.least_rise and now < self.setpoint - self.least_rise:
                return

    def _is_off(self) -> bool:
        """True if temperature or stirring are not those of the recipe: a box that was away begins at 0 rpm."""
        slow = abs(self.stirrer.read() - self.stirring) > STIRRING_TOLERANCE
        return slow or abs(value_of(self.temperature) - self.setpoint) > self.tolerance

    async def _hold(self, recipe: BatchRecipe) -> None:
        """Keep the temperature for the time of the recipe, without interruption."""
        self.phase = "holding"
        while not await unless(self._is_off, wait(recipe.hold)):
            await self._arrive()

    async def _empty(self, phase: str) -> None:
        self.phase = phase
        self.rest()
        empty = until(lambda: value_of(self.level) < self.empty, timeout=self.draining_time, stays="5 s")
        try:
            await first(empty, held_open(self.drain))
        except TimeExpired:
            raise DrainingError(f"{self.level.read():.0f} l left after {self.draining_time:g} s of draining") from None


class BatchPlant(Compound, stop_order=("reactors", "line"), max_period="200 ms"):
    """Two reactors and the charging line."""

    reactors: Sequence[Reactor]
    line: ChargingLine
    timer: DigitalSensor

    def setup(self) -> None:
        for number, reactor in enumerate(self.reactors):
            reactor.number = number
            reactor.unit.line = self.line
        self.book = RecipeBook(BatchRecipe, FOLDER)
        for reactor in self.reactors:
            reactor.unit.recipe = next(iter(self.book.recipes.values()))
        self._told = ""

    def control(self) -> None:
        """Report what the reactors do."""
        told = ", ".join(f"{reactor.number} {reactor.activity}" for reactor in self.reactors)
        if told != self._told:
            self._told = told
            self.cycle.progress(told, done=sum(reactor.made for reactor in self.reactors))
