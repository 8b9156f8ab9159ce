"""Generates the files of a controller that runs a part of a machine (`umo new controller --controller`)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from umo.cycle.laid_out import wired_numbers
from umo.drivers.wrapping import bare
from umo.errors import DeclarationError
from umo.generate.controller_folder import BOARDS, files_of
from umo.generate.split.controller_driver import Controller
from umo.generate.split.part_plan import PartPlan, plan_of
from umo.generate.translation import ControllerTarget
from umo.objects import Compound, walk
from umo.text import did_you_mean
from umo.wiring import resolve

README = """
## The host

This controller runs `{path}` of a machine whose application is on a host; docs/howto-split.md says how, and
docs/split-protocol.md what goes over the line. `main_link.c` is its loop in place of `main.c`. When the host was silent
for {timeout:g} s, {ticks} periods, every axis brakes to standstill; then, and at the latest {braking:g} s later, every
output goes to its default, and nothing runs until the host starts it again.
"""


def part_files(
    root: Compound, wiring: Path | str | Mapping[str, Any] | None, name: str, target: ControllerTarget
) -> dict[str, str]:
    """Return the files by name, for the controller of this name in the wiring. Raises NotTranslated, which lists all
    obstacles. No device is opened."""
    wired = resolve(root, wiring, to_run=False)
    path = next((each for each, driver in wired.controllers.items() if driver == name), None)
    if path is None:
        known = list(wired.controllers.values())
        there = (
            f"; choose from: {', '.join(known)}" if known else '; a part has one by "PART" = { controller = "NAME" }'
        )
        raise DeclarationError(f"no part runs on a controller {name!r}{did_you_mean(name, known)}{there}")
    driver = bare(wired.drivers[name])
    assert isinstance(driver, Controller)
    if driver.real != target.real:
        text = f'{target.name} has {target.real}s: write real = "{target.real}" in [drivers.{name}], or give --real'
        raise DeclarationError(f"the wiring says that {name} has {driver.real}s, but the controller {text}")
    part = next(node for node in walk(root) if node._path == path)
    assert isinstance(part, Compound)
    with wired_numbers(root, wired):
        cycle = driver.cycle_for(part, wired)
        plan = plan_of(part, wired, driver, cycle, target, driver.host_timeout, driver.braking_timeout)
    return files_of_plan(plan)


def files_of_plan(plan: PartPlan) -> dict[str, str]:
    files = files_of(plan.model, plan.translation, plan.target)
    on_host, own = plan.target.name == "host", f"link-{plan.target.name}"
    for name in ("link", own if (BOARDS / own).is_dir() else "link-board"):
        files |= {file.name: file.read_text("utf-8") for file in sorted((BOARDS / name).iterdir())}
    for name in ("main.c", "host_access.c", *(each for each in files if "lines" in each)):
        files.pop(name, None)
    files |= plan.files()
    if not on_host and "Makefile" in files:
        files["Makefile"] = _with_link(files["Makefile"])
    head, _, notes = files["README.md"].partition("\n## To be known")
    host = README.format(
        path=plan.path, timeout=plan.host_timeout, ticks=plan.timeout_ticks, braking=plan.braking_timeout
    )
    files["README.md"] = f"{head}{host}\n## To be known{notes}"
    return files


def _with_link(makefile: str) -> str:
    """Return the Makefile of a board, changed for the main loop with the link."""
    text = makefile.replace("MAIN = main.c", "MAIN = main_link.c").replace(
        "SOURCES = machine.c", "SOURCES = machine.c machine_link.c"
    )
    return text.replace("io_board.c machine.h", "io_board.c io_link.c machine.h")
