"""A station for tests of commands: what a busy computer does to its loop is not tested there."""

from __future__ import annotations

from pathlib import Path

from umo.process.station import find


def patient(name: str, folder: Path) -> Path:
    """A wiring of a station on its plant, with a hang limit that a busy computer keeps."""
    text = (find(name).path / "wiring" / "simulated.toml").read_text("utf-8")
    wiring = folder / "simulated.toml"
    wiring.write_text(text.replace('".plant:', f'"umo.stations.{name}.plant:') + '\n[process]\nhang_timeout = "5 s"\n')
    return wiring


def conveyor(folder: Path) -> Path:
    """With fewer periods, in which its belt moves by as much as it may."""
    wiring = patient("conveyor", folder)
    wiring.write_text(wiring.read_text("utf-8").replace('period = "2 ms"', 'period = "5 ms"'))
    return wiring
