"""The files that a run has read (its code, its wiring and its recipes), and the changes of these files on disk since.

A run hashes the files once, when it has read them, and publishes the hashes in its description. A process that needs to
know about changes compares the hashes, so that the loop does not access the disk.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from umo.objects import Compound
from umo.process.named_files import named_files
from umo.text import INSTALLED, is_users, printable, shown_path, some

MAX_FILE_BYTES = 8 << 20
"""The largest number of bytes of a file that are hashed, in addition to its size. It is limited because a run waits for
the hashes."""


def source_files(place: Path, wiring: object, machine: Compound) -> dict[str, str]:
    """Return the hash of each file that this process has read for a run, by its absolute path: the wiring if it is a
    file, recipes, and every module that does not belong to umo, Python or an installed package. `place`: the folder of
    the station, whose modules always count, or its script. A file that cannot be read does not count."""
    folder = place.resolve()
    files = [str(wiring.resolve())] if isinstance(wiring, Path) else []
    files += [str(file) for file in _recipes(machine)]
    files += sorted({file for file in _modules() if is_users(file) or _is_in(file, folder)})
    return {file: found for file in files if (found := digest_of(file))}


def later_files(place: Path, known: Mapping[str, str]) -> dict[str, str]:
    """Return the hashes, as `source_files` does, of files in the folder of the station that its code names and may read
    later: a module that is imported in the middle of a run, a table of values."""
    folder = _folder_of(place.resolve())
    return {file: found for file in named_files(known, folder) if file not in known and (found := digest_of(file))}


class ChangedFile(NamedTuple):
    path: str
    """The path relative to the folder of the station; for other files absolute, or relative to the current folder if
    that is shorter."""
    is_gone: bool
    is_read: bool = True
    """True if the run has read the file. Otherwise the code of the run names the file, and the run may have read it."""


def changed_files(about: Mapping[str, Any]) -> list[ChangedFile]:
    """Return the files of a run that have changed on disk since it read them, according to the hashes in its frames
    (`Reader.about`). The result is empty for a run on another computer, and for a run without hashes."""
    job = about.get("job")
    if not isinstance(job, Mapping) or job.get("host") != platform.node():
        return []
    found = []
    for is_read, known in ((True, job.get("sources")), (False, job.get("later"))):
        for file, was in known.items() if isinstance(known, Mapping) else ():
            now = digest_of(file)
            if now != was:
                found.append(ChangedFile(_shown(file, str(about.get("place", ""))), not now, is_read))
    return found


def other_files(job: Mapping[str, Any], place: Path) -> list[str] | None:
    """Return the names of the files that differ in `place` and that a recorded run has read, or may have read, in the
    folder of its station or next to its script. The wiring does not count, because a recording contains it. Return None
    if the job has no hashes."""
    known, where, wiring = job.get("sources"), job.get("place"), job.get("wiring")
    if not isinstance(known, Mapping) or not known or not isinstance(where, str):
        return None
    later = job.get("later")
    known = {**(later if isinstance(later, Mapping) else {}), **known}
    own = str(wiring.get("file", "")) if isinstance(wiring, Mapping) else ""
    before, today = _folder_of(Path(where)), _folder_of(place)
    found = []
    for file, digest in known.items():
        if _is_below(file, before, own):
            name = Path(str(file)).relative_to(before)
            there = place if str(file) == where else today / name  # a script may have another name
            if digest_of(str(there)) != digest:
                found.append(str(name))
    return sorted(found)


def _folder_of(place: Path) -> Path:
    return place.parent if place.suffix == ".py" else place


def _is_below(file: object, folder: Path, wiring: str) -> bool:
    """Return True if this is a file below a folder, judged only by its name, and not the wiring."""
    path = Path(str(file))
    return file != wiring and ".." not in path.parts and path.is_relative_to(folder)


def changed_text(changed: Sequence[ChangedFile]) -> str:
    """Return a text about the changed files, such as `it runs the former control.py, which has changed on disk since
    the start; the next run takes it as it is now`. The text is empty if nothing has changed."""
    texts = []
    for is_read, runs in ((True, "runs the former"), (False, "may have read the former")):
        names = [f"{each.path} (gone)" if each.is_gone else each.path for each in changed if each.is_read is is_read]
        if names:
            has, them = ("has", "it as it is") if len(names) == 1 else ("have", "them as they are")
            texts.append(
                f"it {runs} {some(names)}, which {has} changed on disk since the start; the next run takes {them} now"
            )
    return printable("; ".join(texts))


def _modules() -> Iterator[str]:
    """Yield the absolute paths of the modules that have been imported. No module is accessed, because this would import
    a module that is imported on first use."""
    for module in list(sys.modules.values()):
        with suppress(AttributeError):
            file = object.__getattribute__(module, "__dict__").get("__file__")
            if isinstance(file, str) and file.endswith((".py", ".so")):
                yield file if os.path.isabs(file) else os.path.abspath(file)


def _is_in(file: str, folder: Path) -> bool:
    """Return True if this is a file of the folder that does not belong to a package installed there."""
    before, inside, name = file.partition(f"{folder}/")
    return bool(inside) and not before and not any(part in f"/{name}" for part in INSTALLED)


def _recipes(machine: Compound) -> Iterator[Path]:
    if "umo.operation.recipe_book" not in sys.modules:
        return
    from umo.operation.recipe_book import books_of

    for book in books_of(machine).values():
        place = book.place.resolve()
        yield from sorted(place.glob("*.toml")) if place.is_dir() else [place]


def digest_of(file: str) -> str:
    """Return the first 32 hexadecimal digits of the SHA-256 of a file; empty if the file cannot be read."""
    try:
        stat = Path(file).stat()
        return _digest_of(file, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino)
    except (OSError, ValueError):
        return ""


@lru_cache(maxsize=1000)
def _digest_of(file: str, size: int, *version: int) -> str:
    """Return the digest of a file. The content is read again only if the size, the times or the inode of the file have
    changed, because the page needs the digest every second. A copying program can set the time of modification, but not
    the time of the inode's change."""
    with Path(file).open("rb") as stream:
        content = hashlib.sha256(stream.read(MAX_FILE_BYTES))
    if size > MAX_FILE_BYTES:
        content.update(str(size).encode())
    return content.hexdigest()[:32]


def _shown(file: str, place: str) -> str:
    path = Path(file)
    return path.relative_to(place).as_posix() if place and path.is_relative_to(place) else shown_path(file)
