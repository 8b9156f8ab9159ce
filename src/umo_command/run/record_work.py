"""The work of a recorder, from the first frame to the file."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from umo.errors import UmoError, text_of
from umo.process.frames import Reader
from umo.recording import flight_folder
from umo.recording.flight_folder import FlightFolder
from umo.recording.protobuf_channels import ProtobufChannels
from umo.recording.record_settings import RecordSettings
from umo.recording.recorder import Recorder
from umo.recording.recording_parts import RecordingParts


class RecordingWork:
    """Records one run to a file, or in a flight recorder. Raises OSError or UmoError if it cannot begin. A full disk
    ends the recording with a notice. The file keeps everything that was written before."""

    def __init__(
        self,
        reader: Reader,
        file: Path,
        settings: RecordSettings,
        say: Callable[[str], object],
        *,
        threaded: bool = True,
    ) -> None:
        """`threaded`: True if a separate thread writes while frames are read."""
        self._reader, self._file, self._say = reader, file, say
        self._last = settings.last
        self._folder: FlightFolder | None = None
        if settings.last is not None:
            self._folder = flight_folder.new(str(reader.about["station"]), int(reader.about["pid"]), os.getpid())
        path = file if self._folder is None else self._folder.file
        try:
            self._parts = RecordingParts(path, reader.layout, ProtobufChannels(reader.layout, settings.rate), settings)
        except OSError:
            if self._folder is not None:
                self._folder.remove()
            raise
        self._thread = ThreadPoolExecutor(1, "umo record") if threaded else None
        self._recorder = Recorder(reader, self._parts, thread=self._thread)
        self.is_over = False
        """True if the recording has ended."""
        self.failed = False
        """True if the recording ended before the run, or could not be saved."""

    @property
    def pause(self) -> float:
        """The time in s until the next look."""
        return self._recorder.pause

    @property
    def progress(self) -> str:
        """The progress so far, as text."""
        words = [f"{self._recorder.periods:,} periods", f"{self._parts.size / 1e6:.1f} MB"]
        if self._recorder.lost:
            words.append(f"{self._recorder.lost:,} periods lost")
        return ", ".join(words)

    def look(self) -> None:
        """Read and write new frames. Return True if the run has ended or the disk is full."""
        if self.is_over:
            return
        ended = self._recorder.has_ended
        try:
            self._recorder.look()
        except OSError as error:
            self._fail(error)
            return
        self.is_over = ended

    def finish(self) -> None:
        """Write the remaining data, and report the result."""
        self.is_over = True
        if not self.failed:
            try:
                self._recorder.finish()
            except OSError as error:
                self._fail(error)
        self._close()

    def _fail(self, error: OSError) -> None:
        self.is_over = self.failed = True
        self._say(f"the recording ends here, and the machine continues: {self._parts.path}: {text_of(error)}")

    def _close(self) -> None:
        recorder, parts = self._recorder, self._parts
        recorder.close()
        if self._thread is not None:
            self._thread.shutdown()
        try:
            parts.close()
        except OSError as error:
            self.failed = True
            self._say(
                f"{parts.path} has all its periods, but could not be closed: {text_of(error)}; umo recording "
                f"repair closes it"
            )
        if parts.failed:
            self._say(parts.failed)
        if self._folder is not None:
            self._land(self._folder)
        elif recorder.periods:
            self._say(f"recorded: {self._file}{self._in_words()}")
        else:
            parts.discard()
            if self.failed:
                self._say(f"nothing was recorded: {self._file} has no complete block, and is removed")

    def _in_words(self) -> str:
        recorder, parts = self._recorder, self._parts
        more = len(parts.paths) - 1
        words = [
            f"{recorder.periods} periods",
            f"{parts.size / 1e6:.1f} MB" + (f" in {more + 1} files" if more and self._folder is None else ""),
        ]
        if recorder.first:
            words.append(f"from period {recorder.first} on, so it cannot be replayed")
        if recorder.lost:
            words.append(f"{recorder.lost} periods were lost, because the recorder was too slow")
        if recorder.entries_lost or recorder.commands_lost:
            words.append(f"{recorder.entries_lost} entries and {recorder.commands_lost} commands were lost")
        if recorder.events_lost:
            words.append(f"{recorder.events_lost} events were lost")
        return f" ({', '.join(words)})"

    def _land(self, folder: FlightFolder) -> None:
        """Save what the flight recorder has if the run has failed; remove its files."""
        if self.failed and self._recorder.periods:
            self._say(f"the files of the flight recorder remain; umo recording save {folder.station} saves them")
            return
        if not self._recorder.has_ended:
            self._say("the flight recorder ended before the run, and saved nothing")
        elif self._recorder.failed and self._recorder.periods:
            try:
                folder.save(self._file)
            except (OSError, UmoError) as error:
                self.failed = True
                self._say(f"the flight record could not be saved: {text_of(error)}; its files: {folder.path}")
                return
            self._say(f"the run has failed; recorded: {self._file}{self._in_words()}")
        folder.remove()


def record_to_the_end(
    work: RecordingWork, stopped: Callable[[], Any], sleep: Callable[[float], Any] = time.sleep
) -> None:
    """Record until the run ends, or until this process is asked to stop."""
    while not work.is_over and not stopped():
        work.look()
        sleep(work.pause)
    work.finish()
