"""The name of a user in events and leases."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from umo.clients.remote.who import who_text
from umo.process.frames.layout import NAME

ENDING = ", unverified (page, 2001:db8:1111:2222:3333:4444:5555:6666)"


@given(st.text(), st.sampled_from([ENDING, " (page, 127.0.0.1)", ", unverified (sparkplug)"]))
def test_what_tells_whether_a_name_is_proved_is_never_cut(name: str, ending: str) -> None:
    told = who_text(name, ending)
    assert told.endswith(ending)
    assert len(told.encode()) <= NAME


def test_a_name_of_two_bytes_a_letter_is_cut_in_bytes() -> None:
    name = "Александра Константиновна Рождественская"
    assert who_text(name, ", unverified (page, 10.0.0.7)") == "Александра Констан, unverified (page, 10.0.0.7)"


def test_who_gives_no_name_is_nobody() -> None:
    assert who_text(" \n", " (page, 127.0.0.1)") == "nobody (page, 127.0.0.1)"
