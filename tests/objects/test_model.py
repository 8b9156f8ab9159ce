"""The objects against a model written from the paper's text alone (section 4.5), in each form of the image."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.conversions import WAYS, choose
from helpers.machines import actuator, relay, sensor, switch, wired
from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor, connect
from umo.objects import find
from umo.states import OnOff, PassFail
from umo.testing import Scripted

# The paper's text --------------------------------------------------------------------------------------


@dataclass
class PaperActuator:
    """ "`Current_value` stores the last value that was written ... `current_command` is the value that was last
    commanded to the actuator hardware." """

    is_synchronous: bool
    default_value: Any
    current_value: Any = None
    current_command: Any = None
    sent: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.reset()  # "The actuator is also initialized when the constructor is called."

    def command(self, value: Any) -> None:
        self.current_command = value
        self.sent.append(value)

    def write(self, value: Any) -> None:
        self.current_value = value
        if not self.is_synchronous:  # "`current_command` will be assigned ... as soon as `write` is called"
            self.command(value)

    def update(self) -> None:
        if self.is_synchronous:  # "commands the `current_value` ... thus only applies to synchronous actuators"
            self.command(self.current_value)

    def reset(self) -> None:
        """ "typically sets the value of the actuator to its default value" """
        self.current_value = self.default_value
        self.command(self.default_value)

    def read(self) -> Any:
        return self.current_command  # "The `read` function returns the value of `current_command`."


@dataclass
class PaperSensor:
    is_synchronous: bool
    hardware: Any
    current_value: Any = None

    def __post_init__(self) -> None:
        self.sample()

    def sample(self) -> None:
        if self.is_synchronous:  # "which applies only to synchronous sensors"
            self.current_value = self.hardware

    def reset(self) -> None:
        """ "Resets ... the sensor": nothing that `read` shows."""

    def read(self) -> Any:
        """ "only reads the state of the actual hardware if the sensor is declared as asynchronous" """
        return self.current_value if self.is_synchronous else self.hardware


# The machine -------------------------------------------------------------------------------------------


class Part(Compound):
    da: DigitalActuator
    ba: BinaryActuator[OnOff]
    ds: DigitalSensor
    bs: BinarySensor[PassFail]


class Whole(Compound):
    quick: Part
    later: Part


def whole() -> Whole:
    return Whole(
        quick=Part(
            da=actuator(default=1.0, synchronous=False),
            ba=relay(synchronous=False),
            ds=sensor(synchronous=False),
            bs=switch(synchronous=False),
        ),
        later=Part(da=actuator(default=-2.0), ba=relay(default=OnOff.ON), ds=sensor(), bs=switch()),
    )


def model() -> dict[str, Any]:
    return {
        "quick.da": PaperActuator(False, 1.0),
        "quick.ba": PaperActuator(False, OnOff.OFF),
        "quick.ds": PaperSensor(False, 0.0),
        "quick.bs": PaperSensor(False, PassFail.PASS),
        "later.da": PaperActuator(True, -2.0),
        "later.ba": PaperActuator(True, OnOff.ON),
        "later.ds": PaperSensor(True, 0.0),
        "later.bs": PaperSensor(True, PassFail.PASS),
    }


PATHS = list(model())
ACTUATORS = [path for path in PATHS if path.endswith("a")]
SENSORS = [path for path in PATHS if path.endswith("s")]
LEVELS = {
    "da": st.integers(-20, 20).map(lambda raw: (raw * 0.5, raw)),
    "ba": st.sampled_from([(OnOff.ON, 1), (OnOff.OFF, 0)]),
    "ds": st.integers(0, 200).map(lambda raw: (raw * 0.5, raw)),
    "bs": st.sampled_from([(PassFail.FAIL, 1), (PassFail.PASS, 0)]),
}


def some(paths: list[str], verb: str) -> st.SearchStrategy[tuple[Any, ...]]:
    return st.sampled_from(paths).flatmap(lambda path: st.tuples(st.just(verb), st.just(path), LEVELS[path[-2:]]))


STEPS = st.lists(
    some(ACTUATORS, "write")
    | some(SENSORS, "hardware")
    | st.tuples(st.sampled_from(["sample", "update", "reset"]), st.sampled_from(["", "quick", "later"]))
    | st.tuples(st.just("update"), st.sampled_from(ACTUATORS))
    | st.tuples(st.just("sample"), st.sampled_from(SENSORS))
    | st.tuples(st.just("reset"), st.sampled_from(PATHS)),
    max_size=30,
)


@pytest.mark.parametrize("way", WAYS)
@given(steps=STEPS)
def test_the_objects_do_what_the_papers_text_says(way, steps):
    raws = {path: {1.0: 2, -2.0: -4, OnOff.ON: 1, OnOff.OFF: 0} for path in PATHS}
    paper, machine, box = model(), whole(), Scripted()
    with pytest.MonkeyPatch.context() as patch:
        choose(patch, way)
        connection = connect(machine, wired(machine, box))
        with connection as m:
            for verb, path, *level in steps:
                node = find(m, path) if path else m
                below = [p for p in PATHS if p == path or p.startswith(f"{path}.") or not path]
                if verb == "write":
                    value, raw = level[0]
                    raws[path][value] = raw
                    assert node.write(value) is True
                    paper[path].write(value)
                elif verb == "hardware":
                    paper[path].hardware, raw = level[0]
                    box.set(path, raw)
                else:
                    getattr(node, verb)()
                    for p in below:
                        getattr(paper[p], verb, lambda: None)()
                for p in PATHS:
                    assert find(m, p).read() == paper[p].read(), p
                for p in ACTUATORS:
                    assert find(m, p).pending == paper[p].current_value, p
                    assert box.get(p) == raws[p][paper[p].current_command], p
    for p in ACTUATORS:  # in the same order and number too, up to the reset of leaving
        levels = [
            raw
            for call in box.segments("initialize", "write", "write_many", "reset")
            for channel, raw in zip(call.channels, call.raws, strict=True)
            if channel == p
        ]
        assert levels == [raws[p][value] for value in [*paper[p].sent, paper[p].default_value]], p
