"""`umo device drivers NAME`: what a driver says of itself, also one that knows its channels only with its options."""

from __future__ import annotations

from pathlib import Path

import pytest

from umo.text import options_in

CARDS = '''
from __future__ import annotations

from pathlib import Path
from typing import Literal

from umo.drivers import Channel, ChannelError, Direction, Driver, HasWatchdog


class Card(Driver, HasWatchdog):
    """A card whose file lists its channels,
    one a line.

    It is for tests.

    Options:
        file, other: the list of channels; a text
            of two lines.
        mode: how it works.

    More of it.
    """

    def __init__(self, *, file: Path, other: Path | None = None, mode: Literal["a", "b"] = "a", count: int = 3) -> None:
        self.channels = file.read_text().split()

    def channel(self, text: str) -> Channel:
        if text not in self.channels:
            raise ChannelError(text, self.channels)
        return Channel(text, Direction.INPUT, 8)

    def watchdog(self, seconds):
        pass


class Plain(Driver):
    def channel(self, text):
        raise ZeroDivisionError


class Positional(Driver):
    """Without annotations."""

    def __init__(self, address, *rest, speed=9600, **more):
        pass

    def channel(self, text):
        return Channel(text, Direction.INPUT, 8)
'''


@pytest.fixture
def cards(umo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "cards_of_the_tests.py").write_text(CARDS)
    (tmp_path / "channels.txt").write_text("in:0 in:1")
    monkeypatch.delitem(__import__("sys").modules, "cards_of_the_tests", raising=False)
    return tmp_path


def test_a_driver_is_described_by_its_docstring_its_options_and_its_functions(umo, cards: Path) -> None:
    text = umo("device", "drivers", "cards_of_the_tests:Card").output
    lines = [" ".join(line.strip("│├└─ ").split()) for line in text.splitlines()]
    assert lines[0] == "Card A card whose file lists its channels, one a line."
    for line in (
        "file: Path (required) the list of channels; a text of two lines.",
        "other: Path | None = None the list of channels; a text of two lines.",
        "mode: Literal['a', 'b'] = 'a' how it works.",
        "count: int = 3",
        "timeout: duration = 10 periods, at most 1 s time limit of one call of the driver",
        "channels: known only with the options of the driver: give them after its name",
        "additional functions: channel, watchdog",
        "It is for tests.",
        "More of it.",
    ):
        assert line in lines, text
    assert any(line.startswith("watchdog: duration") for line in lines)
    assert text.count("how it works") == 1


def test_with_its_options_a_driver_names_its_channels(umo, cards: Path) -> None:
    assert (
        "channels: in:0, in:1" in umo("device", "drivers", "cards_of_the_tests:Card", "--file", "channels.txt").output
    )


@pytest.mark.parametrize(
    ("driver", "form"),
    [
        ("i2c", "ADDRESS:BITS[:big|little][:signed]"),
        ("spi", "REGISTER.HIGH:LOW"),
        ("iio", "out_TYPE[N]"),
        ("fmu", "NAME:SCALE"),
        ("text", "names of the option channels"),
    ],
)
def test_a_driver_with_required_options_names_the_forms_of_its_channels(umo, driver: str, form: str) -> None:
    assert form in " ".join(umo("device", "drivers", driver).output.partition("channels: ")[2].split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--file", "none.txt"), "No such file or directory: 'none.txt'"),
        (
            ("--flie", "none.txt"),
            "has no option --flie (did you mean 'file'?); it has: --file, --other, --mode",
        ),
        (("--mode", "c"), "'--mode': 'c' is not one of"),
        (("--count", "x"), "'--count': 'x' is not"),
        (("more",), "unexpected argument 'more'"),
    ],
)
def test_an_option_that_is_wrong_is_named(umo, cards: Path, words: tuple[str, ...], message: str) -> None:
    result = umo("device", "drivers", "cards_of_the_tests:Card", *words)
    assert result.exit_code == 2
    assert message in result.stderr


def test_a_driver_that_says_nothing_of_itself_is_described_too(umo, cards: Path) -> None:
    text = umo("device", "drivers", "cards_of_the_tests:Plain").output
    assert text.startswith("Plain")
    assert "five code segments" not in text
    assert "watchdog" not in text
    text = umo("device", "drivers", "cards_of_the_tests:Positional").output
    assert "address (required)" in text and "speed: int = 9600" in text and "rest" not in text and "more" not in text


def test_the_options_of_a_docstring_are_found_by_name() -> None:
    doc = """Head.

    Options:
        a, b: one
            two: three
        c: four
    Other:
        d: five
    """
    assert options_in(doc) == {"a": "one two: three", "b": "one two: three", "c": "four"}
    assert options_in("Head.") == options_in("") == {}
