"""An attribute that no class declares is refused where it is assigned, with the nearest one, which is named also where
one is read that there is not (docs/decisions/0083)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import pytest

import umo
from helpers.machines import actuator, bench, timer
from umo import Compound, DigitalActuator, DigitalSensor, connect
from umo.errors import DeclarationError, text_of
from umo.operation import PackML
from umo.states import OnOff, PassFail
from umo.testing import periods


class Zone(Compound):
    heater: DigitalActuator
    limit: float = 3.0
    spare: int

    def setup(self) -> None:
        self.count = 0
        _give(self)


def _give(zone: Any) -> None:
    """What `setup` calls may give it attributes, too."""
    zone.given = 1


class Mixed:
    """A mixin that knows nothing of umo."""

    tags = ()

    def mark(self) -> None:
        self.marked = True


class Oven(Mixed, Compound):
    timer: DigitalSensor
    zone: Zone
    target: float = 20.0
    log = None

    def control(self) -> None:
        self.started = self.now
        later = lambda: setattr(self, "_private", 1)  # noqa: E731
        later()

    @cached_property
    def costly(self) -> float:
        return 3.0

    @property
    def shown(self) -> float:
        return self._shown_value

    @shown.setter
    def shown(self, value: float) -> None:
        self._shown_value = value


def oven(kind: type[Oven] = Oven) -> Oven:
    return kind(timer=timer(), zone=Zone(heater=actuator(), spare=1))


def test_a_misspelt_attribute_is_refused_with_the_nearest_one() -> None:
    m = oven()
    with pytest.raises(AttributeError, match=r"^Oven has no attribute 'tagret' \(did you mean 'target'\?\)"):
        m.tagret = 100.0  # type: ignore[attr-defined]
    assert not hasattr(m, "tagret")
    with pytest.raises(AttributeError, match=r"^zone has no attribute 'limt' \(did you mean 'limit'\?\)"):
        m.zone.limt = 1.0  # type: ignore[attr-defined]
    with pytest.raises(
        AttributeError, match=r"^Oven has no attribute 'xyz'; give a new attribute its first value in the cl"
    ):
        m.xyz = 1  # type: ignore[attr-defined]


def test_the_run_ends_with_file_and_line() -> None:
    async def bake(m: Any) -> None:
        m.tagret = 180.0

    with pytest.raises(AttributeError) as raised:
        umo.run(oven(), None, bake)
    line = bake.__code__.co_firstlineno + 1
    assert "(did you mean 'target'?); give a new attribute its first value in the class or in `setup` (" in text_of(
        raised.value
    )
    assert f"test_undeclared_attributes.py:{line} in bake)" in text_of(raised.value)


@pytest.mark.parametrize("name", ["target", "log", "started", "marked", "tags", "shown", "_anything"])
def test_what_a_class_declares_is_assigned(name: str) -> None:
    m = oven()
    setattr(m, name, 5)
    assert getattr(m, name) == 5


@pytest.mark.parametrize("name", ["limit", "spare", "count", "given"])
def test_what_setup_gave_is_assigned(name: str) -> None:
    zone = oven().zone
    setattr(zone, name, 5)
    assert getattr(zone, name) == 5


def test_a_machine_goes_on_as_before() -> None:
    m = oven()
    assert (m.costly, m.costly) == (3.0, 3.0)
    with connect(m) as connected:
        periods(connected, 2)
        connected.costly = 4.0
        assert connected.started >= 0.0


def test_an_object_that_makes_itself_has_what_it_assigns() -> None:
    class Own(Oven):
        def __init__(self) -> None:
            super().__init__(timer=timer(), zone=Zone(heater=actuator(), spare=1))
            for name in ("first", "second"):
                setattr(self, name, 0)

    own: Any = Own()
    own.first, own.second = 1, 2
    assert (own.first, own.second) == (1, 2)
    with pytest.raises(AttributeError, match="did you mean 'first'"):
        own.frist = 1


def test_setup_of_what_contains_a_part_gives_it_an_attribute_but_for_a_slip() -> None:
    class Line(Compound):
        zones: list[Zone]
        misspelt: bool = False

        def setup(self) -> None:
            for number, zone in enumerate(self.zones):
                given: Any = zone
                given.number = number
                if self.misspelt:
                    given.limti = 3.0

    zones: list[Any] = [Zone(heater=actuator(), spare=0)]
    assert Line(zones=zones).zones[0].number == 0  # type: ignore[attr-defined]
    zones[0].number = 5
    with pytest.raises(AttributeError, match=r"did you mean 'limit'"):
        Line(zones=[Zone(heater=actuator(), spare=0)], misspelt=True)


def test_a_class_may_get_an_attribute_later() -> None:
    class Late(Oven):
        pass

    m: Any = oven(Late)
    Late.extra = 1  # type: ignore[attr-defined]
    m.extra = 2
    assert (m.extra, Late.extra) == (2, 1)  # type: ignore[attr-defined]


def test_a_slip_of_the_finger_in_its_own_class_is_refused_when_the_class_is_made() -> None:
    with pytest.raises(DeclarationError, match=r"Hot\.tagret is assigned and never read \(did you mean 'target'\?\)"):

        class Hot(Oven):
            async def bake(self) -> None:
                self.tagret = 180.0


def test_a_name_like_another_one_is_declared_where_it_is_read_or_given_in_setup() -> None:
    class Read(Oven):
        def control(self) -> None:
            self.tagret = 1.0
            self.target = self.tagret

    class Given(Oven):
        def setup(self) -> None:
            self.tagret = 0.0

        def control(self) -> None:
            self.tagret = 1.0

    class Other(Oven):
        def control(self) -> None:
            self.targets = self.target2 = self.reset_time = 1.0

    assert oven(Read).target == oven(Given).target == oven(Other).target


@pytest.mark.parametrize(
    ("name", "meant", "is_slip"),
    [
        ("tagret", "target", True),
        ("targt", "target", True),
        ("targget", "target", True),
        ("targets", "target", False),
        ("target", "targets", False),
        ("phase2", "phase1", False),
        ("phase1", "phase", False),
        ("state", "stage", False),
        ("rest", "reset", True),
        ("on", "no", False),
        ("target", "target", False),
    ],
)
def test_a_slip_is_one_letter_within_a_word(name: str, meant: str, is_slip: bool) -> None:
    from umo.objects.stored_names import is_slip as found

    assert found(name, meant) is is_slip


def test_a_value_in_the_place_of_an_object_is_told_how_it_is_written() -> None:
    m = bench()
    with pytest.raises(
        DeclarationError, match=r"Bench\.valve is a part.*its value is written: `valve\.write\(OnOff\.ON\)`"
    ):
        m.valve = OnOff.ON
    with pytest.raises(DeclarationError, match=r"limit is a part; parts cannot be replaced; a sensor is only read"):
        m.limit = PassFail.PASS


@pytest.mark.parametrize("name", ["state", "value", "pending", "foo"])
def test_an_attribute_of_an_object_is_refused_with_the_way_to_write_it(name: str) -> None:
    m = bench()
    with pytest.raises(AttributeError, match=r"; its value is written: `valve\.write\(\.\.\.\)`"):
        setattr(m.valve, name, OnOff.ON)
    with pytest.raises(AttributeError, match="; a sensor is only read"):
        setattr(m.encoder, name, 1.0)


def test_a_class_of_sensors_of_the_users_has_attributes_of_its_own() -> None:
    class Probe(DigitalSensor):
        def __init__(self) -> None:
            super().__init__("mm", minimum=0.0, maximum=1.0, resolution=0.1)
            self.offset = 0.0

    probe = Probe()
    probe.offset = 1.0
    with pytest.raises(AttributeError, match="Probe has no attribute 'ofset'; a sensor is only read"):
        probe.ofset = 1.0  # type: ignore[attr-defined]


def test_states_of_a_part_have_only_their_own_attributes() -> None:
    class States(PackML):
        rejected_weight = 0.0

        async def execute(self) -> None:
            self.recipe = "glue"

    class Unit(Compound, equipment=True):
        motor: DigitalActuator

        def setup(self) -> None:
            self.unit = States(self)

    unit: Any = Unit(motor=actuator()).unit
    unit.produced, unit.recipe, unit.rejected_weight = 3, "paint", 1.0
    with pytest.raises(AttributeError, match=r"States has no attribute 'prodced' \(did you mean 'produced'\?\)"):
        unit.prodced = 4


class Colour(Compound):
    motor: DigitalActuator

    def __dir__(self) -> list[str]:
        raise RuntimeError("no names")


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (lambda m: m.motr, "AttributeError: 'Bench' object has no attribute 'motr' (did you mean 'motor'?)"),
        (lambda m: m.motor.wite(1), "has no attribute 'wite' (did you mean 'write'?)"),
        (lambda m: m.valve.state, "has no attribute 'state' (did you mean 'read()'?)"),
        (lambda m: m.motor.value, "has no attribute 'value' (did you mean 'read()'?)"),
        (lambda m: OnOff.ONN, "ONN (did you mean 'ON'?)"),
        (lambda m: m.cycle.strat, "(did you mean 'start'?)"),
        (lambda m: Colour(motor=actuator()).motr, "has no attribute 'motr' ("),
    ],
    ids=["compound", "object", "its state", "its value", "state", "cycle", "no names"],
)
def test_an_attribute_that_is_read_is_told_with_the_nearest_one(read: Any, text: str) -> None:
    with pytest.raises(AttributeError) as raised:
        read(bench())
    assert text in text_of(raised.value)


def test_parts_in_lists_too() -> None:
    class Line(Compound):
        zones: list[Zone]

    line = Line(zones=[Zone(heater=actuator(), spare=n) for n in range(3)])
    with pytest.raises(AttributeError, match=r"^zones\.2 has no attribute 'spre' \(did you mean 'spare'\?\)"):
        line.zones[2].spre = 1  # type: ignore[attr-defined]
