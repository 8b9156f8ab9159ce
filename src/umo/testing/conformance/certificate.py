"""The result of a run of the kit. It has a verdict for each rule, times, and a description of what was tested."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from umo.duration import duration
from umo.system.packages import umo_version
from umo.testing.conformance.rules import LINE
from umo.text import count_of, in_brackets, some

TABLE_WIDTH = 140


class Judgement(StrEnum):
    """The verdict on one rule."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_TRIED = "not tried"


STYLES = {Judgement.PASSED: "green", Judgement.FAILED: "bold red", Judgement.NOT_TRIED: "dim"}


@dataclass(frozen=True)
class Finding:
    """The verdict on one rule. `why`: the fault, the reason why the rule was not tried, or a remark."""

    rule: str
    text: str
    verdict: Judgement
    why: str = ""
    theme: str = ""


def time_text(seconds: float) -> str:
    """Return a measured time as text, to a tenth of a microsecond."""
    return duration(round(seconds, 7))


def edition() -> dict[str, Any]:
    """Return the date, versions and platform of a certificate: its fields `date`, `versions` and `platform`."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "versions": {"umo": umo_version(), "Python": platform.python_version()},
        "platform": f"{platform.system()} {platform.machine()}",
    }


@dataclass(frozen=True)
class TransferTime:
    """The times of one kind of transfer in s."""

    median: float
    p99: float
    count: int


@dataclass(frozen=True, repr=False)
class Certificate:
    """The findings of the kit. `str` returns a table, `repr` one line. Broken rules come first. A certificate contains
    no paths or names of the computer, except those of `devices`."""

    name: str
    driver: str
    """Module and class of the driver."""
    devices: tuple[str, ...]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    findings: tuple[Finding, ...]
    times: dict[str, TransferTime] = field(default_factory=dict)
    unreached: tuple[str, ...] = ()
    """Outputs that could not be brought to their defaults at the end of the run."""
    left_out: tuple[str, ...] = ()
    """Parts of rules that did not fit into the time."""
    date: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    platform: str = ""

    @property
    def passed(self) -> bool:
        """True if no rule failed, at least one passed, and the outputs are at their defaults."""
        return (
            not self.failed and not self.unreached and any(each.verdict is Judgement.PASSED for each in self.findings)
        )

    @property
    def failed(self) -> tuple[Finding, ...]:
        return tuple(each for each in self.findings if each.verdict is Judgement.FAILED)

    @property
    def line_tried(self) -> bool:
        """True if a rule that disturbs the line could be tried, or if no such rule was selected."""
        line = [each for each in self.findings if each.theme in LINE]
        return not line or any(each.verdict is not Judgement.NOT_TRIED for each in line)

    @property
    def whole(self) -> bool:
        """True if the driver passed, the line was disturbed, and no part was left out for lack of time."""
        return self.passed and self.line_tried and not self.left_out

    @property
    def status(self) -> str:
        """The result as text."""
        if not self.passed:
            return "FAILED"
        gaps = ["" if self.line_tried else "the line was not tried", "cut short" if self.left_out else ""]
        return f"passed{in_brackets(*gaps)}"

    def finding(self, rule: str) -> Finding:
        """Return the finding on the rule with this name. Raises KeyError if the rule was not selected."""
        return {each.rule: each for each in self.findings}[rule]

    @property
    def summary(self) -> str:
        """The result in one line."""
        counts = [(sum(each.verdict is verdict for each in self.findings), verdict.value) for verdict in Judgement]
        words = ", ".join(f"{count_of(count, 'rule')} {what}" for count, what in counts)
        return f"{self.name}: {self.status}; {words}"

    def table(self) -> Table:
        """Return the table for a rich console."""
        devices = ", ".join(self.devices) or "no device"
        table = Table(title=f"{self.name}: {self.status}, on {devices}", title_justify="left")
        for heading in ("rule", "verdict", "finding"):
            table.add_column(heading, overflow="fold")
        for each in self.findings:
            about = Text.assemble((each.text, "dim"), f" [{each.why}]" if each.why else "")
            table.add_row(each.rule, Text(each.verdict.value, STYLES[each.verdict]), about)
        for kind, time in self.times.items():
            figures = f"median {time_text(time.median)}, p99 {time_text(time.p99)}, {time.count} calls"
            table.add_row(f"time of {kind}", "", figures)
        if self.left_out:
            table.add_row("left out", "", "for lack of time: " + "; ".join(self.left_out))
        if self.unreached:
            table.add_row(
                "end", Text("failed", STYLES[Judgement.FAILED]), f"not at the default: {some(self.unreached)}"
            )
        table.caption = f"{self.summary}; {self.date}, {', '.join(f'{k} {v}' for k, v in self.versions.items())}"
        table.caption_justify = "left"
        return table

    def __str__(self) -> str:
        console = Console(width=TABLE_WIDTH, color_system=None)
        with console.capture() as captured:
            console.print(self.table())
        return "\n" + captured.get()

    def __repr__(self) -> str:
        failed = [f"{each.rule}: {each.why}" for each in self.failed]
        return "; ".join([*failed, self.summary])  # pytest cuts what is long: the reason stands first

    def to_json(self) -> str:
        return json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n"

    def save(self, folder: Path) -> Path:
        """Write NAME.json into the folder, which is created if it does not exist."""
        folder.mkdir(parents=True, exist_ok=True)
        file = folder / f"{self.name.replace('/', '-').replace(' ', '-')}.json"
        file.write_text(self.to_json(), encoding="utf-8")
        return file
