"""Whatever translation took as known, whoever sets it, when, in whatever way: compiled laws write what Python
writes, in each period."""

from __future__ import annotations

from contextlib import ExitStack
from itertools import product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.generating import Fragile, needs_a_compiler, wired
from helpers.known_things import WAYS, loaded
from helpers.tiers import some
from umo.cycle.connect import connect
from umo.cycle.sequences import next_period
from umo.generate.compiled_laws import COMPARED, CompiledLaws, prepare
from umo.testing import VirtualTimer
from umo.wiring import resolve

pytestmark = needs_a_compiler
PERIODS = COMPARED + 12
AFTER = COMPARED + 5
"""A period in which the laws are compiled."""
BY = "client", "sequence", "observer", "after sample"
"""Who sets it: between two periods, in the sequences of one, after one, between `sample` and `control`."""
KEEPS = {
    "number",
    "number by getattr",
    "state",
    "element of a list",
    "element of an array",
    "list of another",
    "array of another",
    "in what others have",
    "object, field of its class",
}
"""Ways that leave the laws compiled: what is set is tracked."""
Setting = tuple[str, int, str]
"""The way, the period and who."""


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


class Played:
    """One machine, compiled or not, in which things are set."""

    def __init__(self, compiled: bool, set_at: list[Setting]) -> None:
        self._settings = set_at
        self.refused: list[str] = []
        self.module = loaded()
        machine = self.module.tank()
        box = Fragile()
        box.set("level", 20)
        wiring = resolve(machine, wired(machine, box, VirtualTimer()))
        self.laws: CompiledLaws | None = None
        with ExitStack() as stack:
            prepared = prepare(machine, wiring) if compiled else None
            self._connection = connect(machine, wiring)
            self.m: Any = stack.enter_context(self._connection)
            if prepared is not None:
                self.laws = CompiledLaws(prepared, self._connection.machine)
                stack.callback(self.laws.release)
            self._connection.machine.observers.append(lambda frame: self._act("observer"))
            self.m.cycle.start(self._sequence())
            self.written = [self._period(number) for number in range(PERIODS)]
            self.state = "python" if self.laws is None else self.laws.state
        self.events = "; ".join(each.text for each in self._connection.machine.events)

    async def _sequence(self) -> None:
        while True:
            self._act("sequence")
            await next_period()

    def _period(self, number: int) -> str:
        """What is written, or the class of the error."""
        self._number = number
        self._act("client")
        self.m.timer.read()
        self.m.sample()
        self._act("after sample")
        try:
            self.m.control()
        except Exception as error:
            return type(error).__name__
        finally:
            self.m.update()
        return f"{self.m.a.pending:.6f} {self.m.b.pending:.6f} {self.m.total:.6f}"

    def _act(self, who: str) -> None:
        for way, number, by in self._settings:
            if (number, by) == (self._number, who):
                try:
                    WAYS[way](self.module, self.m)
                except (AttributeError, LookupError, TypeError, ValueError) as error:  # it was deleted before
                    self.refused.append(type(error).__name__)


def check(set_at: list[Setting]) -> Played:
    python, compiled = Played(False, set_at), Played(True, set_at)
    assert compiled.written == python.written, f"{compiled.state}: {compiled.events}"
    assert compiled.refused == python.refused
    return compiled


def test_without_a_setting_the_laws_are_compiled() -> None:
    assert check([]).state == "compiled"


@pytest.mark.parametrize("way", some(lambda way: list(WAYS).index(way) % 6 == 0, WAYS))
def test_what_is_set_after_the_comparison_counts_in_the_same_period(way: str) -> None:
    played = check([(way, AFTER, "sequence")])
    assert (played.state == "compiled") == (way in KEEPS)
    if played.state == "python":
        assert played.events.count("the laws run in Python, not compiled: ") == 1


@pytest.mark.full
@pytest.mark.parametrize("way", WAYS)
def test_it_counts_whenever_and_by_whomever_it_is_set(way: str) -> None:
    for number, by in product((0, 7, COMPARED, AFTER), BY):
        check([(way, number, by)])


SETTINGS = st.lists(
    st.tuples(st.sampled_from(sorted(WAYS)), st.sampled_from((2, 11, AFTER, AFTER + 3)), st.sampled_from(BY)),
    min_size=2,
    max_size=4,
)


@given(SETTINGS)
@settings(max_examples=12, derandomize=True)
def test_several_settings_are_as_in_python(set_at: list[Setting]) -> None:
    check(set_at)


@pytest.mark.full
@given(SETTINGS)
@settings(max_examples=1_500)
def test_any_settings_are_as_in_python(set_at: list[Setting]) -> None:
    check(set_at)


@pytest.mark.parametrize("name", ["PV", "bias"])
def test_a_client_that_tunes_is_seen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(WAYS, "tune", lambda module, m: m._machine.tunables[name].set(20.0))
    assert check([("tune", AFTER, "client")]).state == ("python" if name == "PV" else "compiled")


def test_without_the_extension_it_is_seen_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.generate.known_watch.extension", None)
    for way in ("list, inserted", "class, number", "global", "cell", "global array"):
        assert check([(way, AFTER, "client")]).state == "python"


def test_it_is_told_by_name_with_the_line_that_set_it_and_the_line_that_read_it() -> None:
    told = check([("text", AFTER, "client")]).events.rpartition("not compiled: ")[2]
    assert "Tank.mode_name was set (helpers/known_things.py:" in told and "which known_things.py:" in told
