"""The gpio driver without a chip: texts of channels, options, messages. With chips: tests/kernel/test_gpio.py."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.drivers.contract import Direction
from umo.drivers.gpio import Gpio
from umo.drivers.gpio.channel import Settings, parse
from umo.errors import ChannelError, DriverError, WiringError

DEFAULTS = Settings(bias="pull-up", debounce=1000)


@pytest.mark.parametrize(
    ("text", "lines", "edges"),
    [
        ("line:7", (7,), ""),
        ("line:PUMP", ("PUMP",), ""),
        ("line:SPI0:CS", ("SPI0:CS",), ""),
        ("lines:4-7", (4, 5, 6, 7), ""),
        ("lines:7-4", (7, 6, 5, 4), ""),
        ("lines:3", (3,), ""),
        ("lines:A,B,12", ("A", "B", 12), ""),
        ("edges:7", (7,), "rising"),
        ("edges:7:both", (7,), "both"),
        ("edges:BARRIER:falling", ("BARRIER",), "falling"),
        ("edges:rising", ("rising",), "rising"),
    ],
)
def test_the_text_of_a_channel_names_its_lines(text: str, lines: tuple[int | str, ...], edges: str) -> None:
    channel = parse(text, Settings())
    assert (channel.lines, channel.edges) == (lines, edges)
    assert channel.text == text
    assert channel.bits == (63 if edges else len(lines))
    assert channel.direction is (Direction.INPUT if edges else Direction.BOTH)


@pytest.mark.parametrize(
    ("words", "settings"),
    [
        ("", DEFAULTS),
        (" bias=as-is", Settings(debounce=1000)),
        (" drive=open-drain active_low", Settings("pull-up", "open-drain", True, 1000)),
        (" debounce=0ms active_high", Settings("pull-up")),
        (" debounce=1.5ms", Settings("pull-up", debounce=1500)),
        (" debounce=20us", Settings("pull-up", debounce=20)),
    ],
)
def test_words_of_the_text_outrank_the_options(words: str, settings: Settings) -> None:
    assert parse(f"line:7{words}", DEFAULTS).settings == settings


@pytest.mark.parametrize(
    "text",
    [
        *("", "7", "line", "line:", "line:07", "line:7x", "line:-1", "line:A,B", "lines:", "lines:1,", "lines:1,1"),
        *("lines:A,A", "lines:0-63", "lines:1-2-3", "lines:0-99999", "edges:", "edges:7:up", "edges:1,2", "pin:7"),
        *("line:7 ", "line:7  active_low", "line:7 bias=up", "line:7 bias", "line:7 debounce=5", "line:7 pull-up"),
        *("line:7 debounce=9999s", "line:7 drive=", "line:123456", " line:7", "line:A B", "line:A\tB", "Line:7"),
    ],
)
def test_any_other_text_is_an_error_with_the_forms(text: str) -> None:
    with pytest.raises(ChannelError, match=r"the forms are: line:N, line:NAME, lines:N-M, .*bias=pull-up"):
        Gpio().channel(text)


@given(
    st.text(max_size=20) | st.from_regex(r"(line|lines|edges):[A-C0-9,:-]{1,8}( [a-z=_0-9-]{1,14})?", fullmatch=True)
)
def test_no_text_makes_anything_but_a_channel_or_its_error(text: str) -> None:
    try:
        channel = parse(text, Settings())
    except ChannelError:
        return
    assert channel.text == text
    assert len(set(channel.places)) == len(channel.lines)


def test_channels_that_share_a_line_share_a_place() -> None:
    group, line, edges = (set(parse(text, Settings()).places) for text in ("lines:4-7", "line:5 active_low", "edges:5"))
    assert group & line == line == edges


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bias": "up"}, "bias must be one of 'as-is', 'disabled', 'pull-up', 'pull-down', not 'up'"),
        ({"drive": "open"}, "drive must be one of 'push-pull', 'open-drain', 'open-source', not 'open'"),
        ({"active_low": 1}, "active_low must be true or false, not 1"),
        ({"debounce": "5"}, 'debounce must be a time such as "5 ms"'),
        ({"debounce": 5}, "debounce must be a time"),
        ({"chip": 0}, "chip must be the path, name or label"),
        ({"chip": ""}, "chip must be the path, name or label"),
    ],
)
def test_a_wrong_option_names_the_valid_choice(options: dict[str, object], message: str) -> None:
    with pytest.raises(WiringError, match=message):
        Gpio(**options)  # type: ignore[arg-type]


def test_a_missing_chip_is_an_error_when_it_is_opened_and_not_before(tmp_path: Path) -> None:
    path = str(tmp_path / "gpiochip0")
    driver = Gpio(chip=path)
    channel = driver.channel("line:0")
    assert list(driver.devices()) == [f"gpio {path}"]
    pytest.importorskip("gpiod")
    for _ in range(2):
        with pytest.raises(
            DriverError, match=rf"^there is no device {path}; (this computer has no GPIO chip|there are: )"
        ):
            driver.open()
        driver.close()
    with pytest.raises(DriverError, match="not open"):
        driver.read(channel)


def test_a_file_that_is_not_a_chip_is_an_error() -> None:
    pytest.importorskip("gpiod")
    with pytest.raises(DriverError, match="/dev/null is not a GPIO chip"):
        Gpio(chip="/dev/null").open()


def test_without_the_library_a_wiring_can_be_checked_and_opening_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours = ("gpiod", "umo.drivers.gpio.lines", "umo.drivers.gpio.request")
    for name in [name for name in sys.modules if name.startswith(ours)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gpiod", None)
    driver = Gpio()
    assert driver.channel("line:7").bits == 1
    assert list(driver.devices()) == ["gpio /dev/gpiochip0"]
    with pytest.raises(DriverError, match=r'pip install "\.\[gpio\]" in the clone of umo'):
        driver.open()
