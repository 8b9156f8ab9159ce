"""The result of a replay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from umo.duration import duration
from umo.exit_status import ExitStatus
from umo.text import count_of


@dataclass(frozen=True)
class Difference:
    """The first place at which a replay differs from its recording."""

    period: int
    """Number of the period, counted from 0 at the beginning of the recording."""
    time: float
    """Time of the difference in s on the cycle's clock."""
    path: str
    """The path of the object; "" if the difference is not in an object."""
    recorded: str
    replayed: str
    """The recorded and the replayed value as text, each with unit and raw integer."""
    places: Sequence[str] = ()
    """The place of each sequence, as file:line."""
    signals: Sequence[str] = ()
    """The signals that also differed in this period: each with its path, and the recorded and the replayed value."""

    def __str__(self) -> str:
        what = f"{self.path}: " if self.path else ""
        where = f"period {self.period:,}, {self.time:g} s"
        lines = [f"first difference in {where}: {what}recorded {self.recorded}, replayed {self.replayed}"]
        lines += [f"  the sequence stood at {place}" for place in self.places]
        lines += [f"  {each}" for each in self.signals]
        return "\n".join(lines)


@dataclass
class Replayed:
    """The result of a replay."""

    station: str = ""
    periods: int = 0
    """Number of periods that were replayed."""
    raws: int = 0
    """Number of commanded raw integers that were compared."""
    simulated: float = 0.0
    """Time in s on the machine's clock at the end."""
    difference: Difference | None = None
    inexact: str = ""
    """The reason why the replay ended before the end of the recording; "" if it did not."""
    ended: str = ""
    """The end of the recorded run, as the run reported it; "" if the recording does not contain it."""
    error: BaseException | None = None
    """The error that ended the replayed run, or None if there was none."""
    settings: dict[str, Any] = field(default_factory=dict)
    """The numbers that were set to other values (`umo recording replay --set`), by path."""
    open_loop: bool = False
    """True if the recording was shrunk. In this case only its error was compared."""
    hashes: str = ""
    """A remark on the order of hashes, if it was not fixed."""
    code: str = ""
    """A remark if the code differs from that of the recorded run."""
    elapsed: float = 0.0
    """Duration of the replay in s."""

    @property
    def identical(self) -> bool:
        """True if the whole recorded run was replayed without a difference."""
        return self.difference is None and not self.inexact

    @property
    def status(self) -> ExitStatus:
        """The exit status of `umo recording replay`."""
        if self.difference is not None:
            return ExitStatus.FAILED
        return ExitStatus.DONE if self.identical else ExitStatus.NOT_RECORDED

    def __str__(self) -> str:
        periods = count_of(self.periods, "period")
        count = f"{periods} ({duration(round(self.simulated, 6))}), {count_of(self.raws, 'commanded raw integer')}"
        if self.open_loop:
            count = f"{periods} in open loop, of which only the error is compared"
        as_far = "identical as far as the recording goes" if self.inexact else "identical"
        lines = [f"{as_far}: {count}" if self.difference is None else f"different: {count}\n{self.difference}"]
        if self.settings:
            changed = ", ".join(f"{path} = {value}" for path, value in self.settings.items())
            lines.append(f"with {changed}: open loop, because the recorded sensors do not react to the new commands")
        lines += [f"the replay ended here: {self.inexact}"] if self.inexact else []
        lines += [f"end of the recorded run: {self.ended}"] if self.ended else []
        lines += [self.code] if self.code else []
        lines += [self.hashes] if self.hashes and self.difference is not None else []
        return "\n".join(lines)
