"""Whatever translation took as known, whoever sets it, when, in whatever way: compiled laws write what Python
writes, in each period."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.generating import needs_a_compiler
from helpers.known_runs import AFTER, BY, Setting, check
from helpers.known_things import WAYS
from helpers.tiers import some
from umo.generate.compiled_laws import COMPARED

pytestmark = needs_a_compiler
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
    monkeypatch.setitem(WAYS, "tune", lambda module, m: m._machine.whole.directory.tunables[name].set(20.0))
    assert check([("tune", AFTER, "client")]).state == ("python" if name == "PV" else "compiled")


def test_without_the_extension_it_is_seen_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.generate.known_watch.extension", None)
    assert check([]).state == "compiled"
    for way in ("list, inserted", "class, number", "global", "cell", "global array"):
        assert check([(way, AFTER, "client")]).state == "python"


def test_it_is_told_by_name_with_the_line_that_set_it_and_the_line_that_read_it() -> None:
    told = check([("text", AFTER, "client")]).events.rpartition("not compiled: ")[2]
    assert "Tank.mode_name was set (helpers/known_things.py:" in told and "which known_things.py:" in told
