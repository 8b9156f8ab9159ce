"""The recipes of a running station: the recipe in use, and the next one."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Generic, TypeVar

from umo.errors import RangeError, RecipeError
from umo.objects import Compound, Number, action
from umo.objects.laws import laws_in
from umo.operation.recipes import Recipe, describe_fields, read_recipes, recipe_from_content
from umo.text import did_you_mean

R = TypeVar("R", bound=Recipe)
MAX_RECORDED = 100
"""The number of different recipes that a run records. For further recipes only the number of batches is counted."""


class RecipeBook(Generic[R]):
    """The recipes of a compound, made in its `setup`: `self.book = RecipeBook(Batch, FOLDER)`.

    The recipes are read when the object is made; after that no file is read. Raises RecipeError if one of them is
    invalid. A client chooses another recipe by the action `choose`. The program gets this recipe with its next call of
    `next()`, so the recipe never changes within a batch. Frames show the recipe that was begun last and the chosen one
    (`begun`, `choice`). The choice is kept across a restart by the name of the recipe. The choice of a recipe whose
    values a client has sent is not kept.
    """

    def __init__(self, kind: type[R], place: Path) -> None:
        self.kind = kind
        self.place = place
        """The folder, or the file, of the recipes."""
        self.recipes: dict[str, R] = read_recipes(kind, place)
        self.current: R | None = None
        """The recipe that `next` returned last."""
        self.chosen: R | None = None
        """The recipe that a client has chosen; None means that the program chooses."""
        self.begun = 0
        """The number of the recipe in `current` (see `number_of`)."""
        self._choice = 0
        self._by_number: dict[int, R | None] = dict(enumerate([None, *self.recipes.values()]))
        self.numbers = {
            "begun": Number(shown=True, names=recipe_names(self.recipes, "none")),
            "choice": Number(shown=True, kept=True, names=recipe_names(self.recipes, "the program's own")),
        }
        self._record: dict[str, dict[str, Any]] = {}
        self._others = 0

    @property
    def choice(self) -> int:
        """The number of the chosen recipe (`chosen`). Raises RangeError if the number is set to that of a recipe whose
        values are not known."""
        return self._choice

    @choice.setter
    def choice(self, number: int) -> None:
        if number not in self._by_number:
            raise RangeError("a client had sent the values of that recipe; choose the recipe again")
        self.chosen, self._choice = self._by_number[number], number

    def begin(self) -> None:
        """Begin a run: nothing is recorded, and no recipe has been used. The choice of a client remains."""
        self.current, self.begun = None, 0
        self._record, self._others = {}, 0

    @action(harmless=True)
    def choose(self, name: str, content: str = "") -> str:
        """Choose the recipe for the batches that begin from now on. Returns the name and hash of the recipe. Raises
        RecipeError if the recipe is refused; then the earlier choice remains. `content`: the values as JSON; default:
        the values that were read at the start.
        """
        found = recipe_from_content(self.kind, name, content) if content else self._known(name)
        number = self.number_of(found)
        self._by_number[number] = found
        self.choice = number
        return f"{found.name} {found.hash}"

    @action(harmless=True)
    def follow_plan(self) -> None:
        """Cancel the choice of a client: batches that begin from now on use the recipes of the program."""
        self.choice = 0

    def next(self, planned: str = "") -> R:
        """Return the recipe for the next batch. This is the chosen recipe, or else the planned one, or else the one
        used last, or else the first. Raises RecipeError if the planned recipe is not known."""
        found = self.chosen or (self._known(planned) if planned else self.current)
        self.current = found or next(iter(self.recipes.values()))
        self.begun = self.number_of(self.current)
        self._note(self.current)
        return self.current

    def number_of(self, recipe: R | None) -> int:
        """Return the number of a recipe, for a shown number with `recipe_names`. 0 means no recipe. The numbers from 1
        on stand for the recipes read at the start, then for recipes with the same names and other values, then for any
        other recipe."""
        if recipe is None:
            return 0
        known = list(self.recipes)
        if recipe.name not in self.recipes:
            return 1 + 2 * len(known)
        same = recipe == self.recipes[recipe.name]
        return 1 + known.index(recipe.name) + (0 if same else len(known))

    def describe(self) -> dict[str, Any]:
        """Return the recipes that were read at the start with their fields, as plain data."""
        recipes = [{"name": each.name, "hash": each.hash, "values": each.values} for each in self.recipes.values()]
        return {"fields": describe_fields(self.kind), "recipes": recipes}

    @property
    def record(self) -> dict[str, dict[str, Any]]:
        """The recipes that were used, for the result of a run: name and hash of each, with the number of batches and
        the values."""
        others = {"others": {"batches": self._others}} if self._others else {}
        return {key: {**entry} for key, entry in self._record.items()} | others

    def _note(self, recipe: R) -> None:
        key = f"{recipe.name} {recipe.hash}"
        if key in self._record:
            self._record[key]["batches"] += 1
        elif len(self._record) < MAX_RECORDED:
            self._record[key] = {"batches": 1, "values": recipe.values}
        else:
            self._others += 1

    def _known(self, name: str) -> R:
        if name not in self.recipes:
            near = did_you_mean(name, self.recipes)
            raise RecipeError(f"there is no recipe {name[:60]!r}{near}; known: {', '.join(self.recipes)}")
        return self.recipes[name]


def recipe_names(known: Iterable[str], none: str) -> dict[int, str]:
    """Return the names of the numbers of recipes (`RecipeBook.number_of`). `none`: the name of 0."""
    found = list(known)
    return dict(enumerate([none, *found, *(f"{name}, other values" for name in found), "another one"]))


def books_of(root: Compound) -> dict[str, RecipeBook[Any]]:
    """Return every recipe book of a machine by its path."""
    return {path: each for _, path, each in laws_in(root) if isinstance(each, RecipeBook)}
