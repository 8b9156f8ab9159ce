"""Every command of `umo` that is named exists: in the documentation, in the texts of umo, in the templates."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.own_modules import on_one_line
from tools.command_line import leaves
from umo.operation.commands.verbs import verb_of
from umo_command.shared import COMMANDS

ROOT = Path(__file__).parents[2]
LEAVES = dict(leaves())
NAMES = {tuple(name.split()) for name in LEAVES}
PAGES = [*(ROOT / name for name in ("README.md", "SECURITY.md", "CONTRIBUTING.md")), *sorted(ROOT.glob("docs/*.md"))]
PAGES += sorted((ROOT / "src").rglob("*.md"))
SOURCES = [each for each in sorted((ROOT / "src").rglob("*.py")) if each.name != "old_names.py"]
COMMAND = re.compile(r"(?<![\w./~-])umo((?: +(?:'[^']*'|\"[^\"]*\"|[^\s`|&;'\"#<>()]+))*)")
PLACEHOLDER = re.compile(r"[A-Z{\[.<]|\.\.\.")
OWN = {"--help", "--version", "--install-completion", "--show-completion"}


def mistake(words: list[str]) -> str:
    """What is wrong with the words after `umo`; "": nothing."""
    if not words or words[0] in OWN or PLACEHOLDER.match(words[0]):
        return ""
    if words[0] not in COMMANDS:
        return f"there is no umo {words[0]}"
    depth = next((depth for depth in range(len(words), 0, -1) if tuple(words[:depth]) in NAMES), 0)
    if words[0] == "do" and len(words) > 2 and not (PLACEHOLDER.match(words[2]) or words[2].startswith("-")):
        return "" if verb_of(words[2].strip("'\"")) else f"there is no verb {words[2]}"
    if depth:
        return _wrong_option(" ".join(words[:depth]), words[depth:])
    below = [name for name in NAMES if name[: len(words)] == tuple(words)]
    below += [name for name in NAMES if name[0] == words[0] and (len(words) == 1 or PLACEHOLDER.match(words[1]))]
    return "" if below or words[1:2] == ["--help"] else f"there is no umo {' '.join(words[:2])}"


def _wrong_option(name: str, words: list[str]) -> str:
    command = LEAVES[name]
    known = OWN | {flag for each in command.params for flag in (*each.opts, *each.secondary_opts)}
    if command.context_settings.get("ignore_unknown_options"):
        return ""
    flags = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    return next((f"umo {name} has no {flag}" for flag in flags if flag not in known), "")


def named_in(text: str) -> Iterator[list[str]]:
    """The words of each command in a piece of code."""
    for match in COMMAND.finditer(text):
        yield re.findall(r"'[^']*'|\"[^\"]*\"|\S+", match[1])


def code_of(page: str) -> Iterator[str]:
    """The lines of code blocks that begin with `umo`, and what stands between backticks."""
    for place, part in enumerate(re.split(r"^```", page, flags=re.M)):
        inside = place % 2
        kind, _, text = part.partition("\n") if inside else ("", "", part)
        found = text.splitlines() if inside else re.findall(r"`([^`\n]+)`", text)
        if kind.strip() in ("", "console", "sh", "bash", "text"):
            yield from (each.partition("#")[0] for each in found if re.match(r"\s*(\$ )?umo( |$)", each))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_commands_of_a_page_exist(page: Path) -> None:
    for code in code_of(page.read_text("utf-8")):
        for words in named_in(code):
            assert not (wrong := mistake(words)), f"{code}: {wrong}"


def spans_of(code: str) -> list[str]:
    """The commands between backticks in a module: in texts, also those of several parts, in docstrings and comments.
    What is put in stands as `{}`."""
    found = re.findall(r"`(umo [^`\n]+)`", on_one_line(code)) if "`umo" in code else []
    return [re.sub(r"\{[^{}]*(\{[^{}]*\}[^{}]*)?\}", "{}", span) for span in found]


def test_the_commands_in_the_texts_of_umo_exist() -> None:
    spans = {source: spans_of(source.read_text("utf-8")) for source in SOURCES}
    assert sum(map(len, spans.values())) > 100
    for source, found in spans.items():
        for span in found:
            for words in named_in(span):
                assert not (wrong := mistake(words)), f"{source}: {span}: {wrong}"


def test_a_command_in_a_text_of_several_parts_is_found_with_what_is_put_in() -> None:
    code = """raise Mistake(f"see `umo show {given['a']} "\n    f'values` and \\'`umo\\'' "`umo ps`")  # `umo do`"""
    assert spans_of(code) == ["umo show {} values", "umo ps", "umo do"]


@pytest.mark.parametrize(
    ("command", "wrong"),
    [
        ("ps", "there is no umo ps"),
        ("show stattions", "there is no umo show stattions"),
        ("show values z --seconds 3", "umo show values has no --seconds"),
        ("show values z --for 3", ""),
        ("do ztheta mod manual", "there is no verb mod"),
        ("do ztheta remove-from-service tank.cold", ""),
        ("run ztheta --seed 7", ""),
        ("connect certificate", ""),
        ("alarm shelve plant tank.cold '10 min'", ""),
    ],
)
def test_a_command_that_does_not_exist_is_found(command: str, wrong: str) -> None:
    assert mistake(command.split()) == wrong
