"""Every name of umo in the tables of the "coming from" pages, and in the text of the README, exists.

`test_named_commands.py` checks the commands.
"""

from __future__ import annotations

import builtins
import importlib
import inspect
import keyword
import re
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import umo.control
import umo.errors
import umo.operation
import umo.operation.alarms
import umo.states
import umo.testing
from umo.clients.faces.face_settings import FaceSettings
from umo.control.axis import AxisState
from umo.cycle.machine_view import MachineView
from umo.drivers import registry
from umo.drivers.gpio.driver import Gpio
from umo.objects.keywords import KEYWORDS
from umo.operation import PackMLState
from umo.operation.recipe_book import RecipeBook
from umo.operation.recipes import Recipe
from umo.wiring.off_cycle_table import OFF_CYCLE
from umo.wiring.process_table import ProcessTable
from umo.wiring.schema import Entry
from umo.wiring.source import SECTIONS

ROOT = Path(__file__).parents[2]
PAGES = [*sorted(ROOT.glob("docs/coming-from-*.md")), ROOT / "README.md"]
MODULES = [
    umo,
    *(
        importlib.import_module(f"umo.{name}")
        for name in ("operation.alarms", "control", "operation", "states", "errors", "testing")
    ),
]
OWN = {"lamp", "button", "oven", "temperature", "target", "axis", "m", "a", "b", "condition", "velocity", "timer"}
"""Names that the examples give to parts of a machine."""
COMMANDS = re.compile(r"(umo|python) ")


def spans(page: Path) -> Iterator[str]:
    """The code in the column of umo in each table; of the README all code outside of blocks."""
    text = page.read_text("utf-8")
    if page.name == "README.md":
        text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    else:
        text = "\n".join(line.split("|")[2] for line in text.splitlines() if line.startswith("|"))
    yield from (each for each in re.findall(r"`([^`\n]+)`", text) if not COMMANDS.match(each))


def names_in(code: str) -> set[str]:
    """The names in a piece of Python, or of TOML, without strings."""
    code = re.sub(r"\"[^\"]*\"|(?<==)[\w-]*-[\w-]*|\bumo(\.\w+)*", "", code)
    names = set(re.findall(r"[A-Za-z_]\w*", code))
    return {each for each in names if not keyword.iskeyword(each)} - OWN - {*dir(builtins), "self", "true", "false"}


def chains_in(code: str) -> Iterator[list[str]]:
    """The attributes of umo and of its classes that are named with their owner: `PackMLState.EXECUTE`."""
    yield from (each.split(".") for each in re.findall(r"\b(?:umo|[A-Z]\w*)(?:\.\w+)+", code))


def _parameters(function: Any) -> set[str]:
    try:
        return {*inspect.signature(function).parameters}
    except (TypeError, ValueError):
        return set()


def _public(module: Any) -> list[str]:
    own = [name for name, item in vars(module).items() if getattr(item, "__module__", "") == module.__name__]
    return getattr(module, "__all__", own)


@cache
def known() -> set[str]:
    names = {OFF_CYCLE, *SECTIONS, *KEYWORDS, *registry.known(), *Entry.model_fields}
    names |= {each.name for table in (ProcessTable, FaceSettings) for each in fields(table)}
    names |= {each.name.lower() for each in PackMLState}
    items = {name: getattr(module, name) for module in MODULES for name in _public(module)}
    items |= {each.__name__: each for each in (AxisState, Gpio, Recipe, RecipeBook, MachineView)}
    for name, item in items.items():
        names |= {name, *_parameters(item)}
        if inspect.isclass(item):
            names |= _members(item)
    return names


def _members(cls: type) -> set[str]:
    """The public attributes and fields of a class, and the parameters of its methods."""
    names = {name for name in dir(cls) if not name.startswith("_")}
    declared = {name for base in cls.__mro__ for name in vars(base).get("__annotations__", {})}
    numbers = getattr(cls, "numbers", None)
    declared |= {*numbers} if isinstance(numbers, dict) else set()
    return names | declared | {each for name in names for each in _parameters(getattr(cls, name))}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_names_of_a_page_exist(page: Path) -> None:
    unknown = {code: names_in(code) - known() for code in spans(page)}
    assert not {code: names for code, names in unknown.items() if names}
    for code in spans(page):
        for first, *rest in chains_in(code):
            item: Any = (
                umo if first == "umo" else next(getattr(each, first) for each in MODULES if first in _public(each))
            )
            for name in rest:
                item = getattr(item, name)


def test_a_name_that_does_not_exist_is_found() -> None:
    assert names_in('ServoAxle(m.oven, filtr="1 s")') - known() == {"ServoAxle", "filtr"}
