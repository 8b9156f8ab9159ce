"""The texts of a line protocol as pure functions: patterns, numbers, templates and tables of channels."""

from __future__ import annotations

import re
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from umo.drivers.contract import Direction
from umo.drivers.text.channel import Channels
from umo.drivers.text.exchange import joined
from umo.drivers.text.pattern import NoValue, Pattern, RawOf, UnexpectedAnswer, raw_of
from umo.drivers.text.template import Template
from umo.errors import ChannelError, DriverError, WiringError

INT64 = st.integers(-(2**63), 2**63 - 1)


def value(pattern: str, line: str) -> str | None:
    return Pattern(pattern, "answer", has_value=True).match(line)


def channels(**tables: Any) -> Channels:
    return Channels(tables, None, None)


# Patterns -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pattern", "line", "found"),
    [
        ("{}", "12.5", "12.5"),
        ("T={} C", "T=12.5 C", "12.5"),
        ("T={} C", "T=12.5 F", None),
        ("T={} C", "U=12.5 C", None),
        ("T={}C", "T=12.5 C", "12.5 "),
        ("{},*", "1,2,3", "1"),
        ("*,{}", "1,2", "2"),
        ("*,{}", "1,2,3", "2,3"),
        ("*,*,{}", "1,2,3", "3"),
        ("*,{},*", "1,2,3", "2"),
        ("{}", "", ""),
        ("a{}a", "a", None),
        ("(.){}", "(.)5", "5"),
        ("/T(\\d+)\\.?/", "T12.", "12"),
        ("/T(\\d+)/", "T12.", None),
        ("/T(\\d+)?/", "T", ""),
        ("\x02{}\x03", "\x025\x03", "5"),
    ],
)
def test_a_pattern_finds_the_value(pattern: str, line: str, found: str | None) -> None:
    assert value(pattern, line) == found


@pytest.mark.parametrize("bad", ["5\x00", "\x005", "5\x1b[2J", "5\x7f"])
def test_control_characters_match_only_those_of_the_pattern(bad: str) -> None:
    assert value("{}", bad) is None
    assert Pattern("*", "acknowledge").match(bad) is None


@pytest.mark.parametrize(
    ("pattern", "why"),
    [
        ("T", "needs one {}"),
        ("{}{}", "needs one {}"),
        ("{},{}", "needs one {}"),
        ("{}*", "needs text between"),
        ("*{}", "needs text between"),
        ("/(/", "not a regular expression"),
        ("/T/", "needs one group"),
        ("/(T)(U)/", "it has 2"),
    ],
)
def test_a_pattern_that_is_not_clear_is_refused(pattern: str, why: str) -> None:
    with pytest.raises(WiringError, match=re.escape(why)):
        Pattern(pattern, "answer", has_value=True)


def test_a_pattern_without_a_value_takes_no_braces() -> None:
    with pytest.raises(WiringError, match="takes no"):
        Pattern("ERR {}", "errors")
    with pytest.raises(WiringError, match="is empty"):
        Pattern("", "errors")


@given(st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=12), INT64)
def test_what_surrounds_the_value_does_not_matter(text: str, number: int) -> None:
    before, after = text.replace("{}", "").replace("*", "").lstrip(), ";"
    if before[:1] != "/":
        assert value(f"{before}{{}}{after}", f"{before}{number}{after}") == str(number)


def test_a_pattern_of_many_stars_takes_linear_time() -> None:
    """Else it would not end within the limit of a test."""
    assert Pattern("*a" * 30 + "b", "errors").match("a" * 100_000 + "c") is None


# Numbers ------------------------------------------------------------------------------------------


@given(INT64)
def test_whole_numbers_are_exact(number: int) -> None:
    for text in (f"{number}", f"{number}.", f"{number}.000", f" {number} ", f"{number}e0"):
        assert raw_of(text, None) == number


@given(INT64, st.integers(0, 18))
def test_decimals_are_exact(raw: int, places: int) -> None:
    scale = Decimal(1).scaleb(-places)
    sign, digits = "-" if raw < 0 else "", str(abs(raw)).rjust(places + 1, "0")
    cut = len(digits) - places
    assert raw_of(f"{sign}{digits[:cut]}.{digits[cut:]}", scale if places else None) == raw


@pytest.mark.parametrize(
    ("text", "scale", "raw"),
    [
        ("+1.25000E+00", "0.001", 1250),
        (".5", "0.1", 5),
        ("0.0005", "0.001", 0),  # half to even
        ("0.0015", "0.001", 2),
        ("-0.0015", "0.001", -2),
        ("0.00149999999999999999999999999999999999", "0.001", 1),
        ("0E999999999", None, 0),
        ("1e-999999999", "0.001", 0),
        ("9.8E37", "1e30", 98_000_000),
    ],
)
def test_numbers_are_rounded_to_the_nearest_step(text: str, scale: str | None, raw: int) -> None:
    assert raw_of(text, Decimal(scale) if scale else None) == raw


PLAIN = st.from_regex(r"[+-]?[0-9]{0,20}\.?[0-9]{0,6}(e[+-]?[0-9])?", fullmatch=True)


@given(
    PLAIN | st.text("0123456789.-+ _e²٣", max_size=8),
    st.sampled_from([None, "1", "0.1", "0.001", "1e-12", "10", "0.25", "1e-30"]),
)
def test_the_quick_way_for_plain_decimals_gives_the_exact_number(text: str, scale: str | None) -> None:
    step = Decimal(scale) if scale else None

    def outcome(of: Callable[[], int]) -> int | str:
        try:
            return of()
        except (NoValue, UnexpectedAnswer) as error:
            return str(error)

    assert outcome(lambda: RawOf(step)(text)) == outcome(lambda: raw_of(text, step))


def test_without_a_scale_a_number_must_be_whole() -> None:
    with pytest.raises(UnexpectedAnswer, match=r"'0.77' is not a whole number, and the channel has no scale"):
        raw_of("0.77", None)
    assert raw_of("0.77", Decimal(1)) == 1


@pytest.mark.parametrize(
    "text", ["", " ", "12x", "1 2", "1,5", "0x10", "1e", "--1", "1.2.3", "1_000", "٣", "1\n", "None", "e5", ".", "1e+"]
)
def test_what_is_not_a_number_is_an_unexpected_answer(text: str) -> None:
    with pytest.raises(UnexpectedAnswer, match="is not a number"):
        raw_of(text, None)


@pytest.mark.parametrize(
    "text",
    [
        *("NAN", "nan", "INF", "-inf", "NINF", "Infinity", "9.9E37", "-9.9E37", "9.91E37"),
        *("1e400", "1e999999999", "1e99999999999999999999", "1e-99999999999999999999", "9" * 70),
    ],
)
def test_no_finite_number_is_an_error_without_a_value(text: str) -> None:
    with pytest.raises(NoValue):
        raw_of(text, None)


# Requests -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("template", "scale", "raw", "request_"),
    [
        ("VOLT {:.3f}", "0.001", 1500, "VOLT 1.500"),
        ("VOLT {}", "0.001", 1500, "VOLT 1.500"),
        ("N {}", None, 2**63 - 1, "N 9223372036854775807"),
        ("N {:04d}", None, 7, "N 0007"),
        ("N {:5}", None, 7, "N     7"),
        ("N {:02X}", None, 255, "N FF"),
        ('{{"v": {}}}', None, 5, '{"v": 5}'),
        ("S {:e}", "0.001", 123456, "S 1.23456e+2"),
        ("N {:d}", "1000000000001", 2**63 - 1, f"N {(2**63 - 1) * 1000000000001}"),
        ("V {:010.3f}", "0.001", -1500, "V -00001.500"),
    ],
)
def test_a_template_writes_the_number(template: str, scale: str | None, raw: int, request_: str) -> None:
    step = Decimal(scale) if scale else None
    assert Template.parse(template, "set", step).filled(raw) == request_


@pytest.mark.parametrize(
    ("template", "scale", "why"),
    [
        ("VOLT", None, "needs one {}"),
        ("{} {}", None, "needs one {}"),
        ("{x}", None, "needs one {}"),
        ("{", None, "a brace of the request is written twice"),
        ("{:.1f}", "0.001", "for 9223372036854775.807; use {:.3f}"),
        ("{:d}", "0.5", "writes '4611686018427387903' for 4611686018427387903.5; use {:.1f}"),
        ("{:q}", None, "is not the format of a number"),
        ("{:,}", None, "writes '9,223,372,036,854,775,807' for 9223372036854775807; use {}"),
        ("{:%}", None, "is not the format of a number"),
        ("{:_x}", None, "writes '7fff_ffff_ffff_ffff'"),
        ("{:0>8}", None, "writes '000000-1' for -1; use {}"),
        ("{:=8}", "0.001", "writes '-  0.001'"),
        ("VOLT {:.3f}", None, "writes decimals, and the channel has no scale; set scale"),
        ("VOLT {:e}", None, "writes decimals"),
    ],
)
def test_a_template_that_loses_the_number_is_refused(template: str, scale: str | None, why: str) -> None:
    with pytest.raises(WiringError, match=re.escape(why)):
        made = Template.parse(template, "set", Decimal(scale) if scale else None)
        made.check(-(2**63), 2**63 - 1, "set")


FORMATS = st.builds(
    lambda pad, sign, width, digits, kind: f"{{:{pad}{sign}{width}{digits}{kind}}}",
    st.sampled_from(["", "", "", ">", "<", "^", "=", "0=", "0>", " >", "->"]),
    st.sampled_from(["", "", "+", " ", "-"]),
    st.sampled_from(["", "", "8", "08", "24"]),
    st.sampled_from(["", "", ".0", ".1", ".3", ".4", ".9", ".18", ".19"]),
    st.sampled_from(["", "f", "F", "e", "E", "g", "G", "d", "n", "%"]),
)
SCALES = st.sampled_from([None, 1.0, 0.1, 0.001, 0.25, 0.125, 3.0, 25.0, 1000.0, 1e-9, 1.2345678901234567, 1e23])


@given(FORMATS, SCALES, st.integers(1, 64), st.booleans(), st.data())
def test_every_raw_integer_of_a_channel_that_is_taken_is_sent_as_its_number_and_read_back(
    text: str, scale: float | None, bits: int, signed: bool, data: st.DataObject
) -> None:
    table: dict[str, Any] = {"set": f"V {text}", "ask": "V?", "answer": "V{}", "bits": bits, "signed": signed}
    try:
        channel = channels(c=table | ({} if scale is None else {"scale": scale})).named("c")
    except WiringError:
        return
    ends = st.sampled_from([channel.lowest, channel.highest, max(channel.lowest, -1), 0])
    raw = data.draw(ends | st.integers(channel.lowest, channel.highest))
    sent = channel.request(raw).removeprefix("V ").strip()
    assert Fraction(Decimal(sent)) == raw * Fraction(repr(scale or 1))
    if abs(Decimal(sent)) < Decimal("9.9E37"):
        assert channel.raw(f"V{sent}") == raw


@pytest.mark.parametrize(
    ("text", "bits", "why"),
    [
        ("{:.3e}", 64, "writes '9.223e+15' for 9223372036854775.807; use {:.3f}"),
        ("{:.3e}", 14, ""),
        ("{:.4g}", 15, "writes '16.38' for 16.383; use {:.3f}"),
        ("{:.4G}", 14, ""),
        ("{:.2f}", 8, "writes '0.13' for 0.127; use {:.3f}"),
        ("{:.3f}", 64, ""),
        ("{}", 64, ""),
    ],
)
def test_a_format_that_loses_a_digit_of_the_largest_raw_integer_is_refused_with_the_nearest(
    text: str, bits: int, why: str
) -> None:
    """`{:.3e}` sent 123.456 V as 1.235e+2."""
    table = {"set": f"VOLT {text}", "scale": 0.001, "bits": bits}
    if not why:
        channels(c=table).named("c")
        return
    with pytest.raises(WiringError, match=re.escape(why)):
        channels(c=table)


def test_requests_are_joined_up_to_the_longest_line() -> None:
    assert joined(["aa", "bb", "cc"], ";", 5) == [[0, 1], [2]]
    assert joined(["aa", "bb"], ";", 4) == [[0], [1]]
    assert joined(["longer than that", "bb"], ";", 4) == [[0], [1]]
    assert joined(["aa", "bb"], None, 99) == [[0], [1]]
    assert joined([], ";", 99) == []


# Tables of channels -------------------------------------------------------------------------------


def test_directions_bits_and_sign() -> None:
    made = channels(
        number={"ask": "N?"},
        both={"ask": "B?", "set": "B {}", "bits": 8, "signed": False},
        bit={"ask": "I?", "bits": 1},
        switch={"set": {"0": "OFF", "1": "ON"}},
        mode={"ask": "M?", "states": {"0": "idle", "5": ["run", "RUN"]}},
    )
    seen = {name: made.named(name) for name in made.tables}
    assert {name: (each.direction, each.bits, each.signed) for name, each in seen.items()} == {
        "number": (Direction.INPUT, 64, True),
        "both": (Direction.BOTH, 8, False),
        "bit": (Direction.INPUT, 1, False),
        "switch": (Direction.OUTPUT, 1, False),
        "mode": (Direction.INPUT, 3, False),
    }
    assert [seen["mode"].raw(text) for text in ("idle", "run", "RUN")] == [0, 5, 5]
    assert [seen["switch"].request(raw) for raw in (0, 1)] == ["OFF", "ON"]


def test_a_value_that_the_channel_has_no_bits_for_is_an_error() -> None:
    made = channels(a={"ask": "A?", "set": "A {}", "bits": 8}, b={"ask": "B?", "bits": 64, "signed": False})
    for text in ("128", "-129"):
        with pytest.raises(NoValue, match="does not fit channel a: -128 to 127"):
            made.named("a").raw(text)
    with pytest.raises(DriverError, match="128 does not fit a"):
        made.named("a").request(128)
    with pytest.raises(NoValue, match="9223372036854775807"):
        made.named("b").raw(str(2**63))


def test_an_unknown_state_or_level_is_an_error() -> None:
    made = channels(a={"ask": "A?", "states": {"0": "off", "1": "on"}, "set": {"0": "OFF", "2": "ON"}})
    with pytest.raises(UnexpectedAnswer, match="none of the states off, on"):
        made.named("a").raw("maybe")
    with pytest.raises(DriverError, match="1 is not a level: 0, 2"):
        made.named("a").request(1)


def test_numbered_channels_put_their_number_into_all_texts() -> None:
    made = channels(**{"zone{n}": {"ask": "T{n:02d}?", "answer": "T{n}={}", "set": "T{n} {}"}})
    zone = made.named("zone7")
    assert zone.reading is not None and zone.reading.ask == "T07?"
    assert zone.raw("T7=21") == 21
    assert zone.request(5) == "T7 5"
    assert zone.places != made.named("zone8").places
    for wrong in ("zone", "zone07", "zone-1", "zone{n}", "zone1x"):
        with pytest.raises(ChannelError, match=re.escape("zone{n}")):
            made.named(wrong)


@pytest.mark.parametrize("wrong", ["R{n:zz}?", "R{n:99999999999d}?", "R{n:.3f}?"])
def test_a_number_of_a_channel_in_another_format_is_a_mistake_of_the_channel(wrong: str) -> None:
    with pytest.raises(WiringError, match=re.escape("channels.zone{n}.ask: {n:")):
        channels(**{"zone{n}": {"ask": wrong, "answer": "{}"}})


def test_places_are_what_is_set_or_asked() -> None:
    made = channels(
        a={"set": "V {}"}, b={"set": "V {}", "ask": "V?"}, c={"ask": "V?"}, d={"ask": "V?", "answer": "x{}"}
    )
    places = {name: made.named(name).places for name in made.tables}
    assert places["a"] == places["b"] != places["c"] != places["d"]
    assert made.named("a") == made.named("a")


@pytest.mark.parametrize(
    ("table", "why"),
    [
        ({}, 'needs ask = "..." or set'),
        ({"aks": "x"}, "channels.c: unknown key 'aks' (did you mean 'ask'?); known: ask, answer"),
        ({"answer": "{}", "set": "{}"}, "channels.c.answer needs ask"),
        ({"states": {"0": "x"}, "set": "{}"}, "channels.c.states needs ask"),
        ({"ask": "x", "acknowledge": "OK"}, "acknowledge and confirm need set"),
        ({"ask": "x", "scale": 0}, "channels.c.scale must be a number above 0"),
        ({"ask": "x", "scale": -1}, "channels.c.scale must be a number above 0"),
        ({"ask": "x", "scale": float("nan")}, "channels.c.scale must be a number above 0"),
        ({"ask": "x", "units": 5}, "channels.c.units must be a string"),
        ({"set": {"0": "OFF"}, "units": "V"}, "channels.c.units is for a number"),
        ({"ask": "x", "bits": 65}, "channels.c.bits must be a whole number from 1 to 64"),
        ({"ask": "x", "bits": 0}, "channels.c.bits must be a whole number from 1 to 64"),
        ({"set": 5}, "channels.c.set must be a string or a table of levels"),
        ({"set": {}}, "channels.c.set must be a string or a table of levels"),
        ({"set": {"x": "OFF"}}, "a level is a whole number from 0 on, not 'x'"),
        ({"set": {"0": 5}}, "channels.c.set.0 must be a string"),
        ({"set": {"0": "OFF", "4": "ON"}, "bits": 2}, "level 4 does not fit its 2 bits"),
        ({"ask": "x", "states": {"0": "a", "1": "a"}}, "'a' stands for 0 and for 1"),
        ({"set": "x {}", "confirm": {"ask": "E?"}}, "channels.c.confirm needs both ask and answer"),
        ({"set": "x {}", "confirm": {"aks": "E?"}}, "channels.c.confirm: unknown key 'aks'"),
        ("x", "channels.c must be a table such as"),
    ],
)
def test_a_faulty_table_is_refused_with_its_key(table: Any, why: str) -> None:
    with pytest.raises(WiringError, match=re.escape(why)):
        channels(c=table)
    with pytest.raises(WiringError, match="channels is empty"):
        channels()
