"""`umo show parts` and `umo device drivers NAME`: what a machine and a driver are made of."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import Result

Umo = Callable[..., Result]

OBJECTS = """
from umo import BinaryActuator, Compound, DigitalActuator, DigitalSensor
from umo.states import OnOff


class Zone(Compound):
    heaters: tuple[DigitalActuator, ...]
    temperature: DigitalSensor


class Furnace(Compound):
    zones: tuple[Zone, ...]
    fans: dict[str, BinaryActuator[OnOff]]
    timer: DigitalSensor


def zone(highest: float) -> Zone:
    heater = lambda: DigitalActuator("V", default=0.0, minimum=0.0, maximum=10.0, resolution=0.01)
    return Zone(
        heaters=tuple(heater() for _ in range(3)),
        temperature=DigitalSensor("degC", minimum=0.0, maximum=highest, resolution=0.1),
    )


def machine() -> Furnace:
    return Furnace(
        zones=tuple(zone(1300.0 if number == 4 else 900.0) for number in range(COUNT)),
        fans={name: BinaryActuator(OnOff, one=OnOff.ON, default=OnOff.OFF) for name in ("left", "right")},
        timer=DigitalSensor("sampling_period", minimum=0, maximum=99, resolution=1, synchronous=False),
    )
"""
WIRING = """
[wire]
"zones.*.heaters.*" = { driver = "simulated", channel = "dac:{}" }
"zones.*.temperature" = { driver = "simulated", channel = "adc:{}" }
"fans.*" = { driver = "simulated" }
"timer" = { driver = "simulated", period = "1 ms" }
"""


@pytest.fixture
def furnace(umo: Umo, tmp_path: Path) -> Path:
    folder = tmp_path / "furnace"
    (folder / "wiring").mkdir(parents=True)
    (folder / "wiring" / "simulated.toml").write_text(WIRING)
    return made(folder, 9)


def made(folder: Path, count: int) -> Path:
    (folder / "objects.py").write_text(OBJECTS.replace("COUNT", str(count)))
    return folder


def lines(result: Result) -> list[str]:
    assert result.exit_code == 0, result.stderr
    shown = (line.strip("│├└─ ") for line in result.stdout.splitlines())
    return [line for line in shown if not line.startswith("files of ")]


def test_like_members_of_a_list_are_shown_once_and_those_that_differ_by_themselves(umo: Umo, furnace: Path) -> None:
    made(furnace, 1000)
    heater = "3 x digital actuator, 0 to 10 V by 0.01, default 0 V"
    assert lines(umo("show", "parts", "furnace")) == [
        "Furnace  simulated",
        "zones[0..3, 5..999]  999 x Zone",
        f"heaters[0..2]  {heater}  simulated:dac:0 .. simulated:dac:2999",
        "temperature  digital sensor, 0 to 900 °C by 0.1  simulated:adc:0 .. simulated:adc:999",
        "zones.4  Zone",
        f"heaters[0..2]  {heater}  simulated:dac:12 .. simulated:dac:14",
        "temperature  digital sensor, 0 to 1300 °C by 0.1  simulated:adc:4",
        "fans.left  binary actuator, ON=1 OFF=0, default OFF  simulated:fans.left",
        "fans.right  binary actuator, ON=1 OFF=0, default OFF  simulated:fans.right",
        "timer  digital sensor, 0 to 99 by 1, asynchronous  simulated:timer",
    ]


def test_all_shows_every_member(umo: Umo, furnace: Path) -> None:
    made(furnace, 5)
    found = lines(umo("show", "parts", "furnace", "--all"))
    assert len(found) == 1 + 5 * (1 + 3 + 1) + 2 + 1
    assert sum(line.startswith("zones.") for line in found) == 5


def test_another_driver_or_an_inversion_is_a_difference(umo: Umo, furnace: Path) -> None:
    made(furnace, 9)
    wiring = furnace / "wiring" / "simulated.toml"
    wiring.write_text(wiring.read_text() + '"zones.7.temperature" = { driver = "simulated", channel = "adc:x" }\n')
    assert [line for line in lines(umo("show", "parts", "furnace")) if line.startswith("zones")] == [
        "zones[0..3, 5..6, 8]  7 x Zone",
        "zones.4  Zone",
        "zones.7  Zone",
    ]


@pytest.mark.parametrize(
    ("path", "first", "count"),
    [
        ("zones.4", "zones.4  Zone  simulated", 3),
        ("zones", "zones  simulated", 7),
        ("zones.4.heaters", "zones.4.heaters  simulated", 2),
        ("fans.left", "fans.left  simulated", 2),
        ("fans", "fans  simulated", 3),
    ],
)
def test_a_path_shows_a_part(umo: Umo, furnace: Path, path: str, first: str, count: int) -> None:
    found = lines(umo("show", "parts", "furnace", path))
    assert (found[0], len(found)) == (first, count)


def test_a_path_that_names_nothing_is_refused_with_the_nearest(umo: Umo, furnace: Path) -> None:
    result = umo("show", "parts", "furnace", "zones.4.temprature")
    assert result.exit_code == 2
    assert "no object 'zones.4.temprature' in Furnace (did you mean 'zones.4.temperature'?)" in result.stderr


# A driver ---------------------------------------------------------------------------------------------

CARD = '''
from umo.drivers import Channel, ChannelError, Direction, Driver


class Card(Driver):
    """A card with one DAC."""

    def __init__(self, *, address: int = 7) -> None:
        pass

    def channel(self, text: str) -> Channel:
        raise ChannelError(text, ["dac:0"])

    def devices(self) -> list[str]:
        return ["card 7"]


class Bare(Driver):
    def __init__(self, bus: int) -> None:
        pass

    def channel(self, text: str) -> Channel:
        raise ChannelError(text, [])
'''


@pytest.fixture
def card(tank: Path) -> Iterator[Path]:
    """A station with a driver of its own, of which nothing stays imported."""

    def forget() -> None:  # another test may have a module of this name too
        for name in ("card", "tank", "tank.card"):
            sys.modules.pop(name, None)

    (tank / "card.py").write_text(CARD)
    forget()
    yield tank
    forget()


@pytest.mark.parametrize("name", ["card:Card", ".card:Card", "tank.card:Card"])
def test_any_driver_is_described_by_its_module_and_class(
    umo: Umo, card: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not name.startswith("tank"):
        monkeypatch.chdir(card)
    found = lines(umo("device", "drivers", name))
    assert found[0] == "Card  A card with one DAC."
    assert found[2].startswith("address: int = 7")
    assert found[-2:] == ["channels: dac:0", "additional functions: channel, devices"]


def test_a_driver_without_a_docstring_does_not_take_that_of_its_base(
    umo: Umo, card: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(card)
    assert lines(umo("device", "drivers", ".card:Bare"))[:3] == ["Bare", "options", "bus: int (required)"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("modbs", "did you mean 'modbus'?"),
        ("nowhere:Card", "No module named 'nowhere'"),
        ("umo.errors:UmoError", "is not a umo driver"),
        ("umo.errors:Nothing", "has no attribute 'Nothing'"),
        (".card:Card", "cannot be imported"),
    ],
)
def test_a_name_that_is_not_a_driver_is_refused(umo: Umo, name: str, said: str) -> None:
    result = umo("device", "drivers", name)
    assert result.exit_code == 2
    assert said in result.stderr


def test_a_registered_driver_is_described_alone(umo: Umo) -> None:
    found = lines(umo("device", "drivers", "modbus"))
    assert found[0].startswith("Modbus  One unit of a Modbus device, on TCP or on a serial line (RTU)")
    assert not any("timerfd" in line for line in found)


@pytest.mark.parametrize(
    ("declared", "told"), [("True", "Zone, equipment"), ('"manual"', "Zone, equipment (in manual mode)")]
)
def test_equipment_is_marked(umo: Umo, tmp_path: Path, declared: str, told: str) -> None:
    folder = tmp_path / "cell"
    folder.mkdir()
    objects = OBJECTS.replace("class Zone(Compound):", f"class Zone(Compound, equipment={declared}):")
    (folder / "objects.py").write_text(objects.replace("COUNT", "3"))
    assert any(line.endswith(f"3 x {told}") for line in umo("show", "parts", str(folder)).stdout.splitlines())
    assert umo("show", "parts", str(folder), "zones.0").stdout.startswith(f"zones.0  {told}  everything")
