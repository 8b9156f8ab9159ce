"""Recipes: typed values from files and from clients, refused as a whole; chosen between batches."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from enum import Enum
from math import inf, nan
from pathlib import Path
from shutil import copytree
from typing import Annotated, Any

import pytest
from click.testing import Result
from hypothesis import given
from hypothesis import strategies as st

import umo
from helpers import brewing
from helpers.machines import timer
from helpers.waiting import until
from umo import Compound, DigitalSensor, Number, connect, published
from umo.cycle.events import CommandState
from umo.errors import DeclarationError, RangeError, RecipeError, UmoError
from umo.objects import Range
from umo.operation.recipe_book import MAX_RECORDED, RecipeBook
from umo.operation.recipes import Recipe, read_recipes, recipe_from_content, recipe_of
from umo.process.frames import Reader
from umo.process.kept_file import NUMBERS
from umo.process.kept_sections import sections_of
from umo.process.station import find
from umo.testing import periods
from umo_command.tune import recipe_list as recipe_list
from umo_command.tune.recipe_list import _named


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


class Batch(Recipe):
    temperature: Annotated[float, Number("degC", 20.0, 95.0)]
    hold: Annotated[float, Number("s", 0.0, 3600.0)] = 60.0
    amounts: Annotated[tuple[float, float], Number("kg", 0.0, 50.0)] = (1.0, 2.0)
    cycles: Annotated[int, Number("", 1, 10)] = 1
    rinse: bool = False
    note: str = ""
    colour: Colour = Colour.RED
    steps: Annotated[tuple[float, ...], Number("mm", 0.0, 9.0)] = ()


def recipe(**values: Any) -> Batch:
    return recipe_of(Batch, "one", {"temperature": 30.0, **values})


def refused(**values: Any) -> str:
    with pytest.raises(RecipeError) as caught:
        recipe(**values)
    return str(caught.value)


VALUES = st.fixed_dictionaries(
    {
        "temperature": st.floats(20.0, 95.0),
        "hold": st.floats(0.0, 3600.0),
        "amounts": st.lists(st.floats(0.0, 50.0), min_size=2, max_size=2),
        "cycles": st.integers(1, 10),
        "rinse": st.booleans(),
        "note": st.text(st.characters(exclude_categories=["Cs"]), max_size=20),
        "colour": st.sampled_from(["RED", "BLUE"]),
        "steps": st.lists(st.floats(0.0, 9.0), max_size=4),
    }
)


@given(VALUES)
def test_what_a_client_sends_is_the_same_recipe_in_the_machine(values: dict[str, Any]) -> None:
    sent = recipe_of(Batch, "one", values)
    received = recipe_from_content(Batch, "one", sent.content)
    assert (received, received.hash, received.values) == (sent, sent.hash, values)


JUNK = st.none() | st.booleans() | st.floats() | st.integers() | st.text() | st.lists(st.floats()) | st.just({})


@given(st.dictionaries(st.sampled_from(["temperature", "hold", "amounts", "cycles", "rinse", "colour", "x"]), JUNK))
def test_any_values_give_a_recipe_within_its_ranges_or_a_refusal(values: dict[str, Any]) -> None:
    try:
        found = recipe_of(Batch, "one", values)
    except RecipeError as error:
        assert error.mistakes
    else:
        assert 20.0 <= found.temperature <= 95.0 and 0.0 <= found.hold <= 3600.0
        assert all(0.0 <= each <= 50.0 for each in found.amounts) and len(found.amounts) == 2


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1.5 min", 90.0), ("90 s", 90.0), ("0.5h", 1800.0), ("2e3 ms", 2.0)],
)
def test_a_text_with_a_unit_is_converted(text: str, expected: float) -> None:
    assert recipe(hold=text).hold == expected


def test_a_temperature_is_converted_with_its_offset() -> None:
    assert recipe(temperature="122 degF").temperature == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"temperature": nan}, "nan is not a number in degC"),
        ({"temperature": inf}, "inf is not a number in degC"),
        ({"temperature": 96.0}, "outside"),
        ({"temperature": True}, "True is not a number"),
        ({"temperature": "warm"}, "'warm' is not a number in degC"),
        ({"hold": "3 kg"}, "cannot be converted"),
        ({"hold": "3 parsnips"}, "not a unit that pint knows"),
        ({"hold": "2 h"}, "outside"),
        ({"cycles": 1.5}, "not a whole number"),
        ({"rinse": 1}, "must be true or false, not 1"),
        ({"note": 3}, "must be a string, not 3"),
        ({"colour": "BLEU"}, "did you mean 'BLUE'?"),
        ({"amounts": [1.0]}, "must be a list of 2, not of 1"),
        ({"amounts": [1.0, 51.0]}, "outside"),
        ({"amounts": 3.0}, "must be a list, not 3.0"),
        ({"hold": "20"}, """'20' is not a number in s, or a string such as "1.5 s\""""),
        ({"temperatur": 3.0}, "unknown key (did you mean 'temperature'?)"),
    ],
)
def test_a_wrong_value_is_told(values: dict[str, Any], message: str) -> None:
    assert message in refused(**values)


def test_a_default_is_checked_and_of_its_type() -> None:
    class Odd(Recipe):
        hold: Annotated[float, Number("s", 0.0, 10.0)] = 50.0
        speed: Annotated[float, Number("rpm", 0.0, 10.0)] = 1

    with pytest.raises(RecipeError, match=r"hold: its default: 50 s is outside 0 to 10"):
        recipe_of(Odd, "one", {})
    left_out, given_it = recipe_of(Odd, "one", {"hold": 1}), recipe_of(Odd, "one", {"hold": 1, "speed": 1})
    assert left_out.hash == given_it.hash


@pytest.mark.parametrize("name", ["name", "values", "content", "hash"])
def test_a_field_with_the_name_of_what_every_recipe_has_is_refused(name: str) -> None:
    with pytest.raises(DeclarationError, match=rf"Odd\.{name}: every recipe has a '{name}'"):
        type("Odd", (Recipe,), {"__annotations__": {name: str}})


def test_all_mistakes_of_all_files_are_told_with_their_lines(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("# first\ntemperature = 300\n\nhodl = 3\n")
    (tmp_path / "b.toml").write_text("hold = 3\n")
    (tmp_path / "c.toml").write_text("hold = \n")
    with pytest.raises(RecipeError) as caught:
        read_recipes(Batch, tmp_path)
    first, second, third, fourth = sorted(map(str, caught.value.mistakes))
    assert first.startswith(f"{tmp_path}/a.toml:2: temperature: 300 °C is outside")
    assert second.startswith(f"{tmp_path}/a.toml:4: hodl: unknown key (did you mean 'hold'?)")
    assert third == f"{tmp_path}/b.toml: temperature: is missing"
    assert "c.toml: cannot be read" in fourth and "line 1" in fourth


def test_a_key_that_is_given_twice_is_named_with_its_first_line(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("temperature = 30\nhold = 3\ntemperature = 40\n")
    with pytest.raises(RecipeError, match="give each key only once: temperature is also in line 1"):
        read_recipes(Batch, tmp_path)


def test_one_file_may_have_a_table_for_each_recipe(tmp_path: Path) -> None:
    file = tmp_path / "all.toml"
    file.write_text("[one]\ntemperature = 30\n[two]\ntemperature = 40\n")
    assert [each.temperature for each in read_recipes(Batch, file).values()] == [30.0, 40.0]
    file.write_text("[one]\ntemperature = 30\n[two]\ntemperature = 400\n")
    with pytest.raises(RecipeError, match=r"all\.toml:4: temperature"):
        read_recipes(Batch, file)


@pytest.mark.parametrize("raw", [b"\xff\xfe", b"x" * 1_000_001, b"a = " + b"[" * 5000])
def test_a_file_that_cannot_be_read_is_a_mistake(tmp_path: Path, raw: bytes) -> None:
    (tmp_path / "a.toml").write_bytes(raw)
    with pytest.raises(RecipeError, match="cannot be read"):
        read_recipes(Batch, tmp_path)


def test_no_recipes_are_a_mistake(tmp_path: Path) -> None:
    for place in (tmp_path, tmp_path / "none.toml"):
        with pytest.raises(RecipeError, match=r"has no recipes|no such file"):
            read_recipes(Batch, place)


# The book --------------------------------------------------------------------------------------------


@pytest.fixture
def book(tmp_path: Path) -> RecipeBook[Batch]:
    (tmp_path / "a.toml").write_text("temperature = 30\n")
    (tmp_path / "b.toml").write_text("temperature = 40\n")
    return RecipeBook(Batch, tmp_path)


def test_a_choice_counts_with_the_next_batch_and_stays(book: RecipeBook[Batch]) -> None:
    current = book.next("a")
    book.choose("b")
    assert book.current is current
    assert [book.next("a").name, book.next("a").name] == ["b", "b"]


@pytest.mark.parametrize("content", ["", "[]", "{", '{"temperature": NaN}', '{"temperature": 96}', "[" * 100_000])
def test_a_refused_choice_leaves_the_earlier_one(book: RecipeBook[Batch], content: str) -> None:
    book.choose("b")
    before = book.chosen
    with pytest.raises(RecipeError):
        book.choose("other", content)
    assert book.chosen is before


@given(
    st.lists(st.one_of(st.floats(), st.integers(), st.booleans(), st.none(), st.text(max_size=3)), max_size=4),
    st.sampled_from([Range("", 0.0, 9.0), Range("mm", -inf, inf), Range("kg", -1.0, inf)]),
)
def test_a_range_admits_many_values_if_it_takes_each(values: list[Any], limits: Range) -> None:
    def is_taken(value: object) -> bool:
        try:
            limits.check("it", value)
        except RangeError:
            return False
        return True

    assert limits.admits(values) == all(map(is_taken, values))


def test_what_a_client_sends_has_no_units(book: RecipeBook[Batch]) -> None:
    assert recipe(temperature="86 degF").temperature == pytest.approx(30.0)
    with pytest.raises(RecipeError, match=r"'86 degF' is not a number in degC; a value that is sent must have no unit"):
        book.choose("other", '{"temperature": "86 degF"}')
    book.choose("other", '{"temperature": 30}')
    assert book.next().temperature == 30.0


def test_the_plan_is_followed_again_when_the_choice_is_forgotten(book: RecipeBook[Batch]) -> None:
    book.choose("b")
    assert book.next("a").name == "b"
    book.follow_plan()
    assert (book.chosen, book.next("a").name) == (None, "a")


def test_the_numbers_of_recipes_have_the_names_of_what_they_stand_for(book: RecipeBook[Batch]) -> None:
    names = book.numbers["choice"].names
    assert names[book.choice] == "the program's own"
    for choice, expected in (
        (("b",), "b"),
        (("b", '{"temperature": 41}'), "b, other values"),
        (("b", '{"temperature": 40}'), "b"),
        (("trial", '{"temperature": 41}'), "another one"),
    ):
        book.choose(*choice)
        assert names[book.choice] == expected
        assert book.begun == 0
    book.next()
    assert book.numbers["begun"].names[book.begun] == "another one"
    book.begin()
    assert book.numbers["begun"].names[book.begun] == "none"


def test_a_book_describes_its_recipes_with_units_and_bounds(book: RecipeBook[Batch]) -> None:
    about = book.describe()
    assert json.loads(json.dumps(about)) == about
    fields = {each["name"]: each for each in about["fields"]}
    assert fields["amounts"] == {"name": "amounts", "unit": "kg", "minimum": 0.0, "maximum": 50.0}
    assert fields["note"] == {"name": "note"}
    assert [each["name"] for each in about["recipes"]] == ["a", "b"]
    assert about["recipes"][1]["values"]["temperature"] == 40.0


def test_what_was_used_is_recorded_and_bounded(book: RecipeBook[Batch]) -> None:
    for number in range(MAX_RECORDED + 5):
        book.choose("b", json.dumps({"temperature": 30.0 + number / 10}))
        book.next()
    assert len(book.record) == MAX_RECORDED + 1
    assert book.record["others"] == {"batches": 5}
    first = next(iter(book.record.values()))
    assert (first["batches"], first["values"]["temperature"]) == (1, 30.0)


def mixer(place: Path) -> Any:
    class Mixer(Compound):
        timer: DigitalSensor

        def setup(self) -> None:
            self.book = RecipeBook(Batch, place)

    return Mixer(timer=timer())


def kept_of(connection: Any) -> dict[str, Any]:
    """What the keeper of a run would write now."""
    with published(connection, "mixer") as ring, Reader(ring.path) as reader:
        periods(connection.root, 2)
        kept: dict[str, Any] = sections_of(reader.layout)[NUMBERS](reader.latest())
    return kept


@pytest.mark.parametrize(
    ("chosen", "then", "why"),
    [
        (("b",), "b", ""),
        (("c",), None, "'c' is not one of the program's own, b, z"),
        (("b", '{"temperature": 41}'), None, "a client had sent the values of that recipe; choose the recipe again"),
        (("trial", '{"temperature": 41}'), None, "a client had sent the values of that recipe"),
        ((), None, ""),
    ],
)
def test_a_choice_is_kept_over_a_restart_by_its_name(tmp_path: Path, chosen: Any, then: str | None, why: str) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / f"{name}.toml").write_text("temperature = 30\n")
    first = connect(mixer(tmp_path))
    with first as m:
        if chosen:
            m.book.choose(*chosen)
        kept = kept_of(first)
    (tmp_path / "a.toml").rename(tmp_path / "z.toml")  # the numbers of the recipes are others now
    (tmp_path / "c.toml").unlink()
    (tmp_path / "b.toml").write_text("temperature = 31\n")
    again = connect(mixer(tmp_path))
    again.kept = kept
    with again as m:
        recipe = m.book.chosen
        assert (recipe and (recipe.name, recipe.temperature)) == (then and (then, 31.0))
        assert m.book.numbers["choice"].names[m.book.choice] == (then or "the program's own")
        assert again.not_restored.get("book.choice", "").startswith(why) and len(again.not_restored) == bool(why)


# A running station -----------------------------------------------------------------------------------


def test_a_client_changes_the_recipe_of_a_running_station_between_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))
    with umo.start(brewing.machine, brewing.WIRING, brewing.main) as started:
        until(lambda: started.poll() or started.values.get("heater") == 20.0)
        with umo.attach(started.pid) as station, station.lease("a test"):
            assert [each["path"] for each in station.reader.layout.books] == ["book"]
            assert station.book.choice == "the program's own"
            answer = station.book.choose("strong")
            until(lambda: started.poll() or started.values["heater"] == 70.0)
            assert (station.book.choice, station.book.begun) == ("strong", "strong")
            assert recipe_list._now(str(started.pid), "book").endswith("begun last: strong; chosen: strong")
            with pytest.raises(UmoError, match="heat: 101 % is outside 0 to 100"):
                station.book.choose("hot", '{"heat": 101}')
            station.book.choose("edited", '{"heat": 55.5}')
            until(lambda: started.poll() or started.values["heater"] == 55.5)
            done = [each for each in station.events if each.state is CommandState.DONE]
            assert any("strong" in each.asked and each.who and answer in each.text for each in done)
            station.book.choose("end", '{"heat": 0}')
        outcome = started.wait(30)
    assert outcome.status == 0
    used = {key.split()[0]: entry for key, entry in outcome.result["recipes"].items()}
    assert list(used) == ["mild", "strong", "edited", "end"]
    assert used["edited"]["values"] == {"heat": 55.5}


# The command -----------------------------------------------------------------------------------------


def test_umo_recipes_lists_values_with_their_units(umo: Callable[..., Result]) -> None:
    result = umo("tune", "recipe", "batch")
    assert result.exit_code == 0
    assert "amounts = 40.0, 20.0 kg" in result.output and "hold = 90.0 s" in result.output


def test_umo_check_refuses_a_wrong_recipe_with_its_line(umo: Callable[..., Result], tmp_path: Path) -> None:
    assert "3 recipes" in umo("check", "batch").output
    copied = copytree(find("batch").path, tmp_path / "own")
    (copied / "recipes" / "glue.toml").write_text("amounts = [40.0, 200.0]\ntemprature = 60\n")
    result = umo("check", str(copied))
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert lines[0].startswith("umo: the recipes are refused (")
    assert f"{copied}/recipes/glue.toml:1: amounts: 200 kg is outside 5 to 60" in lines
    numbers = [int(found[1]) for line in lines if (found := re.search(r"glue\.toml:(\d+): ", line))]
    assert numbers == [1, 2]  # a line each, in the order of the file


def test_umo_recipes_finds_a_recipe_in_whichever_part_has_it(tmp_path: Path) -> None:
    books = {}
    for part, names in {"mixer": "ab", "oven": "bc"}.items():
        (tmp_path / part).mkdir()
        for name in names:
            (tmp_path / part / f"{name}.toml").write_text("temperature = 30\n")
        books[f"{part}.book"] = RecipeBook(Batch, tmp_path / part)
    station = find("batch")
    assert _named(station, books, "c")[0] == "oven.book"
    with pytest.raises(RecipeError, match=r"several parts have a recipe 'b': umo do batch call mixer.book.choose"):
        _named(station, books, "b")
    with pytest.raises(RecipeError, match="no recipe 'd'; known: a, b, c"):
        _named(station, books, "d")


@pytest.mark.parametrize(
    ("words", "message"), [(["batch", "pant"], "did you mean 'paint'"), (["furnace"], "no recipes")]
)
def test_what_umo_recipes_cannot_do_is_told(umo: Callable[..., Result], words: list[str], message: str) -> None:
    result = umo("tune", "recipe", *words)
    assert result.exit_code == 2
    assert message in result.output + result.stderr
