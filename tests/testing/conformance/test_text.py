"""The conformance kit on the text driver: an emulated AVR on a serial line, and a SCPI supply behind socat."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from conformance.subjects import off_cycle
from helpers.peers.text_devices import CannotRun, Supply, avr, supply
from helpers.tiers import first, named
from umo.drivers.text import Text
from umo.testing.conformance import Input, Output, PtyTap, Subject, TcpTap, conform

Way = Callable[[Subject], Subject]
INSTRUMENT = {
    "out{n}": {"ask": "OUT? {n}", "answer": "OUT {n}={}", "set": "OUT {n},{}", "bits": 1},
    "adc{n}": {"ask": "ADC? {n}", "bits": 10, "signed": False},
    "level": {"ask": "LEVEL?", "set": "LEVEL {:.2f}", "scale": 0.01, "bits": 32},
}
SUPPLY = {
    "volt{n}": {"ask": ":CH{n}:VOLT?", "set": ":CH{n}:VOLT {:.3f}", "scale": 0.001, "bits": 16, "signed": False},
    "measured{n}": {"ask": ":CH{n}:MEAS?", "scale": 0.001, "bits": 32},
    "output": {"ask": ":OUTP?", "set": {"0": ":OUTP OFF", "1": ":OUTP ON"}},
    "overflow": {"ask": ":OVER?"},
}


@pytest.fixture
def board() -> Iterator[str]:
    try:
        with avr() as path:
            yield path
    except CannotRun as error:
        pytest.skip(str(error))


@pytest.fixture
def scpi() -> Iterator[Supply]:
    try:
        with supply() as running:
            yield running
    except CannotRun as error:
        pytest.skip(str(error))


WAYS = first(1, named(["", "off the cycle"], [lambda subject: subject, off_cycle]))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.full
def test_an_emulated_avr_on_a_serial_line(board: str, rules: list[str] | None, way: Way) -> None:
    with PtyTap(board) as tap:
        subject = Subject(
            name="text, serial",
            make=lambda: Text(
                serial=tap.serial,
                baudrate=38400,
                quiet=0.03,
                errors=("ERR*",),
                acknowledge="OK",
                identify={"ask": "*IDN?", "answer": "UMO,AVR*"},
                channels=INSTRUMENT,
            ),
            outputs=(Output("out4"), Output("level", default=0, least=-1999_00, greatest=1999_00)),
            inputs=(Input("adc1"),),
            refused=("out7",),
            device="firmware in C on an emulated ATmega328P (simavr)",
            timeout=0.1,
            line=tap,
        )
        certificate = conform(way(subject), cycles=50, only=rules)  # 40 ms each
    assert certificate.passed, str(certificate)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("together", first(1, [None, ";"]))
def test_a_scpi_supply_behind_socat(scpi: Supply, together: str | None, rules: list[str] | None, way: Way) -> None:
    with TcpTap("127.0.0.1", scpi.port) as tap:
        subject = Subject(
            name="text, TCP" + (", queries joined" if together else ""),
            make=lambda: Text(
                host=tap.host,
                port=tap.port,
                errors=('-*,"*"',),
                confirm={"ask": "SYST:ERR?", "answer": '0,"No error"'},
                identify={"ask": "*IDN?", "answer": "SOCAT,*"},
                together=together,
                channels=SUPPLY,
            ),
            outputs=(Output("output", default=1, least=1), Output("volt1", default=0, least=0, greatest=59_999)),
            inputs=(Input("volt2"),),
            loopbacks=(("volt1", "measured1"),),
            refused=("overflow",),
            device="a supply that speaks SCPI, in POSIX shell behind socat",
            timeout=0.1,
            line=tap,
        )
        certificate = conform(way(subject), cycles=200, only=rules)  # a process of the shell for each measurement
    assert certificate.passed, str(certificate)
