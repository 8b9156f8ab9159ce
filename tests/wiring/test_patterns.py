"""Patterns in wirings: one line for many like objects, checked as strictly as single entries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import actuator, relay, sensor, timer
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor, check, connect
from umo.drivers import Channel, Direction, Driver
from umo.errors import ChannelError
from umo.objects.paths import matches
from umo.states import OnOff
from umo.wiring import resolve
from umo.wiring.patterns import places_below


class Zone(Compound):
    heater: DigitalActuator
    temperature: DigitalSensor
    fan: BinaryActuator[OnOff]
    gain: float = 1.0

    def setup(self) -> None:
        self.law = self.gain


class Tunnel(Compound):
    timer: DigitalSensor
    zones: list[Zone]
    doors: dict[str, BinaryActuator[OnOff]]


def tunnel(count: int = 3) -> Tunnel:
    zones = [Zone(heater=actuator(), temperature=sensor(), fan=relay()) for _ in range(count)]
    return Tunnel(timer=timer(), zones=zones, doors={"in": relay(), "out": relay()})


class Registers(Driver):
    """Forty registers of 32 bits."""

    def channel(self, text: str) -> Channel:
        if text not in {f"register:{n}" for n in range(40)}:
            raise ChannelError(text, ["register:0"])
        return Channel(text, Direction.BOTH, 32, signed=True)

    def read(self, channel: Channel) -> int:
        return 0

    def write(self, channel: Channel, raw: int) -> None: ...


def wiring(changes: dict[str, Any] | None = None, **parameters: Any) -> dict[str, Any]:
    wire: dict[str, Any] = {
        "timer": {"driver": "simulated", "period": "1 ms"},
        "zones.*.heater": {"driver": "box", "channel": "register:{}", "stride": 3},
        "zones.*.temperature": {"driver": "box", "channel": "register:{}", "stride": 3, "offset": 1},
        "zones.*.fan": {"driver": "box", "channel": "register:{}", "start": 10, "stride": 2},
        "doors.*": {"driver": "simulated"},
    }
    drivers = {"box": {"type": f"{__name__}:Registers"}}
    return {"drivers": drivers, "wire": wire | (changes or {}), "parameters": parameters}


def channels(changes: dict[str, Any] | None = None) -> dict[str, str]:
    return {wire.item.path: wire.channel.text for wire in resolve(tunnel(), wiring(changes)).wires}


def faults(changes: dict[str, Any] | None = None, **parameters: Any) -> list[tuple[str, str]]:
    return [(fault.key, fault.message) for fault in check(tunnel(), wiring(changes, **parameters))]


def test_a_pattern_wires_every_object_that_matches_with_its_number() -> None:
    found = channels()
    assert [found[f"zones.{i}.heater"] for i in range(3)] == ["register:0", "register:3", "register:6"]
    assert [found[f"zones.{i}.temperature"] for i in range(3)] == ["register:1", "register:4", "register:7"]
    assert [found[f"zones.{i}.fan"] for i in range(3)] == ["register:20", "register:22", "register:24"]
    assert (found["doors.in"], found["doors.out"]) == ("doors.in", "doors.out")


def test_a_single_entry_outranks_a_pattern_and_the_others_keep_their_numbers() -> None:
    found = channels({"zones.1.heater": {"driver": "simulated"}})
    assert [found[f"zones.{i}.heater"] for i in range(3)] == ["register:0", "zones.1.heater", "register:6"]


def test_a_pattern_of_a_file_is_the_same(tmp_path: Path) -> None:
    file = tmp_path / "box.toml"
    file.write_text(
        "[wire]\n"
        'timer = { driver = "simulated", period = "1 ms" }\n'
        '"doors.*" = { driver = "simulated" }\n'
        '[wire."zones.*"]\n'
        'heater = { driver = "simulated" }\n'
        'fan = { driver = "simulated", inverted = true }\n'
        'temperature = { driver = "simulated", resolution = 0.5 }\n'
        "[parameters]\n"
        '"zones.*.gain" = 2.0\n'
    )
    assert check(tunnel(), file) == []
    with connect(tunnel(), file) as m:
        assert [zone.temperature.resolution for zone in m.zones] == [0.5] * 3
        assert [zone.law for zone in m.zones] == [2.0] * 3


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ({"zones.*.heatre": {"driver": "box"}}, "zones.*.heatre", "no object of the machine matches (did you mean"),
        ({"*.heater": {"driver": "box"}}, "*.heater", "no object of the machine matches"),
        (
            {"zones.1.fan": {"driver": "simulated", "start": 1}},
            "zones.1.fan",
            "can only be used with patterns such as 'zones.*.fan'",
        ),
        (
            {"doors.*": {"driver": "simulated", "stride": 2}},
            "doors.*",
            "has no effect, because the channel contains no {}",
        ),
        ({"*.in": {"driver": "simulated"}}, "*.in", "doors.in is wired by 'doors.*' as well"),
        ({"zones.*.fan": {"driver": "box", "channel": "register:{}", "start": 1.5}}, "zones.*.fan", "a whole number"),
    ],
)
def test_what_is_wrong_with_a_pattern_is_named(changes: dict[str, Any], key: str, message: str) -> None:
    found = faults(changes)
    where, text = next(each for each in found if each[0].startswith(f'wire."{key}"'))
    assert message in text, where


def test_many_faults_of_one_pattern_are_one() -> None:
    found = faults({"zones.*.fan": {"driver": "box", "channel": "register:{}", "offset": 38, "minimum": 0.0}})
    assert found == [
        (
            'wire."zones.*.fan".channel',
            "zones.2.fan: there is no channel 'register:40' (did you mean 'register:0'?); the forms are: register:0",
        ),
        ('wire."zones.*.fan".minimum', "zones.0.fan: is for digital objects; this one is binary (and 1 more)"),
    ]


def test_two_patterns_on_one_place_of_a_circuit_are_refused() -> None:
    found = faults({"zones.*.temperature": {"driver": "box", "channel": "register:{}", "stride": 3}})
    assert found == [
        (
            'wire."zones.*.temperature"',
            "zones.0.temperature: channel 'register:0' of box is already used by zones.0.heater (and 2 more)",
        )
    ]


def test_parameters_take_patterns_which_single_names_outrank() -> None:
    with connect(tunnel(), wiring(**{"zones.*.gain": 2.0, "zones.1.gain": 5.0})) as m:
        assert [zone.law for zone in m.zones] == [2.0, 5.0, 2.0]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"zones.*.gian": 2.0}, "there is no such parameter (did you mean 'zones.*.gain'?)"),
        ({"zones.*.gain": 2.0, "*.0.gain": 3.0}, "zones.0.gain is set by 'zones.*.gain' as well"),
        ({"zones.*.gain": "high"}, "'high' is not a number"),
    ],
)
def test_what_is_wrong_with_a_pattern_of_parameters_is_named(parameters: dict[str, Any], message: str) -> None:
    assert any(message in text for _, text in faults(**parameters))


@pytest.mark.parametrize("entry", [{"driver": "box", "chanel": "register:1"}, "box"])
def test_a_faulty_pattern_is_one_fault_and_its_objects_are_not_reported_as_not_wired(entry: Any) -> None:
    found = faults({"zones.*.fan": entry})
    assert [key.partition('".')[0].rstrip('"') for key, _ in found] == ['wire."zones.*.fan']


def test_a_faulty_single_entry_outranks_a_pattern() -> None:
    assert [key for key, _ in faults({"zones.1.heater": {"driver": "box", "chanel": "register:1"}})] == [
        'wire."zones.1.heater".chanel'
    ]


def test_patterns_that_overlap_are_one_fault_for_each_pair() -> None:
    assert faults({"*.0.fan": {"driver": "simulated"}, "zones.*.*": {"driver": "simulated"}}) == [
        ('wire."*.0.fan"', "zones.0.fan is wired by 'zones.*.fan' as well"),
        ('wire."zones.*.*"', "zones.0.heater is wired by 'zones.*.heater' as well (and 2 more)"),
        ('wire."zones.*.*"', "zones.0.temperature is wired by 'zones.*.temperature' as well (and 2 more)"),
        ('wire."zones.*.*"', "zones.0.fan is wired by 'zones.*.fan' as well (and 2 more)"),
    ]


def test_patterns_of_parameters_are_checked_once() -> None:
    assert faults(**{"zones.*.gain": "high"}) == [("parameters.'zones.*.gain'", "'high' is not a number (and 2 more)")]
    assert faults(**{"zones.*.gain": 1.0, "*.*.gain": 2.0}) == [
        ("parameters.'*.*.gain'", "zones.0.gain is set by 'zones.*.gain' as well (and 2 more)")
    ]


def test_parameters_of_single_names_outrank_patterns_that_overlap() -> None:
    singles = {f"zones.{i}.gain": 5.0 for i in range(3)}
    assert faults(**{"zones.*.gain": 1.0, "*.*.gain": 2.0, **singles}) == []


NAMES = st.sampled_from(["z", "0", "12", "motor", "*"])


@given(st.lists(NAMES, min_size=1, max_size=4), st.lists(NAMES, min_size=1, max_size=4))
def test_a_star_stands_for_one_part_of_a_path(pattern: list[str], path: list[str]) -> None:
    fits = len(pattern) == len(path) and all(a in ("*", b) for a, b in zip(pattern, path, strict=False))
    assert matches(".".join(pattern), ".".join(path)) is fits


PARTS = st.sampled_from(["a", "ab", "0", "10", "a+", "*x"])
PATHS = st.lists(PARTS, min_size=1, max_size=4).map(".".join)


@given(st.lists(PATHS, max_size=20), st.lists(PARTS | st.just("*"), min_size=1, max_size=4).map(".".join))
def test_a_path_or_pattern_names_what_is_there_and_below_it(names: list[str], path: str) -> None:
    depth = path.count(".") + 1
    cut = [".".join(name.split(".")[:depth]) for name in names]
    assert places_below(path, names) == [place for place, name in enumerate(cut) if matches(path, name)]
