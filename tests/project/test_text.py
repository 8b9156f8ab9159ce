"""Words for messages: places, paths, lists of names."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import umo
from umo.text import LIBRARY, MAX_WORD, Moment, count_of, cut_words, others, place_among, place_of, shown_path, some

OWN = str(Path(umo.__file__).parent)
SHIPPED = f"{OWN}/stations/ztheta/control.py"


def raised(work: Callable[[], object]) -> BaseException:
    with pytest.raises(Exception) as caught:
        work()
    return caught.value


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ([("/u/a.py", 1, "main"), (f"{OWN}/control/servo.py", 9, "control")], "/u/a.py:1 in main"),
        ([("/u/a.py", 1, "main"), (f"{LIBRARY}json/decoder.py", 9, "decode")], "/u/a.py:1 in main"),
        ([("/u/a.py", 1, "main"), ("/v/site-packages/numpy/x.py", 9, "f")], "/u/a.py:1 in main"),
        ([(f"{LIBRARY}x.py", 1, "f"), ("/v/site-packages/own/x.py", 9, "g")], "/v/site-packages/own/x.py:9 in g"),
        ([("/u/a.py", 1, "main"), (SHIPPED, 9, "carry")], f"{SHIPPED}:9 in carry"),
        ([("/u/a.py", 3, "<module>")], "/u/a.py:3"),
        ([(f"{OWN}/cycle/run.py", 1, "drive"), (f"{LIBRARY}x.py", 1, "f")], ""),
        ([], ""),
    ],
)
def test_a_place_is_the_innermost_frame_that_is_neither_umos_nor_pythons(
    frames: list[tuple[str, int, str]], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.text._relative", lambda file, folder: file)  # the current folder is far away
    assert place_among(frames) == expected


def test_the_place_of_an_error_names_the_line_that_raised_it() -> None:
    error = raised(lambda: int("x"))
    line = raised.__code__.co_firstlineno
    assert place_of(error).partition(":")[0].endswith("test_text.py")
    assert place_of(error).endswith("in <lambda>")
    assert line < int(place_of(error).partition(":")[2].split()[0])
    assert place_of(raised(lambda: np.zeros(3).reshape(7))).endswith("in <lambda>")
    assert place_of(ValueError("never raised")) == ""


def test_a_path_is_relative_to_the_current_folder_where_that_is_shorter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert shown_path(str(tmp_path / "own" / "control.py")) == "own/control.py"
    assert shown_path("/a.py") == "/a.py"
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert shown_path("/a/b.py") == "/a/b.py"


def test_a_list_of_names_ends_with_the_number_of_the_others() -> None:
    assert some([]) == ""
    assert some(["a", "b", "c"]) == "a, b and c"
    assert some([f"z.{i}" for i in range(40)]) == "z.0, z.1 and 38 others"
    assert (others(1), others(2)) == ("1 other", "2 others")


@pytest.mark.parametrize(
    ("seconds", "text"), [(3.21, "3.21"), (0.0004, "0"), (65.0, "65"), (1e6 + 0.125, "1000000.125")]
)
def test_a_moment_has_milliseconds(seconds: float, text: str) -> None:
    assert Moment.at(seconds) == f"at {text} s"


@given(st.text(), st.integers(MAX_WORD + 1, 5000), st.text())
def test_what_a_message_echoes_is_cut_and_what_is_around_it_is_not(before: str, length: int, after: str) -> None:
    text = cut_words(f"{before} no object '{'x' * length}' in {after}")
    assert max(map(len, re.split(r"[\s/]+", text))) <= MAX_WORD
    assert text == cut_words(text)
    assert f" no object '{'x' * 20}" in text
    assert f"{'x' * 15}' in " in text


@given(st.lists(st.text(st.characters(blacklist_categories=["Z", "C"], blacklist_characters="/"), max_size=MAX_WORD)))
def test_a_path_of_usual_names_is_never_cut(names: list[str]) -> None:
    path = "/".join(names)
    assert cut_words(path) == path


def test_one_of_a_kind_is_counted_without_the_plural() -> None:
    assert [count_of(number, "period") for number in (0, 1, 3741)] == ["0 periods", "1 period", "3,741 periods"]
