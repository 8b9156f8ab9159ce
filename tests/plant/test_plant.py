"""The plant of any station as Modbus boxes: a small press on two boxes, with other scales than its plant.

The counterparts are mbpoll (libmodbus) and pymodbus's client.
"""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import Result

from umo import BinaryActuator, BinarySensor, Compound, DigitalActuator, DigitalSensor
from umo.drivers import Reports
from umo.drivers.contract import Channel, Direction, Driver
from umo.drivers.modbus import Modbus
from umo.errors import ChannelError, DriverError, WiringError
from umo.plant.box import Box
from umo.plant.register_map import Point, RegisterMap, register_maps
from umo.plant.serve import serve, turn
from umo.plant.simulation import Simulation
from umo.states import OnOff, PassFail
from umo.wiring import resolve

PATIENT = 10.0
CHANNELS = {
    "dac:force": Channel("dac:force", Direction.OUTPUT, 12),
    "dio:clutch": Channel("dio:clutch", Direction.OUTPUT, 1),
    "dio:door": Channel("dio:door", Direction.INPUT, 1),
    "count:angle": Channel("count:angle", Direction.INPUT, 32, signed=True),
    "adc:oil": Channel("adc:oil", Direction.INPUT, 16, signed=True),
    "tick": Channel("tick", Direction.INPUT, 31),
}


class Plant(Driver, Reports):
    """A press: the angle goes on by 1000 counts in a period while the clutch is closed."""

    def __init__(self, *, oil: int = 400, fault: str = "") -> None:
        self.levels = {"dac:force": -1, "dio:clutch": -1, "dio:door": 1, "count:angle": -70_000, "adc:oil": oil}
        self.fault = fault
        self.ticks = 0
        self.reads: list[str] = []
        self.is_open = False

    def channel(self, text: str) -> Channel:
        if text not in CHANNELS:
            raise ChannelError(text, CHANNELS)
        return CHANNELS[text]

    def open(self) -> None:
        self.is_open = True

    def close(self) -> None:
        self.is_open = False

    def read(self, channel: Channel) -> int:
        if channel.text == "tick":
            self.ticks += 1
            if self.fault == "tick":
                raise ZeroDivisionError("the crank")
            self.levels["count:angle"] += 1000 * self.levels["dio:clutch"]
            return 0
        self.reads.append(channel.text)
        if self.fault == channel.text:
            raise ZeroDivisionError("the crank")
        return self.levels[channel.text]

    def write(self, channel: Channel, raw: int) -> None:
        self.levels[channel.text] = raw

    def report(self) -> dict[str, Any]:
        return {"strokes_done": self.levels["count:angle"] // 360_000}


class Press(Compound):
    force: DigitalActuator
    clutch: BinaryActuator[OnOff]
    door: BinarySensor[PassFail]
    angle: DigitalSensor
    oil: DigitalSensor
    timer: DigitalSensor


def press() -> Press:
    return Press(
        force=DigitalActuator("N", default=100.0, minimum=0.0, maximum=4000.0, resolution=1.0),
        clutch=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF),
        door=BinarySensor(PassFail, one=PassFail.FAIL),
        angle=DigitalSensor("deg", minimum=-3600.0, maximum=3600.0, resolution=0.001),
        oil=DigitalSensor("degC", minimum=-20.0, maximum=120.0, resolution=0.1),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )


def simulated(plant: Driver) -> dict[str, Any]:
    wire: dict[str, Any] = {
        "force": {"driver": "plant", "channel": "dac:force"},
        "clutch": {"driver": "plant", "channel": "dio:clutch", "inverted": True},
        "door": {"driver": "plant", "channel": "dio:door"},
        "angle": {"driver": "plant", "channel": "count:angle"},
        "oil": {"driver": "plant", "channel": "adc:oil"},
        "timer": {"driver": "plant", "channel": "tick", "period": "10 ms"},
    }
    return {"drivers": {"plant": plant}, "wire": wire}


def modbus(**changes: Any) -> dict[str, Any]:
    drive = {"type": "modbus", "port": 5021, "watchdog_register": 7, "watchdog": "300 ms"}
    inputs = {"type": "modbus", "port": 5022, "word_order": "little"}
    wire: dict[str, Any] = {
        "force": {"driver": "drive", "channel": "holding:3", "resolution": 0.5, "zero_offset": -1000.0},
        "clutch": {"driver": "drive", "channel": "coil:9"},
        "door": {"driver": "inputs", "channel": "coil:4", "inverted": True},
        "angle": {"driver": "inputs", "channel": "input:10:int32"},
        "oil": {"driver": "inputs", "channel": "holding:12:int16", "resolution": 0.01, "zero_offset": 50.0},
        "timer": {"driver": "timerfd", "period": "20 ms"},
    }
    wire |= changes.pop("wire", {})
    return {"drivers": {"drive": drive | changes.pop("drive", {}), "inputs": inputs | changes}, "wire": wire}


def maps(plant: Driver, **changes: Any) -> list[RegisterMap]:
    return register_maps(resolve(press(), simulated(plant)), resolve(press(), modbus(**changes)))


# The register map ---------------------------------------------------------------------------------


def points(plant: Driver) -> dict[str, Point]:
    return {point.path: point for each in maps(plant) for point in each.points}


def test_each_modbus_driver_is_a_box_with_its_address_its_objects_and_its_watchdog() -> None:
    drive, inputs = maps(Plant())
    assert (drive.name, drive.host, drive.port) == ("drive", "127.0.0.1", 5021)
    assert (drive.watchdog_register, drive.watchdog) == (7, 0.3)
    assert (inputs.name, inputs.port, inputs.watchdog_register, inputs.watchdog) == ("inputs", 5022, None, 0.0)
    found = {p.path: (p.table, p.address, p.cells, p.output) for p in drive.points + inputs.points}
    assert found == {
        "force": ("holding", 3, 1, True),
        "clutch": ("coil", 9, 1, True),
        "door": ("coil", 4, 1, False),
        "angle": ("input", 10, 2, False),
        "oil": ("holding", 12, 1, False),
    }


def test_outputs_have_the_default_of_their_object_on_either_side() -> None:
    found = points(Plant())
    assert (found["force"].default, found["force"].plant_default) == (2200, 100)
    assert (found["clutch"].default, found["clutch"].plant_default) == (0, 1)


def test_equal_scales_pass_raw_integers_unchanged_and_others_go_through_the_value() -> None:
    found = points(Plant())
    assert found["angle"].to_bus(-123_456) == -123_456
    assert found["oil"].to_bus(400) == -1000  # 40 degC
    assert found["door"].to_bus(1) == 0
    assert (found["clutch"].to_plant(1), found["clutch"].to_plant(0)) == (0, 1)
    assert found["force"].to_plant(2000 + 2 * 321) == 321


def test_a_linearization_of_either_side_and_an_invalid_reading_go_through_the_value() -> None:
    """The plant has a Pt100 behind a table, the box a transmitter in 0.01 degC that marks an open circuit."""
    plant, bus = simulated(Plant()), modbus()
    curve = {"table": [[80.0, 100.0, 138.5, 177.0], [-50.0, 0.0, 100.0, 200.0]]}  # ohm, degC
    plant["wire"]["oil"] |= {"resolution": 0.01, "zero_offset": 0.0, "linearization": curve, "invalid_raws": [0x7FFF]}
    bus["wire"]["oil"] |= {"zero_offset": 0.0, "invalid_raws": [-32768]}
    found = {p.path: p for each in register_maps(resolve(press(), plant), resolve(press(), bus)) for p in each.points}
    assert found["oil"].to_bus(10_000) == 0
    assert found["oil"].to_bus(13_850) == 10_000  # 138.5 ohm, 100 degC
    assert found["oil"].to_bus(0x7FFF) == -32768
    bus["wire"]["oil"] |= {"resolution": 0.01, "linearization": curve}
    found = {p.path: p for each in register_maps(resolve(press(), plant), resolve(press(), bus)) for p in each.points}
    assert found["oil"].to_bus(9_000) == 9_000


@given(st.integers(-(2**31), 2**31 - 1))
def test_words_hold_every_raw_integer_of_32_bits_in_the_order_of_the_driver(raw: int) -> None:
    angle = points(Plant())["angle"]
    words = angle.words(raw)
    assert words == [raw & 0xFFFF, raw >> 16 & 0xFFFF]  # word_order = "little"
    assert angle.raw(words) == raw


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drive": {"port": 5022}}, r"drivers drive and inputs have one address, 127.0.0.1:5022"),
        ({"drive": {"watchdog_register": 3}}, r"register 3 of drive is used twice: for the watchdog and for force"),
        (
            {"wire": {"clutch": {"driver": "drive", "channel": "holding:3"}}},
            r"channel 'holding:3' of drive is already used by force",
        ),
        ({"wire": {"colour": {"driver": "drive", "channel": "coil:8"}}}, r"the machine has no such object"),
    ],
)  # fmt: skip
def test_what_cannot_be_served_is_said(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(WiringError, match=message):
        maps(Plant(), **changes)


def test_a_plant_is_a_simulation_with_a_timer_in_virtual_time() -> None:
    class Card(Plant):
        def devices(self) -> list[str]:
            return ["card 1"]

    bus = resolve(press(), modbus())
    for given_, options, message in (
        (simulated(Card()), {"realtime": True}, r"its driver plant controls card 1"),
        (simulated(Plant()), {"realtime": True}, r"a real-time timer instead of the plant's"),
        (modbus(), {}, r"its driver drive controls modbus tcp 127.0.0.1:5021"),
    ):
        with pytest.raises(WiringError, match=message):
            register_maps(resolve(press(), given_, options), bus)
    with pytest.raises(WiringError, match="has no modbus driver"):
        register_maps(resolve(press(), simulated(Plant())), resolve(press(), simulated(Plant())))


def test_a_machine_without_a_timer_is_refused() -> None:
    class Lamp(Compound):
        lamp: BinaryActuator[OnOff]

    lamp = Lamp(lamp=BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF))
    bus = {"wire": {"lamp": {"driver": "modbus", "channel": "coil:0"}}}
    with pytest.raises(WiringError, match="no time can pass in the plant: the machine has no object `timer`"):
        register_maps(resolve(lamp, None), resolve(lamp, bus))


# The boxes, with time in the test's client ----------------------------------------------------------


class Bench:
    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.now = 0.0
        resolved = resolve(press(), simulated(plant))
        self.simulation = Simulation(resolved, lambda: self.now)
        self.drive, self.inputs = (Box(self.simulation, each) for each in maps(plant))
        self.simulation.__enter__()

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now += 0.0100001
            turn(self.simulation, [self.drive, self.inputs])


def words(*given_: int) -> bytes:
    return b"".join(word.to_bytes(2, "big") for word in given_)


def test_an_object_of_32_bits_is_read_once_and_a_half_of_it_too() -> None:
    bench = Bench(Plant())
    low, high = -70_000 & 0xFFFF, -70_000 >> 16 & 0xFFFF
    assert bench.inputs.request(b"\x04" + words(10, 2)) == b"\x04\x04" + words(low, high)
    assert bench.plant.reads == ["count:angle"]
    assert bench.inputs.request(b"\x04" + words(11, 1)) == b"\x04\x02" + words(high)


def test_a_sensor_in_a_table_of_outputs_cannot_be_written() -> None:
    bench = Bench(Plant())
    assert bench.inputs.request(b"\x05" + words(4, 0xFF00)) == b"\x85\x02"
    assert bench.inputs.request(b"\x06" + words(12, 1)) == b"\x86\x02"


def test_a_reading_that_does_not_fit_its_register_is_a_device_failure() -> None:
    bench = Bench(Plant())
    bench.plant.levels["adc:oil"] = 5000  # 500 degC
    assert bench.inputs.request(b"\x03" + words(12, 1)) == b"\x83\x04"


def test_half_of_a_32_bit_output_is_not_written() -> None:
    class Wide(Plant):
        def channel(self, text: str) -> Channel:
            return Channel(text, Direction.OUTPUT, 32, signed=True) if text == "wide" else CHANNELS[text]

    plant = Wide()
    given_ = simulated(plant)
    given_["wire"]["force"]["channel"] = "wide"
    bus = modbus(wire={"force": {"driver": "drive", "channel": "holding:20:int32"}})
    resolved = resolve(press(), given_)
    simulation = Simulation(resolved, lambda: 0.0)
    drive = Box(simulation, register_maps(resolved, resolve(press(), bus))[0])
    with simulation:
        for address in (20, 21):
            assert drive.request(b"\x06" + words(address, 1)) == b"\x86\x02"
        assert drive.request(b"\x10" + words(20, 1) + b"\x02" + words(1)) == b"\x90\x02"
        assert drive.request(b"\x10" + words(20, 2) + b"\x04" + words(1, 2)) == b"\x10" + words(20, 2)
        assert plant.levels["wide"] == 0x10002
    assert plant.levels["wide"] == 100


FIELDS = {
    "force": {"driver": "drive", "channel": "holding:31:BA.15:4"},
    "clutch": {"driver": "drive", "channel": "holding:30.4"},
    "door": {"driver": "drive", "channel": "holding:30.9"},
    "angle": {"driver": "inputs", "channel": "input:10:int32:BADC"},
}


def test_fields_of_one_register_are_read_and_written_together_and_inputs_among_them_stay() -> None:
    plant = Plant()
    given_ = simulated(plant)
    resolved = resolve(press(), given_)
    simulation = Simulation(resolved, lambda: 0.0)
    drive, inputs = (Box(simulation, each) for each in register_maps(resolved, resolve(press(), modbus(wire=FIELDS))))
    with simulation:
        assert drive.request(b"\x03" + words(30, 1)) == b"\x03\x02" + words(0x0200)
        assert drive.request(b"\x06" + words(30, 0xFDFF)) == b"\x06" + words(30, 0xFDFF)
        assert (plant.levels["dio:clutch"], plant.levels["dio:door"]) == (0, 1)
        assert drive.request(b"\x03" + words(30, 1)) == b"\x03\x02" + words(0x0210)
        assert drive.request(b"\x16" + words(30, 0xFFEF, 0)) == b"\x16" + words(30, 0xFFEF, 0)
        assert plant.levels["dio:clutch"] == 1
        assert drive.request(b"\x16" + words(30, 0)) == b"\x96\x03"
        assert drive.request(b"\x06" + words(31, 0x3412)) == b"\x06" + words(31, 0x3412)  # the field is 0x123
        assert plant.levels["dac:force"] == 0x123
        assert inputs.request(b"\x04" + words(10, 2)) == b"\x04\x04" + words(0xFEFF, 0x90EE)


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_the_box_has_the_words_of_the_driver_for_every_type_order_and_field(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["uint16", "int16", "uint32", "int32", "int64", "uint64", "float32:0.5"]))
    order = data.draw(st.sampled_from(["AB", "BA"] if kind.endswith("16") else ["ABCD", "CDAB", "BADC", "DCBA"]))
    low = data.draw(st.integers(0, 10))
    field = "" if "float" in kind else data.draw(st.sampled_from(["", f".{low + data.draw(st.integers(1, 5))}:{low}"]))
    text = f"holding:20:{kind}:{order}{field}"
    channel = Modbus().channel(text)
    machine = Lever(
        lever=DigitalActuator("count", default=0, minimum=0, maximum=1, resolution=1),
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99_999, resolution=1, synchronous=False),
    )
    bus = {
        "drivers": {"box": {"type": "modbus"}},
        "wire": {"lever": {"driver": "box", "channel": text}, "timer": TIMER},
    }
    ((point,),) = (each.points for each in register_maps(resolve(machine, None), resolve(machine, bus)))
    raw = data.draw(st.integers(channel.lowest, channel.highest))
    assert point.words(raw) == channel.words(raw)
    assert point.raw(channel.words(raw)) == raw


class Lever(Compound):
    lever: DigitalActuator
    timer: DigitalSensor


TIMER = {"driver": "timerfd", "period": "20 ms"}


def test_each_box_has_a_watchdog_of_its_own() -> None:
    bench = Bench(Plant())
    bench.drive.request(b"\x05" + words(9, 0xFF00))
    bench.drive.request(b"\x06" + words(3, 3000))
    assert (bench.plant.levels["dio:clutch"], bench.plant.levels["dac:force"]) == (0, 500)
    for _ in range(4):
        bench.wait(0.1)
        bench.inputs.request(b"\x04" + words(10, 2))
    assert (bench.plant.levels["dio:clutch"], bench.plant.levels["dac:force"]) == (1, 100)
    assert bench.drive.request(b"\x03" + words(3, 1)) == b"\x03\x02" + words(2200)
    assert (bench.drive.watchdog.drops, bench.inputs.watchdog.drops) == (1, 0)


def test_a_mistake_in_the_plants_code_ends_the_service_with_it() -> None:
    bench = Bench(Plant(fault="adc:oil"))
    assert bench.inputs.request(b"\x03" + words(12, 1)) == b"\x83\x04"
    with pytest.raises(ZeroDivisionError, match="the crank"):
        bench.wait(0.01)
    ticking = Bench(Plant(fault="tick"))
    with pytest.raises(ZeroDivisionError, match="the crank"):
        ticking.wait(0.01)


def test_a_plant_that_cannot_be_initialised_or_closed_is_a_driver_error() -> None:
    class Stuck(Plant):
        def initialize(self, channel: Channel, default: int | None) -> None:
            raise OSError("no power")

    class Jammed(Plant):
        def close(self) -> None:
            raise OSError("jammed")

    stuck = Stuck()
    with pytest.raises(DriverError, match=r"the plant could not be initialised: plant: no power"):
        Simulation(resolve(press(), simulated(stuck)), lambda: 0.0).__enter__()
    assert not stuck.is_open
    with (
        pytest.raises(DriverError, match="could not be closed"),
        Simulation(resolve(press(), simulated(Jammed())), lambda: 0.0),
    ):
        pass


# Over the network ---------------------------------------------------------------------------------


@contextmanager
def served(plant: Plant) -> Iterator[dict[str, int]]:
    """Serve both boxes from a thread; their ports by name."""
    ports: dict[str, int] = {}
    ends: list[Callable[[], object]] = []
    ready = threading.Event()

    async def main() -> None:
        stop, loop = asyncio.Event(), asyncio.get_running_loop()
        ends.append(lambda: loop.call_soon_threadsafe(stop.set))

        def at(name: str, host: str, port: int) -> None:
            ports[name] = port
            if len(ports) == 2:
                ready.set()

        boxes = [replace(each, port=0, watchdog=0.0) for each in maps(plant)]
        await serve(resolve(press(), simulated(plant)), boxes, stop=stop, ready=at)

    thread = threading.Thread(target=asyncio.run, args=[main()])
    thread.start()
    try:
        assert ready.wait(PATIENT)
        yield ports
    finally:
        ends[0]()
        thread.join(PATIENT)
    assert not thread.is_alive()
    assert not plant.is_open


def test_pymodbus_meets_both_boxes() -> None:
    client_of = pytest.importorskip("pymodbus.client").ModbusTcpClient
    plant = Plant()
    with served(plant) as ports:
        clients = drive, inputs = [client_of("127.0.0.1", port=ports[name]) for name in ("drive", "inputs")]
        try:
            assert all(client.connect() for client in clients)
            assert drive.read_holding_registers(3, count=1).registers == [2200]
            assert drive.read_coils(9, count=1).bits[0] is False
            assert not drive.write_coil(9, True).isError()  # the clutch closes: its plant level is 0, the angle stands
            assert not drive.write_register(3, 2600).isError()
            assert (plant.levels["dio:clutch"], plant.levels["dac:force"]) == (0, 300)
            angle = inputs.read_input_registers(10, count=2).registers
            assert inputs.convert_from_registers(angle, inputs.DATATYPE.INT32, "little") == plant.levels["count:angle"]
            (oil,) = inputs.read_holding_registers(12, count=1).registers
            assert oil - 65536 == -1000
            assert inputs.read_coils(4, count=1).bits[0] is False
            assert drive.read_coils(8, count=2).exception_code == 2
            assert drive.write_register(3, 0).exception_code == 3
            assert drive.read_holding_registers(7, count=1).registers == [0]
        finally:
            for client in clients:
                client.close()


def test_mbpoll_meets_both_boxes() -> None:
    program = shutil.which("mbpoll")
    if program is None:
        pytest.skip("this needs Debian's mbpoll")

    def poll(name: str, *arguments: str) -> list[int]:
        command = [program, "-m", "tcp", "-p", str(ports[name]), "-0", "-1", "-o", "10", *arguments]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
        return [int(value) for value in re.findall(r"^\[\d+\]:\s+(-?\d+)", ended.stdout, re.MULTILINE)]

    plant = Plant()
    with served(plant) as ports:
        poll("drive", "-t", "0", "-r", "9", "127.0.0.1", "1")
        poll("drive", "-t", "4", "-r", "3", "127.0.0.1", "2040")
        assert (plant.levels["dio:clutch"], plant.levels["dac:force"]) == (0, 20)
        assert poll("inputs", "-t", "3:int", "-r", "10", "-c", "1", "127.0.0.1") == [plant.levels["count:angle"]]
        assert poll("inputs", "-t", "0", "-r", "4", "127.0.0.1") == [0]


# The command --------------------------------------------------------------------------------------


def said(result: Result) -> str:
    return " ".join((result.stdout + result.stderr).split())


def change(file: Path, before: str, after: str) -> None:
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after))


SECOND = '\n[drivers.second]\ntype = "modbus"\nport = 5021\n'


def test_the_options_of_the_plant_are_shown_without_those_of_the_application(
    umo: Callable[..., Result], tank: Path
) -> None:
    result = umo("device", "plant", "tank", "--help")
    assert result.exit_code == 0
    assert "--leak" in said(result)
    assert "--plant-wiring" in said(result)
    assert "--target" not in said(result)


@pytest.mark.parametrize(
    ("words_", "message"),
    [
        (["--leek", "3"], "tank has no option --leek (did you mean 'leak'?); it has: --level, --leak"),
        (["--target", "3"], "tank has no option --target"),
        (["-w", "simulated"], "the wiring to serve has no modbus driver (plant: "),
        (["--plant-wiring", "modbus"], "not a simulation: its driver box controls modbus tcp 127.0.0.1:5020 (plant: "),
        (["-w", "modbuss"], "no wiring 'modbuss' (did you mean 'modbus'?); tank has: simulated, modbus"),
    ],
)
def test_a_mistake_is_a_line_and_status_2(
    umo: Callable[..., Result], tank: Path, words_: list[str], message: str
) -> None:
    result = umo("device", "plant", "tank", *words_)
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert message in said(result)


def test_the_only_modbus_wiring_is_found_whatever_its_name(umo: Callable[..., Result], tank: Path) -> None:
    wiring = tank / "wiring"
    (wiring / "modbus.toml").rename(wiring / "bench.toml")
    assert "the watchdog takes 0" in said(umo("device", "plant", "tank", "--watchdog", "99"))  # found, and then refused
    shutil.copy(wiring / "bench.toml", wiring / "line.toml")
    assert "tank has several Modbus wirings: choose one with -w: bench, line" in said(umo("device", "plant", "tank"))
    (wiring / "simulated.toml").unlink()
    assert "umo: tank has no plant: none of its wirings is simulated; write wiring/simulated" in said(
        umo("device", "plant", "tank", "-w", "line")
    )
    (wiring / "bench.toml").unlink()
    (wiring / "line.toml").unlink()
    result = umo("device", "plant", "tank")
    assert result.exit_code == 2
    assert "tank has no Modbus wiring: write wiring/modbus.toml" in said(result)


def test_host_and_port_are_for_one_box(umo: Callable[..., Result], tank: Path) -> None:
    file = tank / "wiring" / "modbus.toml"
    change(file, "[wire]", f"{SECOND}\n[wire]")
    result = umo("device", "plant", "tank", "--port", "0")
    assert result.exit_code == 2
    assert "--host and --port need a wiring with one box; this wiring has 2: box, second" in said(result)


def test_an_exception_of_the_plant_is_a_line_with_its_place(umo: Callable[..., Result], tank: Path) -> None:
    change(tank / "plant.py", "            self.advance(self.period)", "            1 / 0")
    result = umo("device", "plant", "tank", "--port", "0")
    assert result.exit_code == 1
    assert "ZeroDivisionError: division by zero (tank/plant.py:" in said(result)
    assert "plant.py:" in said(result)
    assert "Traceback" not in said(result)


@pytest.mark.full
@pytest.mark.slow
def test_a_new_station_runs_on_its_own_plant_over_modbus(umo: Callable[..., Result], tank: Path) -> None:
    """As a newcomer does it: `umo device plant` in one terminal, `umo run -w modbus` in another."""
    pytest.importorskip("pymodbus")
    change(tank / "application.py", "20 s", "200 ms")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    change(tank / "wiring" / "modbus.toml", "5020", str(port))
    change(tank / "wiring" / "modbus.toml", '"200 ms"', '"2 s"')  # what a busy computer does is not tested here
    report = tank / "report.json"
    command = [sys.executable, "-c", "from umo_command import main; main()", "device", "plant", str(tank)]
    boxed = subprocess.Popen([*command, "--level", "45", "--out", str(report)], stdout=subprocess.PIPE, text=True)
    try:
        assert boxed.stdout is not None
        assert boxed.stdout.readline() == f"tank plant, box: Modbus TCP at 127.0.0.1:{port}\n"
        ran = umo("run", "tank", "-w", "modbus", "--target", "55", "--no-record", "--no-plot")
        assert ran.exit_code == 0, said(ran)
        boxed.send_signal(signal.SIGTERM)
        last = boxed.communicate(timeout=30)[0]
    finally:
        boxed.kill()
        boxed.communicate()
    found = json.loads(report.read_text())
    assert found["requests"] > 20
    assert last.startswith(f"requests {found['requests']}, watchdog drops ")


@pytest.mark.parametrize("word_order", ["big", "little"])
@pytest.mark.parametrize("kind", ["int64", "float32:0.1", "float64:0.1"])
def test_a_box_packs_wide_registers_and_floats_as_the_driver_reads_them(kind: str, word_order: str) -> None:
    changes = {"word_order": word_order, "wire": {"angle": {"driver": "inputs", "channel": f"input:10:{kind}"}}}
    (point,) = (p for each in maps(Plant(), **changes) for p in each.points if p.path == "angle")
    channel = Modbus(word_order=word_order).channel(f"input:10:{kind}")
    for raw in (0, 1, 12_345, channel.highest & 2**62 - 1, channel.lowest):
        assert channel.raw(point.words(raw)) == raw
        assert point.raw(channel.words(raw)) == raw


def test_a_serial_line_cannot_be_served() -> None:
    wiring = modbus()
    del wiring["drivers"]["drive"]["port"]
    wiring["drivers"]["drive"]["serial"] = "/dev/ttyS0"
    with pytest.raises(WiringError, match="driver drive is on a serial line; a box serves Modbus TCP"):
        register_maps(resolve(press(), simulated(Plant())), resolve(press(), wiring))
