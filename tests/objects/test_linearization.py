"""Non-linear calibration: polynomials, tables and thermocouples between the electrical quantity and the value."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.machines import Bench, actuator, bench, sensor, wired
from umo import (
    DigitalActuator,
    DigitalSensor,
    Interlock,
    LookupTable,
    Polynomial,
    Quality,
    Thermocouple,
    Vector,
    check,
    connect,
)
from umo.errors import DeclarationError, WiringError
from umo.objects import children
from umo.objects.linearization import Linearization, Linearizations
from umo.testing import Scripted, periods, put

K_TABLE = {
    -200: -5.891, -150: -4.913, -100: -3.554, -50: -1.889, 0: 0.0, 25: 1.0, 50: 2.023, 100: 4.096, 150: 6.138,
    200: 8.138, 250: 10.153, 300: 12.209, 400: 16.397, 500: 20.644, 600: 24.905, 700: 29.129, 800: 33.275,
    900: 37.326, 1000: 41.276, 1100: 45.119, 1200: 48.838, 1300: 52.410, 1372: 54.886,
}  # fmt: skip
"""The published table of type K, mV by degC (NIST Monograph 175), printed to 1 uV."""
K = Thermocouple("K")
SQUARE = Polynomial([0.5, 1.0, 0.02], (-20.0, 20.0)).over(-10.0, 10.0)
FALLING = LookupTable([-20.0, 0.0, 30.0], [30.0, 0.0, -12.0])
KINDS = {"K": (K, -200.0, 1372.0), "polynomial": (SQUARE, -10.0, 10.0), "table": (FALLING, -12.0, 30.0)}


# The functions ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("temperature", "voltage"), K_TABLE.items())
def test_type_k_agrees_with_the_published_table(temperature: float, voltage: float) -> None:
    assert K.to_input(temperature) == pytest.approx(voltage, abs=0.0005001)
    slope = K.to_input(temperature + 0.5) - K.to_input(temperature - 0.5)
    assert K.to_value(voltage) == pytest.approx(temperature, abs=0.0005001 / slope)  # what 0.5 uV are
    assert abs(K.to_value(K.to_input(temperature)) - temperature) < 1e-5


@pytest.mark.parametrize("kind", KINDS)
@given(share=st.floats(-0.2, 1.2))
def test_a_value_goes_through_the_electrical_quantity_and_back(kind: str, share: float) -> None:
    """Also a little beyond the ends, where the function is a straight line."""
    linearization, low, high = KINDS[kind]
    value = low + share * (high - low)
    assert linearization.to_value(linearization.to_input(value)) == pytest.approx(value, abs=2e-9 * (high - low))


@pytest.mark.parametrize("kind", KINDS)
@given(xs=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20))
def test_the_scalar_and_the_array_form_give_the_identical_number(kind: str, xs: list[float]) -> None:
    linearization = KINDS[kind][0]
    many = np.array(xs)
    assert linearization.to_values(many).tolist() == [linearization.to_value(x) for x in xs]
    assert linearization.to_inputs(many).tolist() == [linearization.to_input(x) for x in xs]
    assert many.tolist() == xs


@pytest.mark.parametrize("kind", KINDS)
def test_the_function_is_strictly_monotonic_far_beyond_its_ends(kind: str) -> None:
    values = KINDS[kind][0].to_values(np.linspace(-1e3, 1e3, 20_001))
    assert (np.diff(values) > 0).all() or (np.diff(values) < 0).all()


def test_beyond_a_table_its_end_segments_go_on() -> None:
    table = LookupTable([0.0, 1.0, 3.0], [0.0, 10.0, 20.0])
    assert [table.to_value(x) for x in (-1.0, 0.5, 1.0, 2.0, 5.0)] == [-10.0, 5.0, 10.0, 15.0, 30.0]


def test_beyond_its_range_the_tangent_of_a_polynomial_goes_on() -> None:
    square = Polynomial([0.0, 0.0, 1.0], (0.0, 10.0)).over(1.0, 4.0)
    assert [square.to_value(x) for x in (0.5, 1.5, 3.0)] == pytest.approx([0.0, 2.25, 8.0])


def test_many_different_functions_are_one_calculation() -> None:
    """Sensors that were calibrated one by one; the numbers are those of each."""
    each: list[Linearization | None] = [
        Polynomial([0.01 * i, 1.0, 0.0005 * i], (-9.0, 9.0)).over(-5.0, 5.0) if i % 5 else None for i in range(1, 60)
    ]
    each += [K, FALLING, Thermocouple("K"), LookupTable(FALLING.inputs, FALLING.values)]
    xs = np.linspace(-9.0, 9.0, len(each))
    many = Linearizations(each)
    assert bool(many) is True
    pairs = list(zip(xs.tolist(), each, strict=True))
    assert many.to_values(xs).tolist() == [x if one is None else one.to_value(x) for x, one in pairs]
    everywhere = np.ones(len(xs), bool)
    assert many.to_inputs(xs, everywhere).tolist() == [x if one is None else one.to_input(x) for x, one in pairs]
    assert xs.tolist() == np.linspace(-9.0, 9.0, len(each)).tolist()
    assert bool(Linearizations([None, None])) is False


def test_a_polynomial_is_what_its_coefficients_say() -> None:
    xs = np.linspace(-13.0, 8.0, 1000)
    assert SQUARE.to_values(xs) == pytest.approx(0.5 + xs + 0.02 * xs**2, abs=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Thermocouple("X"), "no thermocouple of type 'X'; known: B, E, J, K"),
        (lambda: Thermocouple(["K"]), "no thermocouple of type"),  # type: ignore[arg-type]
        (lambda: LookupTable([0, 1], [0, 1, 2]), "it has 2 inputs and 3 values"),
        (lambda: LookupTable([0, 1, 1], [0, 1, 2]), "the inputs of a table must be strictly monotonic"),
        (lambda: LookupTable([0, 1, 2], [0, 2, 1]), "the values of a table must be strictly monotonic"),
        (lambda: LookupTable([0], [0]), "inputs must be a list of at least two finite numbers"),
        (lambda: LookupTable([0, math.nan], [0, 1]), "inputs must be a list of at least two finite numbers"),
        (lambda: Polynomial([1.0]), "coefficients must be a list of at least two finite numbers"),
        (lambda: Polynomial("12"), "coefficients must be a list"),  # type: ignore[arg-type]
        (lambda: Polynomial([0, 1], (2, 1)), r"the domain of a polynomial is \[from, to\], not \[2.0, 1.0\]"),
        (lambda: Polynomial([0, 0, 1]).over(1, 4), "at x = -2 to -1 and 1 to 2; name one as `domain`"),
        (lambda: Polynomial([0, 0, 1]).over(-1, 4), "does not cover -1 to 4, or is not strictly monotonic there"),
        (lambda: Polynomial([5, 0]).over(-1, 4), "does not cover -1 to 4, or is not strictly monotonic there"),
        (lambda: LookupTable([0, 1], [0, 10]).over(0, 11), "the table of 2 points covers 0 to 10, not 0 to 11"),
        (lambda: K.over(-271, 100), "the thermocouple K covers -270 to 1372, not -271 to 100"),
    ],
)
def test_a_faulty_function_is_refused_when_it_is_declared(make: Any, message: str) -> None:
    with pytest.raises(DeclarationError, match=message):
        make()


# Declared --------------------------------------------------------------------------------------------


def thermocouple(**changes: Any) -> DigitalSensor:
    given = {"minimum": 0.0, "maximum": 1300.0, "resolution": 0.002, "linearization": K} | changes
    return DigitalSensor("degC", **given)


def valve(**changes: Any) -> DigitalActuator:
    """10 V open it by 60 %: a table with a kink, from percent to V and back."""
    curve = LookupTable([0.0, 4.0, 10.0], [0.0, 10.0, 60.0])
    return actuator(**({"minimum": 0.0, "maximum": 60.0, "resolution": 0.01, "linearization": curve} | changes))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: thermocouple(linearization="K"),
            "linearization='K' is not a Polynomial, a LookupTable or a Thermocouple",
        ),
        (lambda: thermocouple(maximum=1400.0), "covers -270 to 1372"),
        (lambda: sensor(linearization=K), "the thermocouple K gives degC, the object has mm"),
        (lambda: thermocouple(invalid_raws=[1.5]), "invalid_raws must be a list of integers"),
        (lambda: thermocouple(invalid_raws=5), "invalid_raws must be a list of integers"),
        (lambda: valve(maximum=61.0), "covers 0 to 60"),
    ],
)
def test_an_object_refuses_what_does_not_fit_it(make: Any, message: str) -> None:
    with pytest.raises(DeclarationError, match=message):
        make()


def test_the_declaration_says_what_it_is() -> None:
    assert thermocouple().describe() == "0 to 1300 °C by 0.002 through a thermocouple K"
    assert DigitalSensor("degree_Celsius", minimum=0, maximum=1, resolution=1, linearization=K).linearization == K


pytestmark = pytest.mark.usefixtures("each_way")


@pytest.mark.parametrize("synchronous", [True, False])
def test_a_sensor_shows_the_value_of_its_voltage(synchronous: bool) -> None:
    box, machine = Scripted(), bench(encoder=thermocouple(synchronous=synchronous))
    with connect(machine, wired(machine, box)) as m:
        box.set("encoder", 41.276 / 0.002)
        box.set("encoder", 20638)
        m.sample()
        assert m.encoder.read() == pytest.approx(1000.01, abs=0.02)
        assert (m.encoder.raw, m.encoder.quality) == (20638, Quality.GOOD)
        put(m.encoder, 500.0)
        m.sample()
        assert m.encoder.read() == pytest.approx(500.0, abs=0.025)
        assert m.encoder.read_in("K") == pytest.approx(773.15, abs=0.025)
        put(m.encoder, 1300.2)
        m.sample()
        m.encoder.read()
        assert m.encoder.quality is Quality.OUT_OF_RANGE
        assert Vector([m.encoder]).read() == pytest.approx([1300.2], abs=0.03)


def test_the_range_ends_half_a_bit_of_the_electrical_quantity_beyond_it() -> None:
    box, machine = Scripted(), bench(encoder=thermocouple(minimum=-200.0, maximum=1372.0))
    least, most = round(K.to_input(-200.0) / 0.002), round(K.to_input(1372.0) / 0.002)
    box.set("encoder", [least, least - 1, most, most + 1])
    with connect(machine, wired(machine, box)) as m:
        seen = [m.encoder.quality]
        for _ in range(3):
            m.sample()
            seen.append(m.encoder.quality)
    assert seen == [Quality.GOOD, Quality.OUT_OF_RANGE, Quality.GOOD, Quality.OUT_OF_RANGE]


def test_a_falling_function_has_its_range_ends_the_other_way_round() -> None:
    box, machine = Scripted(), bench(encoder=sensor(maximum=30.0, resolution=0.1, linearization=FALLING))
    box.set("encoder", [0, 1, -200, -201])
    with connect(machine, wired(machine, box)) as m:
        seen = [(m.encoder.read(), m.encoder.quality)]
        for _ in range(3):
            m.sample()
            seen.append((m.encoder.read(), m.encoder.quality))
    assert [value for value, _ in seen] == pytest.approx([0.0, -0.04, 30.0, 30.15])
    assert [quality for _, quality in seen] == [Quality.GOOD, Quality.OUT_OF_RANGE] * 2


def test_an_actuator_sends_the_inverse_of_its_value() -> None:
    box, machine = Scripted(), bench(motor=valve(default=5.0))
    with connect(machine, wired(machine, box)) as m:
        assert box.get("motor") == 200  # 2 V
        for value, raw in ((0.0, 0), (10.0, 400), (35.0, 700), (60.0, 1000), (20.001, 520)):
            assert m.motor.write(value) is True
            m.update()
            assert (m.motor.read(), m.motor.raw, box.get("motor")) == (value, raw, raw)
            assert Vector([m.motor]).write([value]) is True
            m.update()
            assert (m.motor.read(), m.motor.raw, box.get("motor")) == (value, raw, raw)
        m.motor.reset()
        assert box.get("motor") == 200
    assert box.get("motor") == 200


def test_clamping_slew_rate_expiry_and_interlocks_act_on_the_value() -> None:
    class Guarded(Bench):
        def interlocks(self):  # type: ignore[no-untyped-def]
            yield Interlock(lambda: self.encoder.read() > 50.0, [self.motor], "it is too hot")

    box = Scripted()
    machine = Guarded(**vars_of(bench(motor=valve(limits="clamp", slew_rate=10_000.0, expires="5 ms"))))
    with connect(machine, wired(machine, box)) as m:
        assert m.motor.write(99.0) is False
        periods(m)
        assert (m.motor.read(), box.get("motor")) == (10.0, 400)
        periods(m, 9)
        assert (m.motor.read(), box.get("motor")) == (0.0, 0)  # it rose for 5 ms, then fell
        m.motor.write(60.0)
        periods(m, 2)
        assert (m.motor.read(), box.get("motor")) == (20.0, 520)
        put(m.encoder, 51.0)
        periods(m)
        assert (m.motor.read(), box.get("motor"), m.motor.write(1.0)) == (0.0, 0, False)


def vars_of(machine: Bench) -> dict[str, Any]:
    """The parts of a machine, without their parent."""
    parts = dict(children(machine))
    for part in parts.values():
        part._parent = None
    return parts


def test_a_range_that_is_not_whole_bits_is_kept_by_single_writes_and_by_vectors() -> None:
    box, machine = Scripted(), bench(motor=valve(resolution=0.3))
    with connect(machine, wired(machine, box)) as m:
        m.motor.write(60.0)
        m.update()
        assert box.get("motor") == 33  # 9.9 V; 34 would be 10.2 V, beyond 60 %
        Vector([m.motor]).write([60.0])
        m.update()
        assert box.get("motor") == 33


def test_a_software_reference_needs_a_linear_sensor() -> None:
    box, machine = Scripted(), bench(encoder=thermocouple(incremental=True))
    with connect(machine, wired(machine, box)) as m:
        with pytest.raises(DeclarationError, match=r"encoder: referenced\(at=...\) is for sensors without a linear"):
            m.encoder.referenced(at=20.0)
        m.encoder.referenced()
        assert m.encoder.quality is Quality.GOOD


# Wired -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"thermocouple": "K"}, K),
        ({"polynomial": [0, 10], "domain": [0, 200]}, Polynomial([0.0, 10.0], (0.0, 130.0))),
        ({"table": [[0, 100], [0, 1300]]}, LookupTable([0.0, 100.0], [0.0, 1300.0])),
        ({}, None),
    ],
)
def test_a_wiring_gives_replaces_or_removes_the_linearization(entry: Any, expected: Linearization | None) -> None:
    box, machine = Scripted(), bench(encoder=thermocouple(linearization=LookupTable([0.0, 1.0], [0.0, 1300.0])))
    declared = machine.encoder.linearization
    with connect(machine, wired(machine, box, entries={"encoder": {"linearization": entry}})) as m:
        found = m.encoder.linearization
        assert type(found) is type(expected)
        if isinstance(found, Polynomial) and isinstance(expected, Polynomial):
            assert found.domain == pytest.approx(expected.domain)
        else:
            assert found == expected
    assert machine.encoder.linearization == declared


def test_a_linearization_of_a_wiring_is_for_the_range_that_the_entry_narrows() -> None:
    machine = bench(encoder=thermocouple(minimum=-200.0, maximum=1372.0))
    entry = {"minimum": 0, "maximum": 100, "linearization": {"table": [[0, 5], [0, 100]]}}
    with connect(machine, wired(machine, Scripted(), entries={"encoder": entry})) as m:
        assert (m.encoder.minimum, m.encoder.maximum) == (0.0, 100.0)
        assert m.encoder.linearization == LookupTable([0.0, 5.0], [0.0, 100.0])
    for minimum, key in ((-1, "linearization"), (-300, "minimum"), (200, "")):
        faults = check(machine, wired(machine, Scripted(), entries={"encoder": entry | {"minimum": minimum}}))
        assert f'wire."encoder"{"." * bool(key)}{key}' in [fault.key for fault in faults]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"thermocouple": "Q"}, "no thermocouple of type 'Q'; known: B, E, J, K"),
        ({"thermocouple": "K", "table": [[0, 1], [0, 1]]}, "must have one of thermocouple, polynomial, table"),
        ({"thermocouple": "K", "domain": [0, 1]}, "domain is for a polynomial"),
        ({"polynomial": [0, "1"]}, "coefficients must be a list of at least two finite numbers, not [0, '1']"),
        ({"polynomial": [0, 0, 1], "domain": 3}, "domain must be a list of at least two finite numbers, not 3"),
        ({"polynomial": [0, 1e300, 1e-300]}, "the polynomial of degree 2"),
        ({"table": [[0, 1]]}, "table must be two lists, [[inputs], [values]], not [[0, 1]]"),
        ({"table": [[0, 1], [0, 20]]}, "the table of 2 points covers 0 to 20, not 0 to 1300"),
        ("K", "must be a table, not 'K'"),
    ],
)
def test_a_fault_of_the_wiring_names_its_key(entry: Any, message: str) -> None:
    machine = bench(encoder=thermocouple())
    faults = check(machine, wired(machine, Scripted(), entries={"encoder": {"linearization": entry}}))
    assert [fault.key for fault in faults] == ['wire."encoder".linearization']
    assert message in faults[0].message


def test_an_unknown_key_of_a_linearization_is_named_with_the_nearest() -> None:
    machine = bench(encoder=thermocouple())
    faults = check(machine, wired(machine, Scripted(), entries={"encoder": {"linearization": {"thermocoupel": "K"}}}))
    assert [fault.key for fault in faults] == ['wire."encoder".linearization.thermocoupel']
    assert "unknown key (did you mean 'thermocouple'?); known: thermocouple, polynomial, tab" in faults[0].message


def test_the_raw_integers_of_the_range_must_fit_the_channel() -> None:
    from umo.drivers import Channel, Direction

    box = Scripted(channels=[Channel("adc", Direction.INPUT, 12)])
    entry = {"channel": "adc"}
    machine = bench(encoder=thermocouple())
    faults = check(machine, wired(machine, Scripted(), entries={"encoder": entry | {"driver": "adc"}}, adc=box))
    assert "the range needs raw values 0 to 26205, channel 'adc' has 12 bits: 0 to 4095" in str(faults[0])


def test_a_linearization_is_for_digital_objects() -> None:
    machine = bench()
    entry = {"limit": {"linearization": {"thermocouple": "K"}}, "valve": {"invalid_raws": [3]}}
    faults = check(machine, wired(machine, Scripted(), entries=entry))
    assert [fault.message for fault in faults] == ["is for digital objects; this one is binary"] * 2


# Readings that the circuit calls invalid -------------------------------------------------------------


@pytest.mark.parametrize("synchronous", [True, False])
@pytest.mark.parametrize("raw", [32767, 100])  # beyond the range, and within it
@pytest.mark.parametrize("linearization", [K, None])
def test_an_invalid_raw_is_a_failed_reading(synchronous: bool, raw: int, linearization: Any) -> None:
    from umo.errors import DriverError

    device = thermocouple(linearization=linearization, synchronous=synchronous, invalid_raws=(raw, -32768))
    box, machine = Scripted(), bench(encoder=device)
    with (connection := connect(machine, wired(machine, box))) as m:
        image = connection.image
        for each in (raw, -32768):
            box.set("encoder", 200)
            m.sample()
            good = m.encoder.read(), m.encoder.time
            box.set("encoder", each)
            m.timer.read()
            with pytest.raises(DriverError, match=rf"the circuit reports an invalid reading \(raw {each}\); encoder"):
                m.sample() if synchronous else m.encoder.read()
            assert (m.encoder.raw, m.encoder.quality) == (each, Quality.BAD)
            assert (image.values[image.slot_of[id(m.encoder)]], m.encoder.time) == good


def test_a_wiring_gives_the_invalid_raws_of_its_circuit() -> None:
    box, machine = Scripted(), bench(encoder=sensor(on_error="mark", invalid_raws=[5]))
    with connect(machine, wired(machine, box, entries={"encoder": {"invalid_raws": [7]}})) as m:
        for raw, quality in ((5, Quality.GOOD), (7, Quality.BAD)):
            box.set("encoder", raw)
            m.sample()
            assert m.encoder.quality is quality


def test_the_lint_finds_invalid_raws_that_cannot_be_read() -> None:
    from umo.drivers import Channel, Direction

    box = Scripted(channels=[Channel("adc", Direction.BOTH, 16, signed=True)])
    entries = {
        "encoder": {"driver": "adc", "channel": "adc", "invalid_raws": [32768, 32767]},
        "motor": {"invalid_raws": [1]},
    }
    machine = bench()
    with pytest.raises(WiringError) as caught, connect(machine, wired(machine, Scripted(), entries=entries, adc=box)):
        pass
    assert [(fault.key, fault.message) for fault in caught.value.mistakes] == [
        ('wire."motor".invalid_raws', "is for sensors; this is an actuator"),
        ('wire."encoder".invalid_raws', "32768 cannot be read: channel 'adc' has -32768 to 32767"),
    ]
