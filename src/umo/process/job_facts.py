"""What a run is, as plain data, to run the same again. It stands in the frames' description as `about["job"]`."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import stat
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from umo.errors import text_of
from umo.process.job import Plan
from umo.system.processes import HASH_SEED
from umo.wiring.json_values import as_plain

KINDS = (".py", ".toml", ".xml", ".json")
"""Suffixes of the files of a station that decide what it does."""
MAX_NAMES, MAX_BYTES, MAX_TIME = 2000, 8 << 20, 0.03
"""Names in its folders, bytes of these files and s for them, beyond which there is no hash: the machine waits for it,
and its folder may be anything, a home on a network too."""


def job_facts(plan: Plan, kept: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
    """The facts about a run. `kept`: what it has taken over from the last run, by section. What is no plain data (a
    driver that is an object) is there in words. Nothing raises: where they cannot be told there is only `error`."""
    try:
        return _facts(plan, kept)
    except Exception as error:  # as of options that refer to themselves
        return {"error": text_of(error)}


def _facts(plan: Plan, kept: Mapping[str, Any]) -> dict[str, Any]:
    job, shares = plan.job, plan.shares
    facts = {
        "station": plan.name,
        "place": str(plan.place.resolve()),
        "machine": job.machine,
        "application": job.application,
        "script": job.script,
        "path": job.path,
        "wiring": _wiring(plan),
        "options": {
            "given": job.options,
            "machine": plan.machine_options,
            "application": shares.application,
            "drivers": shares.wiring,
        },
        "parameters": {number.path: value for number, value in plan.wired.parameters},
        "fault_seed": None if plan.wired.injection is None else plan.wired.injection.seed,
        "manual": job.manual,
        "until": job.until,
        "kept": kept,
        "versions": {
            "umo": version("umo"),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "platform": f"{sys.platform} {platform.release()} {platform.machine()}",
        },
        "files": files_hash(plan.place),
        "sources": plan.all_sources(),
        "host": platform.node(),
        "hash_seed": os.environ.get(HASH_SEED),
    }
    return dict(json.loads(json.dumps(facts, default=_plain)))


def files_hash(place: Path, clock: Callable[[], float] = time.monotonic) -> str:
    """SHA-256 in hex of a station's files, by name and content; of a script that of this file. What cannot be read does
    not count. Beyond a limit `not hashed: more than ...`."""
    digest, until, left = hashlib.sha256(), clock() + MAX_TIME, MAX_BYTES
    try:
        for name, path in _files(place):
            if clock() > until:
                raise _TooMuchError(f"{MAX_TIME * 1e3:g} ms")
            if path is None or (content := _content(path, left)) is None:
                continue
            left -= len(content)
            if left < 0:
                raise _TooMuchError(f"{MAX_BYTES >> 20} MiB")
            digest.update(f"{name}\0{len(content)}\0".encode(errors="surrogateescape"))
            digest.update(content)
    except _TooMuchError as limit:
        return f"not hashed: more than {limit} in {place}"
    return digest.hexdigest()


class _TooMuchError(Exception):
    """A limit was passed."""


def _content(path: Path, most: int) -> bytes | None:
    """The content of a file, of a longer one one byte more than `most`; None: it is no file that can be read."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK), "rb") as file:  # a pipe lets nobody wait
            return file.read(most + 1) if stat.S_ISREG(os.fstat(file.fileno()).st_mode) else None
    except OSError:
        return None


def _files(place: Path) -> Iterator[tuple[str, Path | None]]:
    """Names and paths, in the same order each time; of a folder no path. Folders that begin with a point or an
    underscore, and runs, are passed over."""
    if not place.is_dir():
        yield place.name, place
        return
    left, folders = MAX_NAMES, [place]
    while folders:
        folder = folders.pop()
        yield folder.name, None
        try:
            with os.scandir(folder) as names:
                entries = sorted(islice(names, left + 1), key=lambda entry: entry.name)
        except OSError:
            continue
        left -= len(entries)
        if left < 0:
            raise _TooMuchError(f"{MAX_NAMES} names")
        for entry in entries:
            path = Path(entry.path)
            if not entry.is_dir(follow_symlinks=False):
                if entry.name.endswith(KINDS):
                    yield path.relative_to(place).as_posix(), path
            elif not entry.name.startswith((".", "_")) and entry.name != "runs":
                folders.append(path)


def _wiring(plan: Plan) -> dict[str, Any]:
    """Its name, file and text; of one that is no file its table."""
    if isinstance(plan.wiring, Path):
        return {
            "name": plan.wiring_name,
            "file": str(plan.wiring.resolve()),
            "text": plan.wiring.read_text("utf-8", "replace"),
        }
    return {"name": "", "table": plan.wiring}


def _plain(value: Any) -> Any:
    try:
        return as_plain(value)
    except TypeError:
        return dict(value) if isinstance(value, Mapping) else repr(value)
