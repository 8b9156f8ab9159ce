"""The wiring's lint: every fault is found, all in one run, each with file and key."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from helpers.machines import actuator, bench, sensor, switch, timer, wired
from helpers.tiers import budget
from umo import Compound, DigitalActuator, DigitalSensor, Range, check, connect
from umo.drivers import Channel, Direction, Driver, KnowsScale, WiringError
from umo.errors import OptionError
from umo.objects import atoms
from umo.testing import Scripted, VirtualTimer
from umo.wiring import resolve


class Card(Driver):
    """A circuit with few channels, and options."""

    def __init__(self, host: str, port: int = 502, fast: bool = False, gain: float = 1.0) -> None:
        self.host, self.port, self.fast, self.gain = host, port, fast, gain
        if port < 0:
            raise ValueError("the port is negative")

    def channel(self, text):
        channels = {
            "out": Channel("out", Direction.OUTPUT, 8, signed=True),
            "in": Channel("in", Direction.INPUT, 8),
            "wide": Channel("wide", Direction.BOTH, 64),
        }
        from umo.errors import ChannelError

        if text not in channels:
            raise ChannelError(text, channels)
        return channels[text]


CARD = f"{__name__}:Card"


def faults(machine: Compound, wiring: Any) -> list[tuple[str, str]]:
    found = [(fault.key, fault.message) for fault in check(machine, wiring)]
    if found:
        with pytest.raises(WiringError) as caught:
            resolve(machine, wiring)
        assert [(fault.key, fault.message) for fault in caught.value.mistakes] == found
        assert all(message in str(caught.value) for _, message in found)
    return found


def simulated(machine: Compound, **entries: Any) -> dict[str, Any]:
    """Everything simulated; `entries` change the lines (`__` for the dot), None leaves one out."""
    wire: dict[str, Any] = {item.path: {"driver": "simulated"} for item in atoms(machine)}
    if "timer" in wire:
        wire["timer"]["period"] = "1 ms"
    for path, entry in entries.items():
        path = path.replace("__", ".")
        wire[path] = wire.get(path, {"driver": "simulated"}) | entry if entry is not None else None
    return {"wire": {path: entry for path, entry in wire.items() if entry is not None}}


def one_fault(machine: Compound, wiring: Any) -> tuple[str, str]:
    found = faults(machine, wiring)
    assert len(found) == 1, found
    return found[0]


# Objects and lines -----------------------------------------------------------------------------------


def test_a_wiring_that_fits_has_no_faults():
    assert faults(bench(), simulated(bench())) == []
    assert faults(bench(), None) == []


def test_a_file_may_begin_with_the_mark_of_windows(tmp_path: Path):
    file = tmp_path / "wiring.toml"
    file.write_text('[wire.moter]\ndriver = "simulated"\n', encoding="utf-8-sig")
    assert ('wire."moter"', "the machine has no such object (did you mean 'motor'?)") in faults(bench(), file)


def test_a_line_for_an_unknown_object_names_the_nearest():
    key, message = one_fault(bench(), simulated(bench(), moter={}))
    assert key == 'wire."moter"'
    assert message == "the machine has no such object (did you mean 'motor'?)"


class Arm(Compound):
    motor: DigitalActuator


def test_an_object_without_a_line_is_a_fault():
    assert one_fault(bench(), simulated(bench(), valve=None)) == (
        'wire."valve"',
        'is not wired; for hardware that does not exist yet use { driver = "simulated" }',
    )


def test_an_unknown_driver_names_the_nearest():
    key, message = one_fault(bench(), simulated(bench(), motor={"driver": "simulatd"}))
    assert key == 'wire."motor".driver'
    assert message.startswith("there is no driver 'simulatd' (did you mean 'simulated'?); known: ")


def test_a_driver_declared_in_the_file_may_be_the_nearest_too():
    wiring = simulated(bench(), motor={"driver": "dacs"})
    wiring["drivers"] = {"dac": {"type": "simulated"}}
    assert "did you mean 'dac'?" in one_fault(bench(), wiring)[1]


def test_an_unknown_type_of_driver_is_one_fault_at_its_table():
    wiring = simulated(bench(), motor={"driver": "dac"}, valve={"driver": "dac"})
    wiring["drivers"] = {"dac": {"type": "modbuss"}}
    key, message = one_fault(bench(), wiring)
    assert key == "drivers.dac.type"
    assert "did you mean 'modbus'?" in message


@pytest.mark.parametrize("table", [{}, {"typ": "simulated"}, {"type": 5}, {"type": None}, {"type": ["simulated"]}])
def test_a_driver_without_a_type_is_one_fault(table):
    wiring = simulated(bench(), motor={"driver": "dac"})
    wiring["drivers"] = {"dac": table}
    assert one_fault(bench(), wiring) == ("drivers.dac.type", "is missing: a driver's name, or module:Class")


def test_two_objects_on_one_channel():
    wiring = simulated(bench(), motor={"channel": "7"}, encoder={"channel": "7"})
    assert one_fault(bench(), wiring) == ('wire."encoder"', "channel '7' of simulated is already used by motor")


def test_one_channel_of_two_drivers_is_no_clash():
    wiring = simulated(bench(), motor={"channel": "7"}, encoder={"channel": "7", "driver": "other"})
    wiring["drivers"] = {"other": {"type": "simulated"}}
    assert faults(bench(), wiring) == []


def test_channels_that_share_a_place_clash():
    class Wide(Scripted):
        def channel(self, text):
            @dataclass(frozen=True)
            class Words(Channel):
                @property
                def places(self):
                    return (int(self.text), int(self.text) + 1)

            return Words(text, Direction.BOTH, 32, signed=True)

    wiring = simulated(bench(), motor={"driver": "box", "channel": "4"}, encoder={"driver": "box", "channel": "5"})
    wiring["drivers"] = {"box": Wide()}
    assert one_fault(bench(), wiring) == ('wire."encoder"', "channel '5' of box is already used by motor")


def test_a_channel_that_its_driver_does_not_know():
    wiring = simulated(bench(), motor={"driver": "card", "channel": "outt"})
    wiring["drivers"] = {"card": {"type": CARD, "host": "here"}}
    assert one_fault(bench(), wiring) == (
        'wire."motor".channel',
        "there is no channel 'outt' (did you mean 'out'?); the forms are: out, in, wide",
    )


def test_a_channel_that_makes_its_driver_fail_is_a_fault_all_the_same():
    class Fussy(Scripted):
        def channel(self, text):
            return {}[text]

    wiring = simulated(bench(), motor={"driver": "box"})
    wiring["drivers"] = {"box": Fussy()}
    key, message = one_fault(bench(), wiring)
    assert key == 'wire."motor".channel'
    assert message.startswith("KeyError: 'motor' (")


@pytest.mark.parametrize(
    ("path", "channel", "message"),
    [
        ("motor", "in", "is an actuator, but channel 'in' is an input"),
        ("encoder", "out", "is a sensor, but channel 'out' is an output"),
        ("valve", "in", "is an actuator, but channel 'in' is an input"),
        ("limit", "out", "is a sensor, but channel 'out' is an output"),
    ],
)
def test_a_direction_that_the_channel_does_not_have(path, channel, message):
    wiring = simulated(bench(), **{path: {"driver": "card", "channel": channel}})
    wiring["drivers"] = {"card": {"type": CARD, "host": "here"}}
    assert (f'wire."{path}".channel', message) in faults(bench(), wiring)


# Numbers ---------------------------------------------------------------------------------------------


def on_card(channel: str, **entry: Any) -> dict[str, Any]:
    wiring = simulated(Arm(motor=actuator()), motor={"driver": "card", "channel": channel} | entry)
    wiring["drivers"] = {"card": {"type": CARD, "host": "here"}}
    return wiring


@pytest.mark.parametrize(
    ("resolution", "fits"), [(0.5, True), (10 / 127, True), (10 / 127.6, False), (-10 / 127, True)]
)
def test_a_range_whose_raw_values_do_not_fit_the_channels_bits(resolution, fits):
    found = faults(Arm(motor=actuator()), on_card("out", resolution=resolution))
    if fits:
        assert found == []
    else:
        assert found == [
            ('wire."motor"', "the range needs raw values -128 to 128, channel 'out' has 8 bits: -128 to 127")
        ]


def test_raw_values_beyond_int64_fit_no_channel_though_it_have_64_bits():
    machine = Arm(motor=actuator(minimum=0.0, default=0.0, maximum=1.7e19, resolution=1.0))
    assert "raw values 0 to 17000000000000000000" in one_fault(machine, on_card("wide"))[1]
    assert faults(Arm(motor=actuator(minimum=0.0, maximum=9e18, resolution=1.0)), on_card("wide")) == []


@pytest.mark.parametrize("resolution", [1e-320, -5e-324, 1e-308])
def test_a_resolution_too_fine_for_any_raw_value_is_a_fault(resolution):
    assert "too large for any channel" in one_fault(Arm(motor=actuator()), on_card("out", resolution=resolution))[1]


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ({"resolution": 0}, "resolution"),
        ({"resolution": float("nan")}, "resolution"),
        ({"resolution": "fine"}, "resolution"),
        ({"zero_offset": float("inf")}, "zero_offset"),
        ({"zero_offset": 10**400}, "zero_offset"),
        ({"minimum": True}, "minimum"),
        ({"inverted": "yes"}, "inverted"),
        ({"channel": 5}, "channel"),
        ({"driver": None}, "driver"),
        ({"driver": 5}, "driver"),
        ({"channel": []}, "channel"),
        ({"minimum": [1]}, "minimum"),
    ],
)
def test_a_wrong_value_is_a_fault_at_its_key(entry, key):
    assert one_fault(bench(), simulated(bench(), motor=entry))[0] == f'wire."motor".{key}'


def test_an_unknown_key_names_the_nearest():
    key, message = one_fault(bench(), simulated(bench(), motor={"chanel": "5"}))
    assert key == 'wire."motor".chanel'
    assert message.startswith("unknown key (did you mean 'channel'?); known: driver, channel, inverted")


def test_a_line_without_a_driver():
    wiring = simulated(bench())
    wiring["wire"]["motor"] = {"channel": "5"}
    assert one_fault(bench(), wiring) == ('wire."motor".driver', "is missing")


@pytest.mark.parametrize("line", ["simulated", 5, None, ["simulated"]])
def test_a_line_that_is_no_table(line):
    wiring = simulated(bench())
    wiring["wire"]["motor"] = line
    key, message = one_fault(bench(), wiring)
    assert (key, message.startswith("must be a table such as")) == ('wire."motor"', True)


@pytest.mark.parametrize(
    ("entry", "key"),
    [
        ({"minimum": -10.5}, "minimum"),
        ({"maximum": 10.5}, "maximum"),
        ({"minimum": 11.0}, "minimum"),
        ({"maximum": -11.0}, "maximum"),
    ],
)
def test_a_range_may_be_narrowed_never_widened(entry, key):
    found = faults(bench(), simulated(bench(), motor=entry))
    assert found[0][0] == f'wire."motor".{key}'
    assert "widens the declared range -10 to 10 V" in found[0][1]


def test_a_narrowed_range_holds_while_connected():
    with connect(bench(), simulated(bench(), motor={"minimum": -2, "maximum": 3.5})) as m:
        assert (m.motor.minimum, m.motor.maximum) == (-2.0, 3.5)
        assert m.motor.write(3.5)
        with pytest.raises(ValueError, match=r"outside -2 to 3.5"):
            m.motor.write(4.0)


def test_a_range_narrowed_to_nothing_or_past_the_default_is_a_fault():
    assert "is not below" in faults(bench(), simulated(bench(), encoder={"minimum": 50, "maximum": 50}))[0][1]
    assert (
        "the default 0 V is outside the narrowed range"
        in one_fault(bench(), simulated(bench(), motor={"minimum": 1}))[1]
    )


def test_calibration_is_for_digital_objects_and_inversion_for_binary_ones():
    found = faults(
        bench(), simulated(bench(), valve={"resolution": 1.0}, limit={"minimum": 0}, motor={"inverted": True})
    )
    assert found == [
        ('wire."motor".inverted', "is for binary objects; use a negative resolution"),
        ('wire."valve".resolution', "is for digital objects; this one is binary"),
        ('wire."limit".minimum', "is for digital objects; this one is binary"),
    ]


# Options of drivers ----------------------------------------------------------------------------------


def card(**options: Any) -> list[tuple[str, str]]:
    wiring = simulated(bench())
    wiring["drivers"] = {"card": {"type": CARD, "host": "here"} | options}
    return faults(bench(), wiring)


def test_options_are_checked_against_the_constructors_annotations():
    assert card(port=1, fast=True, gain=2) == []
    assert [key for key, _ in card(port="5020")] == ["drivers.card.port"]
    assert [key for key, _ in card(fast=1)] == ["drivers.card.fast"]
    assert [key for key, _ in card(host=5, gain="x")] == ["drivers.card.host", "drivers.card.gain"]


def test_an_unknown_option_names_the_nearest():
    ((key, message),) = card(prot=5020)
    assert key == "drivers.card.prot"
    assert "did you mean 'port'?" in message


def test_a_missing_option_is_a_fault():
    wiring = simulated(bench())
    wiring["drivers"] = {"card": {"type": CARD}}
    assert one_fault(bench(), wiring) == ("drivers.card.host", "is missing")


def test_what_the_constructor_refuses_is_a_fault():
    ((key, message),) = card(port=-1)
    assert key == "drivers.card"
    assert message.startswith("ValueError: the port is negative (")


def test_an_option_whose_annotation_cannot_be_evaluated_takes_any_value(monkeypatch):
    taken = []

    def vague(self, host: NoSuchName) -> None:  # noqa: F821
        taken.append(host)

    monkeypatch.setattr(Card, "__init__", vague)
    assert card(host=7) == []
    assert taken == [7]


@pytest.mark.parametrize("duration", ["20 parsnips", "", "-1 ms", "0 ms", 0, -1, True, [], "20", float("nan"), 10**400])
@pytest.mark.parametrize("key", ["timeout", "watchdog"])
def test_a_bad_duration_of_a_driver(key, duration):
    assert [fault[0] for fault in card(**{key: duration})][:1] == [f"drivers.card.{key}"]


def test_a_watchdog_must_be_longer_than_the_period():
    box, clock = Scripted(), VirtualTimer()
    wiring = wired(bench(), box, clock=clock, entries={"timer": {"period": "100 ms"}})
    for watchdog, fault in {"100 ms": ["100 ms is not longer than the period, 100 ms"], "101 ms": []}.items():
        wiring["drivers"]["box"] = {"type": box, "watchdog": watchdog}
        assert [message for _, message in faults(bench(), wiring)] == fault


def test_a_watchdog_where_the_circuit_has_none():
    assert card(watchdog="1 s") == [("drivers.card.watchdog", f"{CARD} has no watchdog of its own")]


def test_every_driver_learns_its_timeout_and_period():
    wiring = simulated(bench())
    wiring["drivers"] = {"card": {"type": CARD, "host": "here", "timeout": "20 ms"}, "other": {"type": "simulated"}}
    drivers = resolve(bench(), wiring).drivers
    assert drivers["card"].timeout == pytest.approx(0.02)
    assert drivers["other"].timeout == pytest.approx(0.01)  # 10 periods
    assert drivers["card"].period == pytest.approx(0.001)


def test_a_timeout_that_nobody_gave_is_at_most_a_second():
    """However long the period is."""
    wiring = simulated(bench())
    wiring["wire"]["timer"]["period"] = "6 s"
    assert resolve(bench(), wiring).drivers["simulated"].timeout == 1.0
    assert Scripted().timeout <= 1.0


def test_options_of_connect_go_to_the_drivers_that_take_them():
    wiring = simulated(bench())
    wiring["drivers"] = {"card": {"type": CARD, "host": "here", "port": 1}}
    assert resolve(bench(), wiring, {"port": 2}).drivers["card"].port == 2
    with pytest.raises(OptionError, match=r"--prot: unknown option \(did you mean 'port'\?\)"):
        connect(bench(), wiring, prot=1).__enter__()
    with pytest.raises(OptionError, match=r"^--port: must be a whole number, .* not 'two'"):
        resolve(bench(), wiring, {"port": "two"})


# Ready-made drivers ----------------------------------------------------------------------------------


def test_a_driver_made_beforehand_may_stand_for_its_table_or_be_its_type():
    box, clock = Scripted(), VirtualTimer()
    wiring = wired(bench(), box, clock=clock)
    assert faults(bench(), wiring) == []
    assert resolve(bench(), wiring).drivers == {"box": box, "clock": clock}
    wiring["drivers"]["box"] = {"type": box, "timeout": "7 ms", "watchdog": "1 s"}
    ready = resolve(bench(), wiring)
    assert (ready.drivers["box"], box.timeout, ready.watchdogs) == (box, 0.007, {"box": 1.0})


def test_options_come_too_late_for_a_driver_made_beforehand():
    wiring = wired(bench(), Scripted())
    wiring["drivers"]["box"] = {"type": Scripted(), "port": 5}
    assert one_fault(bench(), wiring)[0] == "drivers.box.port"


# Time ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", ["1 V", "fast", "", "0 ms", "-1 ms", -1, 0, True, [], "nan s", 10**400])
def test_a_bad_period(period):
    assert one_fault(bench(), simulated(bench(), timer={"period": period}))[0] == 'wire."timer".period'


@pytest.mark.parametrize(("period", "value"), [("1 ms", 1e-3), ("250 us", 2.5e-4), (0.002, 2e-3), ("1 s", 1.0)])
def test_a_period_in_any_unit_or_in_seconds(period, value):
    assert resolve(bench(), simulated(bench(), timer={"period": period})).period == pytest.approx(value)


@pytest.mark.parametrize("period", [1, 50])
def test_a_period_that_is_a_whole_number_has_a_unit(period):
    text = f'{period} has no unit: write "{period} ms" or "{period} s"'
    assert one_fault(bench(), simulated(bench(), timer={"period": period})) == ('wire."timer".period', text)


def test_a_timer_without_a_period():
    wiring = simulated(bench())
    wiring["wire"]["timer"] = {"driver": "simulated"}
    assert one_fault(bench(), wiring) == ('wire."timer".period', 'is missing; give for example "1 ms"')


def test_a_period_that_is_not_the_timers():
    assert one_fault(bench(), simulated(bench(), motor={"period": "1 ms"})) == (
        'wire."motor".period',
        "is allowed for the timer only",
    )


class Law(Compound, max_period="2 ms"):
    timer: DigitalSensor
    motor: DigitalActuator


class Fast(Compound, max_period=0.0005):
    motor: DigitalActuator


class Both(Compound):
    timer: DigitalSensor
    fast: Fast


def test_a_period_longer_than_a_controller_allows():
    law = Law(timer=timer(), motor=actuator())
    assert faults(law, simulated(law, timer={"period": "2 ms"})) == []
    assert one_fault(law, simulated(law, timer={"period": "2.1 ms"})) == (
        'wire."timer".period',
        "2.1 ms is longer than `max_period` of Law (2 ms)",
    )
    both = Both(timer=timer(), fast=Fast(motor=actuator()))
    assert "1 ms is longer than `max_period` of fast (500 µs)" in one_fault(both, simulated(both))[1]


def test_a_timer_is_an_asynchronous_sensor_in_sampling_periods_that_does_not_hold():
    class Odd(Compound):
        timer: Any

    for wrong in (
        sensor(synchronous=False),
        DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1),
        switch(synchronous=False),
        actuator(),
    ):
        key, message = one_fault(Odd(timer=wrong), None)
        assert (key, "timer must be an asynchronous DigitalSensor" in message) == ('wire."timer"', True)
    for kept in ({"on_error": "hold", "max_age": 1}, {"on_error": "mark"}):
        held = DigitalSensor("sampling_period", minimum=0, maximum=9, resolution=1, synchronous=False, **kept)
        assert "a held value would stop the clock" in one_fault(Odd(timer=held), None)[1]


@pytest.mark.parametrize("more", [{"resolution": 2}, {"zero_offset": 1}, {"filter": 1}, {"invalid_raws": [7]}])
def test_a_timer_counts_periods_and_no_scale_or_filter_changes_that(more: dict[str, Any]):
    odd = DigitalSensor("sampling_period", synchronous=False, **{"minimum": 0, "maximum": 9, "resolution": 1, **more})
    assert "timer counts missed periods: its resolution is 1" in one_fault(Law(timer=odd, motor=actuator()), None)[1]
    plain = Law(timer=timer(), motor=actuator())
    wired = simulated(plain, timer={"resolution": 0.5})
    assert one_fault(plain, wired)[0] == 'wire."timer"'


# Parameters ------------------------------------------------------------------------------------------


@dataclass
class Gains:
    kp: float = 1.0
    name: str = "pid"


class Servo(Compound):
    motor: DigitalActuator
    speed: float = 5.0
    label: str = "z"

    def setup(self):
        self.servo = Gains()


class Machine(Compound):
    z: Servo
    axes: list[Servo]
    limit: float = 1.0


def machine() -> Machine:
    return Machine(z=Servo(motor=actuator()), axes=[Servo(motor=actuator())])


def test_parameters_set_numbers_of_compounds_and_of_their_laws_while_connected():
    m = machine()
    wiring = simulated(m)
    wiring["parameters"] = {"z.speed": 7, "z.servo.kp": 0.02, "axes.0.servo.kp": 3.5, "limit": 2.0}
    with connect(m, wiring):
        assert (m.z.speed, m.z.servo.kp, m.axes[0].servo.kp, m.limit) == (7.0, 0.02, 3.5, 2.0)
    assert (m.z.speed, m.z.servo.kp, m.axes[0].servo.kp, m.limit) == (5.0, 1.0, 1.0, 1.0)


class Regulated(Compound):
    motor: DigitalActuator
    gain: float = 2.0

    def setup(self):
        self.law = Gains(kp=self.gain)


class Line(Compound):
    zones: list[Regulated]
    factor: float = 1.0

    def setup(self):
        self.gains = [self.factor * zone.law.kp for zone in self.zones]


def test_a_parameter_reaches_a_law_that_setup_makes_of_it():
    """The field changed, and the law kept the gain of the declaration."""
    m = Line(zones=[Regulated(motor=actuator()), Regulated(motor=actuator())])
    wiring = simulated(m)
    wiring["parameters"] = {"zones.1.gain": 9.0, "factor": 10.0}
    with connect(m, wiring):
        assert ([zone.law.kp for zone in m.zones], m.gains) == ([2.0, 9.0], [20.0, 90.0])
    assert (m.zones[1].gain, m.gains) == (2.0, [20.0, 90.0])  # what the run has left may be looked at
    with connect(m, simulated(m)):
        assert ([zone.law.kp for zone in m.zones], m.gains) == ([2.0, 2.0], [2.0, 2.0])


def test_a_parameter_of_a_law_outranks_the_field_that_setup_made_it_of():
    m = Line(zones=[Regulated(motor=actuator())])
    wiring = simulated(m)
    wiring["parameters"] = {"zones.0.law.kp": 5.0, "zones.0.gain": 9.0}
    with connect(m, wiring):
        assert (m.zones[0].gain, m.zones[0].law.kp) == (9.0, 5.0)


def test_without_parameters_of_fields_what_was_changed_after_the_declaration_stays():
    m = Line(zones=[Regulated(motor=actuator())])
    m.zones[0].law.kp = 7.0
    with connect(m, simulated(m)):
        assert m.zones[0].law.kp == 7.0


def test_a_whole_number_stays_one():
    class Counting(Compound):
        motors: dict[int, Servo]
        steps: int = 1600

    m = Counting(motors={0: Servo(motor=actuator())})
    wiring = simulated(m)
    wiring["parameters"] = {"steps": 400, "motors.0.speed": 2}
    with connect(m, wiring):
        assert (repr(m.steps), repr(m.motors[0].speed)) == ("400", "2.0")


class Dosing(Compound, numbers={"law.gain": Range("V/mm", 0.0, 3.0)}):
    motor: DigitalActuator
    target: Annotated[float, Range("g", 0.0, 900.0)] = 100.0
    count: Annotated[int, Range("ms", 0.0, 900.0)] = 1
    share: float = 0.5

    def setup(self):
        self.law = SimpleNamespace(gain=1.0)


def test_a_parameter_may_have_a_unit():
    m = Dosing(motor=actuator())
    wiring = simulated(m)
    wiring["parameters"] = {"target": "0.5 kg", "count": "0.4 s", "law.gain": "2000 V/m"}
    assert check(m, wiring) == []
    with connect(m, wiring):
        assert (m.target, repr(m.count), m.law.gain) == (500.0, "400", 2.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"target": "500"}, """'500' is not a number in g, or a string such as "1.5 g\""""),
        ({"target": "1 kg"}, "1000 g is outside 0 to 900"),
        ({"target": "1 mm"}, "'mm' cannot be converted to 'g'"),
        ({"target": "1 parsnip"}, "'parsnip' is not a unit that pint knows"),
        ({"count": "0.5 ms"}, "0.5 is not a whole number"),
        ({"share": "3 g"}, "'3 g' is not a number"),
    ],
)
def test_a_parameter_with_a_wrong_unit_or_value_is_named(parameters, message):
    m = Dosing(motor=actuator())
    assert message in one_fault(m, {**simulated(m), "parameters": parameters})[1]


def test_nested_parameters_are_the_same():
    m = machine()
    wiring = simulated(m)
    wiring["parameters"] = {"z": {"speed": 7, "servo": {"kp": 0.02}}}
    with connect(m, wiring):
        assert (m.z.speed, m.z.servo.kp) == (7.0, 0.02)


@pytest.mark.parametrize(
    "key",
    [
        "z.sped",
        "z.servo.kq",
        "z.motor.minimum",
        "z._parent",
        "z",
        "zz.speed",
        "",
        "axes.1.speed",
        "axes.-1.speed",
        "axes.x.speed",
        "z..speed",
        "period",
        "dt",
        "period.x",
        "z.period.x",
    ],
)
def test_an_unknown_parameter(key):
    wiring = simulated(machine())
    wiring["parameters"] = {key: 1.0}
    where, message = one_fault(machine(), wiring)
    assert (where, message.startswith("there is no such parameter")) == (f"parameters.{key!r}", True)


def test_an_unknown_parameter_names_the_nearest():
    wiring = simulated(machine())
    wiring["parameters"] = {"z.servo.kq": 1.0}
    assert "did you mean 'z.servo.kp'?" in one_fault(machine(), wiring)[1]


@pytest.mark.parametrize("value", ["fast", True, None, float("nan"), float("inf"), [1.0], 10**400])
def test_a_parameter_is_a_finite_number(value):
    wiring = simulated(machine())
    wiring["parameters"] = {"z.speed": value}
    assert "is not a number" in one_fault(machine(), wiring)[1]


# Files -----------------------------------------------------------------------------------------------


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text(text, encoding="utf-8")
    return path


QUOTED = """
[wire]
"z.motor" = { driver = "simulated", channel = "a" }
"axes.0.motor" = { driver = "simulated" }
"""
NESTED = """
[wire]
z.motor = { driver = "simulated", channel = "a" }
axes.0.motor = { driver = "simulated" }
"""
TABLES = """
[wire."z.motor"]
driver = "simulated"
channel = "a"

[wire.axes.0.motor]
driver = "simulated"
"""


@pytest.mark.parametrize("text", [QUOTED, NESTED, TABLES], ids=["quoted", "nested", "tables"])
def test_the_three_ways_to_write_a_line_are_the_same(tmp_path, text):
    wires = resolve(machine(), write(tmp_path, text)).wires
    assert [(wire.item.path, wire.channel.text) for wire in wires] == [
        ("z.motor", "a"),
        ("axes.0.motor", "axes.0.motor"),
    ]
    assert resolve(machine(), str(write(tmp_path, text))).wires


def test_one_object_wired_in_two_ways_is_wired_twice(tmp_path):
    text = QUOTED + '[wire.z]\nmotor = { driver = "simulated" }\n'
    assert one_fault(machine(), write(tmp_path, text)) == ('wire."z.motor"', "is wired twice")


def test_all_faults_in_one_run_each_with_file_and_key(tmp_path):
    text = """
    [driver.x]
    type = "simulated"
    [drivers.card]
    type = "simulated"
    histroy = 5
    [wire]
    "timer" = { driver = "simulated", period = "1 parsnip" }
    "motor" = { driver = "simulated", minimum = -20.0, chanel = "a" }
    "encoder" = { driver = "simulated", channel = "a", maximum = 200.0 }
    "valve" = { driver = "simulated", channel = "a" }
    "limitt" = { driver = "simulatd" }
    [parameters]
    "gain" = 1.0
    """
    path = write(tmp_path, text)
    found = check(bench(), path)
    assert {re.sub(r":\d+$", "", fault.file) for fault in found} == {str(path)}
    assert sorted(fault.key for fault in found) == sorted([
        "driver", "drivers.card.histroy", 'wire."timer".period', 'wire."motor".chanel', 'wire."encoder".maximum',
        'wire."valve"', 'wire."limit"', 'wire."limitt"', 'wire."limitt".driver', "parameters.'gain'",
    ])  # fmt: skip
    with pytest.raises(WiringError, match="10 errors in the wiring") as caught:
        connect(bench(), path).__enter__()
    assert all(str(fault) in str(caught.value) for fault in found)


def test_faults_come_in_the_same_order_every_time():
    wiring = simulated(bench(), **{f"x{i}": {} for i in range(9)})
    assert [key for key, _ in faults(bench(), wiring)] == [f'wire."x{i}"' for i in range(9)]


def test_an_unknown_section():
    wiring = simulated(bench()) | {"wires": {}}
    assert one_fault(bench(), wiring) == (
        "wires",
        "unknown section (did you mean 'wire'?); known: drivers, wire, parameters, process, faults, fault_seed, faces, "
        "record",
    )


@pytest.mark.parametrize("section", ["drivers", "wire", "parameters"])
@pytest.mark.parametrize("content", [5, "text", [1, 2], None])
def test_a_section_that_is_no_table(section, content):
    found = faults(bench(), simulated(bench()) | {section: content})
    assert found[0] == (section, f"must be a table, not {content!r}")


def test_a_missing_file_a_directory_broken_toml_and_broken_text(tmp_path):
    assert [f.message for f in check(bench(), tmp_path / "none.toml")] == ["no such file"]
    for path in (tmp_path, write(tmp_path, "[wire\n"), write(tmp_path, "a = 1\na = 2\n")):
        ((fault),) = check(bench(), path)
        assert fault.message.startswith("cannot be read") and str(path) in str(fault)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    assert check(bench(), tmp_path / "bytes.toml")[0].message.startswith("cannot be read")
    assert len(check(bench(), write(tmp_path, ""))) == 5  # nothing is wired


def test_checking_opens_nothing():
    box = Scripted()
    wiring = wired(bench(), box)
    assert faults(bench(), wiring) == []
    wiring["wire"]["moter"] = {"driver": "box"}
    with pytest.raises(WiringError):
        connect(bench(), wiring).__enter__()
    assert box.calls == []


# Anything at all -------------------------------------------------------------------------------------

KEYS = st.text(max_size=5) | st.sampled_from(
    ["drivers", "wire", "parameters", "motor", "z.motor", "timer", "type", "driver", "channel", "period", "timeout"]
)
LEAVES = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=3)
    | st.sampled_from(["simulated", "timerfd", "1 ms", "umo.testing:Scripted", "a:b", 10**400, -0.0, 1e-320])
)
TREES = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS | st.integers() | st.none(), inner, max_size=5),
    max_leaves=25,
)
ENTRIES = st.dictionaries(
    st.sampled_from(["driver", "channel", "period", "minimum", "maximum", "resolution", "zero_offset", "inverted"]),
    LEAVES,
    max_size=5,
)
WIRINGS = st.fixed_dictionaries(
    {},
    optional={
        "drivers": st.dictionaries(
            KEYS | st.integers(), st.dictionaries(KEYS | st.integers(), TREES, max_size=4), max_size=3
        )
        | TREES,
        "wire": st.dictionaries(st.sampled_from(["timer", "motor", "encoder", "valve", "limit"]), ENTRIES) | TREES,
        "parameters": TREES,
    },
)


@budget(60, 150)
@given(WIRINGS | st.dictionaries(KEYS | st.integers() | st.none(), TREES, max_size=4))
@example({"drivers": {5: {"type": "simulated"}}, "wire": {"motor": {"driver": "nobody"}}})
@example({"drivers": {"box": {"type": "simulated", 5: 1}}})
@example({"wire": {"motor": {"driver": "simulated", "resolution": 1e-320}}})
@example({"wire": {None: {"driver": "simulated"}, "timer": {"driver": "simulated", "period": "9**9**9 s"}}})
def test_no_dict_makes_anything_but_faults(wiring):
    for fault in check(bench(), wiring):
        assert str(fault)
    with contextlib.suppress(WiringError):
        resolve(bench(), wiring)


@budget(60, 150)
@given(
    st.text(max_size=60)
    | st.lists(
        st.sampled_from(
            ['"motor"', "=", "{", "}", 'driver = "simulated"', "[wire]", "\n", "[drivers.x]", "1" * 5000, "nan"]
        ),
        max_size=12,
    ).map("".join)
)
def test_no_text_makes_anything_but_faults(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    assert all(str(fault) for fault in check(bench(), path))


# [process] ------------------------------------------------------------------------------------------------


def process_of(table: dict[str, Any], period: str = "1 ms") -> Any:
    machine = bench()
    wiring = wired(machine, Scripted(), entries={"timer": {"period": period}})
    wiring["drivers"]["box"] = Scripted()
    return resolve(machine, wiring | {"process": table})


def test_the_limit_for_a_hang_is_20_periods_at_least_100_ms_and_above_all_timeouts_of_a_period() -> None:
    assert process_of({}).process.hang_timeout == 0.1
    assert process_of({}, "6 ms").process.hang_timeout == pytest.approx(1.2 * 0.126)
    assert process_of({"hang_timeout": "30 ms"}).process.hang_timeout == pytest.approx(0.03)


def test_a_limit_for_a_hang_that_a_period_may_spend_in_timeouts_is_a_fault() -> None:
    machine = bench()
    box = {"type": Scripted(), "timeout": "50 ms"}
    wiring = wired(machine, Scripted(), entries={"timer": {"driver": "timerfd", "period": "1 ms"}})
    wiring["drivers"]["box"] = box
    limit = resolve(machine, wiring).process.hang_timeout
    assert limit > 0.1  # one block to read, one to write
    with pytest.raises(WiringError, match="must be above"):
        resolve(machine, wiring | {"process": {"hang_timeout": "60 ms"}})


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"hang_timeout": "1 ms"}, "less than two periods"),
        ({"hang_timeout": "soon"}, "not a duration"),
        ({"reset_for": 0}, "is 0"),
        ({"priority": 99}, "whole number from 1 to 98"),
        ({"priority": True}, "whole number"),
        ({"cpu": -1}, "whole number"),
        ({"hang": "1 s"}, "did you mean 'hang_timeout'"),
        ({"busy_wait": "soon"}, 'neither "auto", nor a duration'),
        ({"busy_wait": "600 us"}, "more than half of the period"),
        ({"busy_wait": "-10 us"}, 'neither "auto", nor a duration'),
        ({"busy_wait": False}, 'neither "auto", nor a duration'),
        ({"busy_wait": "0"}, 'neither "auto", nor a duration'),
    ],
)
def test_a_process_table_that_makes_no_sense_is_a_fault(table: dict[str, Any], said: str) -> None:
    with pytest.raises(WiringError, match=said):
        process_of(table)


def test_a_process_with_a_period_of_100_us_may_wait_busily_for_all_of_it() -> None:
    assert process_of({"busy_wait": "100 us"}, "100 us").process.busy_wait == pytest.approx(100e-6)
    with pytest.raises(WiringError, match="101 µs is more than the period, 100 µs"):
        process_of({"busy_wait": "101 us"}, "100 us")
    with pytest.raises(WiringError, match="101 µs is more than half of the period, 200 µs"):
        process_of({"busy_wait": "101 us"}, "200 us")


@pytest.mark.parametrize(
    ("given", "busy_wait"),
    [
        ({}, None),
        ({"busy_wait": "auto"}, None),
        ({"busy_wait": 0}, 0.0),
        ({"busy_wait": "0 us"}, 0.0),
        ({"busy_wait": "120 us"}, pytest.approx(120e-6)),
    ],
)
def test_busy_waiting_lasts_a_given_time_or_the_default(given: dict[str, Any], busy_wait: float | None) -> None:
    assert process_of(given).process.busy_wait == busy_wait


def test_real_time_is_what_the_timers_driver_says() -> None:
    assert not process_of({}).realtime
    machine = bench()
    real = wired(machine, Scripted(), entries={"timer": {"driver": "timerfd"}})
    assert resolve(machine, real).realtime


@pytest.mark.parametrize("scale", [(0.5, "V"), 0.5])
def test_a_scale_of_a_circuit_that_is_none_is_a_mistake_of_its_channel(scale: Any) -> None:
    class Odd(Scripted, KnowsScale):
        def physical_scale(self, channel: Channel) -> Any:
            return scale

    found = faults(bench(), wired(bench(), Odd()))
    assert ('wire."motor".channel', f"its scale is {scale!r}, not a PhysicalScale") in found
