"""`umo tune recipe`: lists the recipes of a machine, or chooses one."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from umo.digits import with_short_numbers
from umo.errors import OptionError, RecipeError, UmoError
from umo.objects import actions_of
from umo.operation.commands.verbs import CALL
from umo.operation.recipe_book import RecipeBook, books_of
from umo.operation.recipe_values import unit_of
from umo.operation.recipes import Recipe
from umo.process.frames.search import find_running
from umo.process.station import Station
from umo.signature import hints_of
from umo.text import did_you_mean
from umo_command.console import out
from umo_command.do.commanding import leased, station_of


def show_recipes(station: Station, running: str) -> int:
    """Print every recipe with its values and units. For a running station, also print which recipe was begun last and
    which one is next."""
    found = books_of(station.machine())
    if not found:
        raise OptionError(f"{station.name} has no recipes")
    for path, book in found.items():
        if now := _now(running, path):
            out.print(now, soft_wrap=True, markup=False)
        for recipe in book.recipes.values():
            out.print(f"{recipe.name}  {recipe.hash}", soft_wrap=True, markup=False)
            for key, value in recipe.values.items():
                out.print(f"  {key} = {_text(recipe, key, value)}", soft_wrap=True, markup=False)
    return 0


def _now(running: str, path: str) -> str:
    """Return the recipes of a running station that were begun last and are selected, as text; "" if it does not run."""
    with suppress(UmoError), find_running(running) as reader:
        frame, signals = reader.latest(), reader.layout.described.signals
        places = {each.path: place for place, each in enumerate(signals)}
        if frame is None or f"{path}.choice" not in places:
            return ""
        found = (places[f"{path}.{name}"] for name in ("begun", "choice"))
        begun, choice = (signals[each].text(float(frame["signals"][each])) for each in found)
        return f"{reader.title}: begun last: {begun}; chosen: {choice}"
    return ""


def choose_recipe(station: Station, running: str, name: str, over: bool) -> int:
    """Choose a recipe for the batches of a running station that begin from now on. The file of the recipe is read in
    this process."""
    machine = station.machine()
    path, recipe = _named(station, books_of(machine), name)
    action = actions_of(machine)[f"{path}.choose"].describe()
    with station_of(running) as remote, leased(remote, over):
        chosen = remote.carry_out(CALL, action["path"], {"name": name, "content": recipe.content})
    back = f"umo do {station.name} call {path}.follow_plan"
    out.print(
        f"chosen for all batches that begin from now on, also in later runs: {chosen}", soft_wrap=True, markup=False
    )
    out.print(f"{back}   lets the program choose again", soft_wrap=True, markup=False)
    return 0


def _named(station: Station, books: Mapping[str, RecipeBook[Any]], name: str) -> tuple[str, Recipe]:
    """Return the path of the book that has this recipe, and the recipe."""
    if not books:
        raise OptionError(f"{station.name} has no recipes")
    found = [(path, book.recipes[name]) for path, book in books.items() if name in book.recipes]
    if not found:
        known = list(dict.fromkeys(each for book in books.values() for each in book.recipes))
        raise RecipeError(f"there is no recipe {name!r}{did_you_mean(name, known)}; known: {', '.join(known)}")
    if len(found) > 1:
        ways = " | ".join(f"umo do {station.name} call {path}.choose name={name}" for path, _ in found)
        raise RecipeError(f"several parts have a recipe {name!r}: {ways}")
    return found[0]


def _text(recipe: Recipe, key: str, value: Any) -> str:
    """Return a value with its unit."""
    shown = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    hints = hints_of(type(recipe))  # type: ignore[arg-type]
    return f"{with_short_numbers(shown)} {unit_of(hints[key])}".rstrip()
