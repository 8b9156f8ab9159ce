"""The help of every command, its options, old names, and the page that is made of the help."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from tools.command_line import EXIT_STATUS, PAGE, leaves, page
from umo.exit_status import ExitStatus
from umo.process.station import shipped
from umo_command import shared
from umo_command.app import app
from umo_command.old_names import OLD_NAMES, OldName, current
from umo_command.shared import COMMANDS, keep_only

LEAVES = dict(leaves())
FIRST_LEVEL = 14
"""Commands at the first level, with those that are still to come: find, import, report, change."""
TO_COME = 4


def _options(command: Any) -> list[Any]:
    return [each for each in command.params if each.param_type_name == "option" and each.name != "help_"]


def test_a_newcomer_sees_few_commands() -> None:
    assert len(COMMANDS) + TO_COME <= FIRST_LEVEL
    assert list(typer.main.get_command(app).commands) != []  # type: ignore[attr-defined]
    assert sorted(typer.main.get_command(app).commands) == sorted(COMMANDS)  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", LEAVES)
def test_the_help_of_a_command_has_examples_and_exit_statuses(name: str) -> None:
    result = CliRunner().invoke(app, [*name.split(), "--help"])
    shown = " ".join(result.stdout.split())
    assert result.exit_code == 0
    assert re.search(rf"Examples: (.* \| )?umo {name}\b", shown)
    assert "Exit status: 0 " in shown


OWN = {"my-machine", "my-batch"}
"""Stations that examples make."""


def _examples(name: str) -> Iterator[tuple[Any, str]]:
    """Each example of a command that is one of `umo`, with the command that it calls."""
    for example in re.split(r" +\| +| && ", LEAVES[name].epilog.partition("\n\n")[0].removeprefix("Examples: ")):
        called = [each for each in LEAVES if f"{example} ".startswith(f"umo {each} ")]
        assert called or not example.startswith("umo "), example
        if called:
            yield LEAVES[called[-1]], example.removeprefix(f"umo {called[-1]}")


@pytest.mark.parametrize("name", LEAVES)
def test_the_examples_of_a_command_have_options_that_exist(name: str) -> None:
    for command, words in _examples(name):
        known = {flag for each in command.params for flag in (*each.opts, *each.secondary_opts)}
        used = set(re.findall(r"(?<=\s)(--?[a-z][a-z-]*)", words)) - {"--help"}
        assert used <= known or command.context_settings.get("ignore_unknown_options"), words


@pytest.mark.parametrize("name", LEAVES)
def test_the_examples_of_a_command_name_stations_that_ship_with_umo_or_that_they_make(name: str) -> None:
    for command, words in _examples(name):
        arguments = [each for each in command.params if each.param_type_name == "argument"]
        given = words.split()[:1]
        if arguments and (arguments[0].metavar or "").strip("[]") == "STATION" and given:
            assert given[0].startswith("-") or given[0] in {*shipped(), *OWN}, words


@pytest.mark.parametrize("name", [*COMMANDS, "--help", "runs-of-nobody"])
def test_the_command_that_is_called_is_made_alone_and_all_for_any_other_word(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for kind in ("registered_commands", "registered_groups"):
        monkeypatch.setattr(app, kind, list(getattr(app, kind)))
    keep_only([name])
    made = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert sorted(made) == ([name] if name in COMMANDS else sorted(COMMANDS))


def test_below_a_group_only_the_command_that_is_called_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    for kind in ("registered_commands", "registered_groups"):
        monkeypatch.setattr(app, kind, list(getattr(app, kind)))
    below = next(each.typer_instance for each in app.registered_groups if each.name == "show")
    assert below is not None
    monkeypatch.setattr(below, "registered_commands", list(below.registered_commands))
    keep_only(["show", "why"])
    assert list(typer.main.get_command(app).commands["show"].commands) == ["why"]  # type: ignore[attr-defined]


# One name for one thing -------------------------------------------------------------------------------


def _value_of(option: Any) -> str:
    """What an option takes: `TIME`, `FILE`, or "" if nothing."""
    if option.is_flag:
        return ""
    metavar = option.metavar or option.bare_type().upper()
    plain = re.sub(r"\\\[|\]|\.[a-z]\w*", "", metavar).partition("|")[0]
    return re.sub(r"[\w.]+(?==VALUE$)", "NAME", plain)


WRITTEN = {"FILE", "DIR"}
"""What `--out` may name."""


def test_an_option_takes_the_same_thing_in_every_command() -> None:
    kinds: dict[str, dict[str, str]] = defaultdict(dict)
    for name, command in LEAVES.items():
        for option in _options(command):
            for flag in option.opts[:1]:
                kinds[flag].setdefault(_value_of(option), name)
    for flag, found in kinds.items():
        assert len(found) == 1 or (flag == "--out" and set(found) <= WRITTEN), f"{flag}: {found}"


@pytest.mark.parametrize("flag", ["--json", "--take", "--acknowledge", "--all", "--fleet", "--load"])
def test_an_option_that_says_how_takes_no_value(flag: str) -> None:
    found = [each for command in LEAVES.values() for each in _options(command) if flag in each.opts]
    assert found
    assert all(each.is_flag for each in found)


def test_a_time_is_told_with_its_unit_and_never_as_a_bare_number() -> None:
    """No option counts seconds, or minutes: each takes a time, `TIME`, such as "5 min"."""
    for name, command in LEAVES.items():
        for option in _options(command):
            is_number = not option.is_flag and option.bare_type() in ("float", "int") and option.metavar != "TIME"
            words = f"{option.opts[0]} {option.help}"
            assert not (is_number and re.search(r"\b(in s|seconds|minutes|timeout)\b", words)), f"{name}: {words}"


def test_every_time_of_the_command_line_may_have_a_unit_and_is_read_before_the_command_begins() -> None:
    found = {
        f"{name} {option.opts[0]}": (option, typer.Context(command))
        for name, command in LEAVES.items()
        for option in _options(command)
        if option.metavar == "TIME"
    }
    assert "tune law --for" in found
    for name, (option, context) in found.items():
        assert option.process_value(context, "5 min") == 300.0, name
        assert option.process_value(context, "2.5") == 2.5, name
        with pytest.raises(typer.BadParameter, match="not a duration"):
            option.process_value(context, "fast")


def test_what_is_written_is_named_by_out() -> None:
    """`--out` and `-o` go together, and no other option of a command that has none of them writes a file."""
    for name, command in LEAVES.items():
        for option in _options(command):
            assert ("--out" in option.opts) == ("-o" in option.opts), name
            writes = re.match(r"(Write|Draw|File of)\b", option.help or "")
            if writes and not option.is_flag and name != "run":  # which leaves several things behind
                assert "--out" in option.opts, f"{name}: {option.opts}"


def test_a_station_is_the_first_argument_and_called_station() -> None:
    for name, command in LEAVES.items():
        arguments = [each.metavar or each.name.upper() for each in command.params if each.param_type_name == "argument"]
        for place, metavar in enumerate(arguments):
            if "STATION" in metavar:
                assert place == 0 or arguments[0].startswith("FILE.mcap"), f"{name}: {arguments}"
        assert not any(re.search("MACHINE|PID|RUN$", each) for each in arguments), name


def test_a_wiring_has_its_short_name_everywhere() -> None:
    for name, command in LEAVES.items():
        for option in _options(command):
            assert ("--wiring" in option.opts) == ("-w" in option.opts), name


# Old names --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("old", OLD_NAMES, ids=lambda old: old.was)
def test_an_old_name_leads_to_a_command_and_its_options_to_options(old: OldName) -> None:
    now = re.sub(r" (STATION|FILE --out OUT)( .*)?", "", old.now)
    found = [command for name, command in LEAVES.items() if f"{name} ".startswith(f"{now} ")]
    assert found
    known = {flag for command in found for each in command.params for flag in each.opts}
    assert {*old.options.values()} - {"--for"} <= known


@pytest.mark.parametrize(
    ("words", "now"),
    [
        ("ps --json", "show stations --json"),
        ("watch press --seconds 2", "show values press --for 2"),
        ("watch press --seconds=2", "show values press --for=2"),
        ("call press ram.jog velocity=-5 --hold 2", "do press call ram.jog velocity=-5 --for 2"),
        ("mode", "do"),
        ("mode press manual --take", "do press mode manual --take"),
        ("stop --help", "do --help"),
        ("alarms press --shelve tank.cold --for 10min", "alarm shelve press tank.cold 10min"),
        ("alarms press", "alarm list press"),
        ("record --save press", "recording save press"),
        ("export run.mcap z.csv --from 2", "recording export run.mcap --out z.csv --from 2"),
        ("tree press --period", "show period press"),
        ("tune press ram.gain 3", "tune number press ram.gain 3"),
        ("tune-law press ram --from run.mcap --start 2", "tune law press ram --file run.mcap --from 2"),
        ("new press", "new station press"),
        ("new station press", "new station press"),
        ("new", "new"),
        ("tune number press", "tune number press"),
        ("fleet certificate site cell7", "connect certificate site cell7"),
        ("run ztheta", "run ztheta"),
        ("", ""),
    ],
)
def test_words_with_an_old_name_are_translated(words: str, now: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert current(words.split(), app) == now.split()


def test_an_old_name_works_and_a_line_on_stderr_says_the_new_one() -> None:
    result = CliRunner().invoke(app, ["ps"])
    assert result.exit_code == 0
    assert "no station is running" in result.stdout
    assert result.stderr == "umo: `umo ps` is now `umo show stations`: the old name works in this version only\n"


# The page ---------------------------------------------------------------------------------------------


def test_the_page_of_the_command_line_is_made_of_the_help() -> None:
    assert PAGE.read_text("utf-8") == page(), "the help has changed: python tools/command_line.py"


def test_the_page_of_exit_statuses_names_every_status() -> None:
    rows = [line.split("|")[1].strip() for line in EXIT_STATUS.read_text("utf-8").splitlines() if line.startswith("| ")]
    for status in ExitStatus:
        assert str(status) in rows


def test_a_paragraph_of_a_docstring_is_one_line_of_the_help() -> None:
    assert (
        shared.paragraphs("Run it.\n\n    It runs,\n    until it ends.\n    ") == "Run it.\n\nIt runs, until it ends."
    )
