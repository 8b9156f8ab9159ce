"""The driver boundary: the paper's five code segments, in integers."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass, field

import numpy as np
import pytest

from umo import Compound, connect
from umo.drivers import Channel, Direction, Driver, HasShortForm, HasWatchdog, KnowsScale, Looks, Reports
from umo.drivers.optional import (
    OPTIONAL,
    NoWatchdog,
    ages_of,
    arm_watchdog,
    inspection_of,
    look_for,
    names_of,
    report_of,
    scale_of,
    short_form_of,
)
from umo.drivers.simulated import Simulated
from umo.drivers.streams import Lost
from umo.drivers.wrapping import Wrapper, bare
from umo.errors import ChannelsFailed, DeclarationError, DeviceTimeout, DriverError, WiringError
from umo.testing import Scripted


class Least(Driver):
    """What a driver must have and no more."""

    def __init__(self):
        self.written = []

    def channel(self, text):
        return Channel(text, Direction.BOTH, 8)

    def read(self, channel):
        return int(channel.text)

    def write(self, channel, raw):
        self.written.append((channel.text, raw))


CHANNELS = [Channel(str(i), Direction.BOTH, 8) for i in range(3)]


def test_a_driver_needs_channel_and_what_its_directions_need():
    assert Driver.__abstractmethods__ == {"channel"}
    with pytest.raises(TypeError):
        Driver()


def test_the_contract_is_the_five_segments_and_what_is_derived_from_them():
    public = [name for name, item in vars(Driver).items() if inspect.isfunction(item) and not name.startswith("_")]
    assert public == ["channel", "initialize", "finalize", "reset", "read", "write", "devices",
                      "read_many", "write_many", "open", "close"]  # fmt: skip


def test_an_output_is_initialised_and_reset_by_writing_its_default_alone():
    driver = Least()
    driver.initialize(CHANNELS[1], 5)
    driver.reset(CHANNELS[1], 6)
    assert driver.written == [("1", 5), ("1", 6)]


def test_a_sensor_is_initialised_and_reset_without_a_write():
    driver = Least()
    driver.initialize(CHANNELS[1], None)
    driver.reset(CHANNELS[1], None)
    driver.finalize(CHANNELS[1])
    driver.open()
    driver.close()
    assert driver.written == []


def test_read_many_fills_the_buffer_in_place_from_read():
    out = np.full(3, -1, np.int64)
    Least().read_many(CHANNELS, out)
    assert out.tolist() == [0, 1, 2]


def test_write_many_hands_plain_integers_to_write_in_order():
    driver = Least()
    driver.write_many(CHANNELS, np.array([7, 8, 9]))
    assert driver.written == [("0", 7), ("1", 8), ("2", 9)]
    assert all(type(raw) is int for _, raw in driver.written)


def test_a_buffer_of_another_length_is_an_error_not_a_silent_half():
    with pytest.raises(ValueError):
        Least().write_many(CHANNELS, np.array([7, 8]))


class Waits(Least):
    """Each transfer takes its whole timeout, or the time that is given, on a clock of the test."""

    def __init__(self, monkeypatch, takes=None):
        super().__init__()
        self.timeout, self.takes, self.now, self.timeouts = 1.0, takes, 0.0, []
        monkeypatch.setattr("umo.drivers.contract.monotonic", lambda: self.now)

    def write(self, channel, raw):
        self.timeouts.append(self.timeout)
        self.now += min(self.timeout, self.takes)
        if self.takes > self.timeout:
            raise DeviceTimeout("timed out")

    def read(self, channel):
        self.write(channel, 0)
        return 0

    def transfer(self, form):
        getattr(self, form)(CHANNELS, np.zeros(3, np.int64))


@pytest.mark.parametrize("form", ["read_many", "write_many"])
def test_the_single_transfers_of_a_block_have_one_timeout_together(monkeypatch, form):
    driver = Waits(monkeypatch, takes=0.4)
    with pytest.raises(TimeoutError):
        driver.transfer(form)
    assert driver.timeouts == pytest.approx([1.0, 0.6, 0.2])
    assert driver.now == pytest.approx(1.0)
    assert driver.timeout == 1.0


@pytest.mark.parametrize("form", ["read_many", "write_many"])
def test_a_block_whose_timeout_is_over_leaves_a_hundredth_of_it_to_each_of_the_others(monkeypatch, form):
    driver = Waits(monkeypatch, takes=0.5)
    with pytest.raises(TimeoutError):
        driver.transfer(form)
    assert driver.timeouts == [1.0, 0.5, 0.01]


@pytest.mark.parametrize("form", ["read_many", "write_many"])
def test_a_circuit_that_answers_at_once_does_not_fail_as_the_computer_was_busy(monkeypatch, form):
    driver = Waits(monkeypatch, takes=0.0)
    monkeypatch.setattr("umo.drivers.contract.monotonic", lambda: driver.now + 3.0 * len(driver.timeouts))
    driver.transfer(form)
    assert driver.timeouts == [1.0, 0.01, 0.01]


@pytest.mark.parametrize("form", ["read_many", "write_many"])
def test_the_timeout_of_single_transfers_that_are_quick_is_not_touched(monkeypatch, form):
    driver = Waits(monkeypatch, takes=0.001)
    driver.transfer(form)
    assert driver.timeouts == [1.0, 1.0, 1.0]


def test_a_reading_that_is_no_integer_is_not_truncated():
    driver = Scripted({"0": 2.5})
    with pytest.raises(ChannelsFailed, match=r"^0: the reading of channel 0 is 2.5 \(float\): a whole number is"):
        Driver.read_many(driver, CHANNELS[:1], np.zeros(1, np.int64))


@pytest.mark.parametrize("many", ["read_many", "write_many"])
@pytest.mark.parametrize(
    ("texts", "told"),
    [(("refused", "refused"), "refused"), (("refused", "reset"), "refused and reset")],
)
def test_if_no_channel_has_reached_the_device_it_is_not_said_that_the_device_answers(many, texts, told):
    class Refuses(Least):
        def read(self, channel):
            raise ConnectionError(texts[int(channel.text)])

        def write(self, channel, raw):
            try:
                raise Lost(texts[int(channel.text)])
            except Lost as error:
                raise DriverError(str(error)) from None

    with pytest.raises(DriverError) as caught:
        getattr(Refuses(), many)(CHANNELS[:2], np.zeros(2, np.int64))
    assert (type(caught.value), str(caught.value)) == (DriverError, told)


def test_a_device_that_refuses_every_channel_has_answered():
    class Refuses(Least):
        def read(self, channel):
            raise DriverError("local mode")

    with pytest.raises(ChannelsFailed) as caught:
        Refuses().read_many(CHANNELS[:2], np.zeros(2, np.int64))
    assert caught.value.causes == {"0": "local mode", "1": "local mode"}


def test_a_reading_that_is_no_integer_fails_for_its_channel_with_the_place_of_read():
    class Halves(Least):
        def read(self, channel):
            return None if channel.text == "1" else 7

    out = np.zeros(3, np.int64)
    with pytest.raises(ChannelsFailed) as caught:
        Halves().read_many(CHANNELS, out)
    assert list(caught.value.causes) == ["1"]
    what = r"the reading of channel 1 is None \(NoneType\): a whole number is needed"
    assert re.fullmatch(rf"{what} \(\S*test_driver_contract.py:\d+ in read\)", caught.value.causes["1"])
    assert out.tolist() == [7, 0, 7]


def test_a_direction_without_its_function_says_so():
    class Nothing(Driver):
        def channel(self, text):
            return Channel(text, Direction.BOTH, 1)

    with pytest.raises(NotImplementedError, match="Nothing has no inputs"):
        Nothing().read(CHANNELS[0])
    with pytest.raises(NotImplementedError, match="Nothing has no outputs"):
        Nothing().write(CHANNELS[0], 1)
    with pytest.raises(NotImplementedError, match="Nothing has no watchdog"):
        arm_watchdog(Nothing(), 1.0)


@pytest.mark.parametrize(
    ("bits", "signed", "lowest", "highest"),
    [
        (1, False, 0, 1),
        (8, False, 0, 255),
        (8, True, -128, 127),
        (16, True, -32768, 32767),
        (64, True, -(2**63), 2**63 - 1),
    ],
)
def test_a_channel_knows_what_its_bits_hold(bits, signed, lowest, highest):
    channel = Channel("x", Direction.BOTH, bits, signed)
    assert (channel.lowest, channel.highest) == (lowest, highest)


def test_a_channel_is_frozen_and_takes_up_its_text():
    channel = Channel("holding:0", Direction.OUTPUT, 16)
    with pytest.raises(AttributeError):
        channel.bits = 8
    assert channel.places == ("holding:0",)
    assert channel == Channel("holding:0", Direction.OUTPUT, 16)


def test_directions_contain_each_other():
    assert Direction.INPUT in Direction.BOTH and Direction.OUTPUT in Direction.BOTH
    assert Direction.INPUT not in Direction.OUTPUT


def test_the_simulated_driver_is_a_driver_like_any_other():
    assert issubclass(Simulated, Driver)


def test_a_derived_channel_hashes_by_its_text_unless_it_has_a_hash_of_its_own():
    @dataclass(frozen=True)
    class Placed(Channel):
        table: dict[str, int] = field(default_factory=dict)  # which has no hash

    class Own(Channel):
        def __hash__(self):
            return 7

    assert hash(Placed("a", Direction.INPUT, 8)) == hash(Channel("a", Direction.INPUT, 8)) == hash("a")
    assert hash(Own("a", Direction.INPUT, 8)) == 7


@pytest.mark.parametrize(("bits", "signed"), [(64, False), (64, True), (80, True), (80, False)])
def test_the_limits_of_a_channel_are_those_of_a_transfer_at_most(bits, signed):
    channel = Channel("a", Direction.BOTH, bits, signed)
    assert (channel.lowest, channel.highest) == (-(2**63) if signed else 0, 2**63 - 1)


# What a driver may have beside the contract --------------------------------------------------------------


def test_a_driver_without_any_of_it_is_tried_and_knows_nothing() -> None:
    driver, channel = Least(), CHANNELS[0]
    assert look_for(driver) is True
    assert (ages_of(driver, [channel]), scale_of(driver, channel), short_form_of(Least, "x")) == (None, None, None)
    assert (report_of(driver), inspection_of(driver, channel)) == ({}, "")
    with pytest.raises(NoWatchdog):
        arm_watchdog(driver, 1.0)


FUNCTIONS = [(kind, name) for kind in OPTIONAL for name in names_of(kind) if callable(getattr(kind, name))]


@pytest.mark.parametrize(("kind", "name"), FUNCTIONS, ids=[name for _, name in FUNCTIONS])
def test_a_function_whose_class_is_not_named_is_refused_with_the_line_that_names_it(kind: type, name: str) -> None:
    with pytest.raises(DeclarationError) as refused:
        type("Card", (Least,), {name: lambda self, *given: None})
    assert f"Card.{name} would never be called: it is a function of {kind.__name__}" in str(refused.value)
    assert f"write `class Card(Least, {kind.__name__})`" in str(refused.value)
    assert "test_driver_contract.py" in str(refused.value)


def test_a_function_that_another_base_brings_is_refused_too_and_an_attribute_of_that_name_is_not() -> None:
    class Logbook:
        def report(self):
            return {}

    with pytest.raises(DeclarationError, match=r"write `class Card\(Logbook, Least, Reports\)`"):

        class Card(Logbook, Least):
            pass

    class Shown(Least):
        report = "every hour"

    assert report_of(Shown()) == {}


class Empty(Compound):
    pass


class Misspelt(Least, HasWatchdog):
    def watchdogg(self, timeout: float) -> None:
        pass


def test_a_class_that_is_named_without_its_function_is_refused_with_the_nearest_one_and_the_place() -> None:
    line = inspect.getsourcelines(Misspelt)[1]
    what = "Misspelt has no `watchdog` (did you mean 'watchdogg'?), which each HasWatchdog must have"
    place = rf"\(\S*test_driver_contract.py:{line}\)"
    with pytest.raises(DeclarationError, match=f"^{re.escape(what)} {place}$"):
        Misspelt()
    wiring = {"drivers": {"card": {"type": f"{__name__}:Misspelt"}}}
    with pytest.raises(WiringError, match=rf"drivers.card: {re.escape(what)} {place}"):
        connect(Empty(), wiring).__enter__()


class Full(Least, Looks, KnowsScale, HasShortForm, Reports):
    def look(self) -> bool | None:
        return None

    def physical_scale(self, channel):
        return None

    @classmethod
    def table(cls, text):
        return {"host": text}

    def report(self):
        return {"parts": 3}


@pytest.mark.parametrize("driver", [Least, Full, Scripted])
def test_a_wrapper_is_what_the_driver_behind_it_is_and_nothing_else(driver: type[Driver]) -> None:
    wrapper = Wrapper(Wrapper(driver()))
    assert [kind for kind in OPTIONAL if isinstance(wrapper, kind)] == [
        kind for kind in OPTIONAL if issubclass(driver, kind)
    ]
    assert isinstance(bare(wrapper), driver)


def test_what_a_wrapper_does_not_do_itself_is_the_drivers_own() -> None:
    class Busy(Wrapper):
        def look(self) -> bool | None:
            return False

    wrapper = Busy(Full())
    wrapper.timeout = 0.25
    assert wrapper.driver.timeout == 0.25
    assert (look_for(wrapper), report_of(wrapper)) == (False, {"parts": 3})
    assert look_for(Busy(Least())) is True


def test_the_contract_fits_one_screen() -> None:
    code = [line for line in inspect.getsource(Driver).splitlines() if line.strip()]
    assert len(code) <= 90
