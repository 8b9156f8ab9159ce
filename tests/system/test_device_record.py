"""Records of unsafe ends: every user's own, read by all, forged or removed by none."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import signal
import stat
import sys
import tempfile
from pathlib import Path

import pytest

from helpers import process_box
from helpers.runs import Run
from umo import UmoError
from umo.errors import AcknowledgeRequired
from umo.exit_status import ExitStatus
from umo.system import device_record, folders
from umo.system.device_record import DeviceClaim, DeviceRecord, all_standing, standing

DEVICE = "bus 1"
ROOT = hasattr(os, "geteuid") and os.geteuid() == 0
NOBODY = 65534


FILE = hashlib.sha256(DEVICE.encode()).hexdigest()[:24] + device_record.SUFFIX
"""The name of its record, the same of all users and versions of umo."""


def own_folder() -> Path:
    folder = device_record.state_folder() / device_record.FOLDER
    folder.mkdir(exist_ok=True)
    return folder


def own_file() -> Path:
    return own_folder() / FILE


def test_a_record_stands_from_the_start_to_the_safe_end() -> None:
    run = DeviceRecord([DEVICE], "press", "bench")
    run.begin(False)
    (ended,) = standing(DEVICE)
    assert (ended.state, ended.station, ended.wiring, ended.device) == ("running", "press", "bench", DEVICE)
    run.finish()
    assert standing(DEVICE) == []
    assert list(own_folder().iterdir()) == []


def test_an_unsafe_end_is_told_to_the_next_start_until_it_is_acknowledged() -> None:
    first = DeviceRecord([DEVICE], "press", "bench")
    first.begin(False)
    first.stopped("the control process was killed", ["ram"])
    told = r"press \(bench\) on bus 1 was stopped at .*killed; not reached: ram"
    with pytest.raises(AcknowledgeRequired, match=told):
        DeviceRecord([DEVICE], "lathe", "other").begin(False)
    second = DeviceRecord([DEVICE], "lathe", "other")
    second.begin(True)
    second.finish()
    DeviceRecord([DEVICE], "press", "bench").begin(False)


# Devices of other names ---------------------------------------------------------------------------------


def launched(device: str, launch: str = "press with rig") -> DeviceRecord:
    return DeviceRecord([device], "press", "rig", launch)


def test_an_unsafe_end_is_told_though_the_device_has_another_name_after_a_restart() -> None:
    """As where a link in /dev leads to another file, or a host has another address."""
    launched("serial /dev/ttyUSB0").begin(False)
    with pytest.raises(AcknowledgeRequired, match=r"on serial /dev/ttyUSB0 was started"):
        launched("serial /dev/ttyUSB1").begin(False)
    second = launched("serial /dev/ttyUSB1")
    second.begin(True)
    second.abandon()
    assert [each.device for each in all_standing()] == ["serial /dev/ttyUSB0"]
    second.begin(True)
    second.stopped("killed", [])
    assert [each.device for each in all_standing()] == ["serial /dev/ttyUSB1"]


def test_an_unsafe_end_that_was_acknowledged_is_gone_after_a_safe_one() -> None:
    launched("serial /dev/ttyUSB0").begin(False)
    second = launched("serial /dev/ttyUSB1")
    second.begin(True)
    second.finish()
    assert all_standing() == []


@pytest.mark.parametrize("launch", ["press with other options", ""])
def test_another_launch_of_a_station_has_devices_of_its_own(launch: str) -> None:
    launched("bus 1", launch).begin(False)
    launched("bus 2").begin(False)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="what holds devices is Linux's")
def test_a_run_of_the_same_launch_that_goes_on_is_no_unsafe_end() -> None:
    first = DeviceClaim(["bus 1"], "press", "rig", launch="press with rig")
    second = DeviceClaim(["bus 2"], "press", "rig", launch="press with rig")
    second.finish()
    first.finish()
    assert all_standing() == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes of their own need Linux")
def test_a_supervisor_does_not_start_a_machine_that_stands_stopped_though_its_device_has_another_name(
    tmp_path: Path,
) -> None:
    link = tmp_path / "by-id"
    for name in ("ttyUSB0", "ttyUSB1"):
        process_box.Cells(tmp_path / name)
    link.symlink_to("ttyUSB0")
    run = Run(process_box.wiring(link), "forever").until_running()
    for pid in (run.standby, run.guardian, run.control):
        os.kill(pid, signal.SIGKILL)
    run.until_all_ended()
    run.channel.close()
    link.unlink()
    link.symlink_to("ttyUSB1")
    outcome = Run(process_box.wiring(link)).outcome()
    assert (outcome.status, outcome.driven) == (ExitStatus.MISTAKE, False)
    assert outcome.failure is not None
    assert "ttyUSB0" in outcome.failure.message
    assert Run(process_box.wiring(link), acknowledge=True).outcome().status == 0
    assert all_standing() == []


def test_each_device_of_a_run_stands_by_itself() -> None:
    first = DeviceRecord([DEVICE, "bus 2"], "press", "")
    first.begin(False)
    first.stopped("killed", [])
    with pytest.raises(AcknowledgeRequired):
        DeviceRecord(["bus 2"], "other", "").begin(False)
    DeviceRecord(["bus 3"], "other", "").begin(False)


def test_a_run_that_drove_nothing_leaves_what_was_to_be_acknowledged() -> None:
    first = DeviceRecord([DEVICE], "press", "bench")
    first.begin(False)
    first.stopped("killed", ["ram"])
    told = [str(ended) for ended in standing(DEVICE)]
    second = DeviceRecord([DEVICE, "bus 2"], "press", "bench")
    second.begin(True)
    second.abandon()
    assert [str(ended) for ended in standing(DEVICE)] == told
    assert standing("bus 2") == []


@pytest.mark.parametrize("content", [b"", b"not JSON", b"[1]", b'{"device": 1}', b"\xff\xfe", b"[" * 100_000])
def test_a_record_that_cannot_be_read_is_never_taken_for_a_safe_end(content: bytes) -> None:
    DeviceRecord([DEVICE], "press", "").begin(False)
    own_file().write_bytes(content)
    (ended,) = standing(DEVICE)
    assert "is unknown: its record cannot be read" in str(ended)
    assert "every actuator was reset" not in str(ended)
    with pytest.raises(AcknowledgeRequired):
        DeviceRecord([DEVICE], "press", "").begin(False)
    again = DeviceRecord([DEVICE], "press", "")
    again.begin(True)
    again.finish()
    assert standing(DEVICE) == []


ODD: list[dict[str, object]] = [
    {"when": 1e300},
    {"when": float("nan")},
    {"unreached": [1]},
    {"unreached": 3},
    {"seen": [None]},
    {"station": 5},
]


@pytest.mark.parametrize("odd", ODD)
def test_a_record_with_a_value_that_makes_no_sense_counts_as_unreadable(odd: dict[str, object]) -> None:
    DeviceRecord([DEVICE], "press", "").begin(False)
    own_file().write_text(json.dumps(json.loads(own_file().read_text()) | odd))
    (ended,) = standing(DEVICE)
    assert "is unknown: its record cannot be read" in str(ended)


def test_a_record_cannot_send_commands_to_the_terminal_that_shows_it() -> None:
    run = DeviceRecord([DEVICE], "\x1b[2Jpress", "")
    run.begin(False)
    run.stopped("\x1b]0;title\x07", ["\x1b[31mram"])
    for state in ("stopped", "running", "odd"):
        content = json.loads(own_file().read_text())
        own_file().write_text(json.dumps(content | {"state": state, "device": "bus\x1b[2J"}))
        (ended,) = standing(DEVICE)
        assert str(ended).isprintable()
        assert "bus?[2J" in str(ended)


def test_a_start_that_can_be_written_down_for_one_of_two_devices_only_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    files = []
    sync = os.fsync

    def full(file: int) -> None:
        files.append(file)
        if len(files) > 2:  # the record and the folder of the first device
            raise OSError(28, "No space left on device")
        sync(file)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UmoError, match="the start of the run could not be recorded: No space left"):
        DeviceRecord(["bus 1", "bus 2"], "press", "").begin(False)
    assert standing("bus 1") == []


def test_an_acknowledged_start_that_cannot_be_written_down_leaves_every_unsafe_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = DeviceRecord(["bus 1", "bus 2"], "press", "")
    before.begin(False)
    before.stopped("killed", ["ram"])

    def full(file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UmoError):
        DeviceRecord(["bus 1", "bus 2"], "press", "").begin(True)
    assert [ended.state for device in ("bus 1", "bus 2") for ended in standing(device)] == ["stopped"] * 2


@pytest.mark.parametrize("place", ["a file", "a file/below", "/proc/nothing"])
def test_a_folder_of_records_that_cannot_be_used_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    (tmp_path / "a file").touch()
    monkeypatch.setenv("UMO_STATE", str(tmp_path / place))
    with pytest.raises(UmoError, match="the records of earlier runs cannot be read: "):
        DeviceRecord([DEVICE], "press", "").begin(False)


def test_without_devices_nothing_is_written() -> None:
    run = DeviceRecord([], "press", "")
    run.begin(False)
    assert all_standing() == []
    run.finish()


def test_a_record_is_protected_from_the_clearing_of_old_files() -> None:
    DeviceRecord([DEVICE], "press", "").begin(False)
    assert stat.S_IMODE(own_file().stat().st_mode) == 0o1644


def test_a_symbolic_link_in_its_place_is_neither_followed_nor_believed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    own_file().symlink_to(victim)
    with pytest.raises(AcknowledgeRequired):
        DeviceRecord([DEVICE], "press", "").begin(False)
    run = DeviceRecord([DEVICE], "press", "")
    run.begin(True)
    run.finish()
    assert victim.read_text() == "precious"


# Other users ----------------------------------------------------------------------------------------------


def others(state: str = "stopped", name: str = f"{folders.PREFIX}{NOBODY}") -> Path:
    """A record that another user has written."""
    folder = folders.lasting() / name / device_record.FOLDER
    folder.mkdir(parents=True)
    content = {"device": DEVICE, "station": "theirs", "wiring": "", "state": state, "when": 1.0, "id": "abc"}
    file = folder / FILE
    file.write_text(json.dumps(content))
    for path in (folder.parent, folder, file):
        os.chown(path, NOBODY, NOBODY)
    return file


@pytest.mark.skipif(not ROOT, reason="writing as another user needs root")
def test_another_users_unsafe_end_is_told_with_their_name_and_acknowledged_once() -> None:
    others()
    with pytest.raises(AcknowledgeRequired, match="theirs on bus 1 was stopped by user 65534"):
        DeviceRecord([DEVICE], "press", "").begin(False)
    run = DeviceRecord([DEVICE], "press", "")
    run.begin(True)
    run.finish()
    again = DeviceRecord([DEVICE], "press", "")
    again.begin(False)
    again.stopped("killed", [])
    assert [ended.station for ended in standing(DEVICE)] == ["press"]


@pytest.mark.skipif(not ROOT, reason="writing as another user needs root")
@pytest.mark.parametrize(
    "content", [b"not JSON", b'{"device": "bus 1", "station": "", "wiring": "", "state": "x", "when": 1}']
)
def test_another_users_record_without_an_id_is_acknowledged_once_until_it_is_written_again(content: bytes) -> None:
    file = others()
    file.write_bytes(content)
    run = DeviceRecord([DEVICE], "press", "")
    run.begin(True)
    run.finish()
    DeviceRecord([DEVICE], "press", "").begin(False)
    os.utime(file, ns=(1, 1))
    with pytest.raises(AcknowledgeRequired, match="by user 65534"):
        DeviceRecord([DEVICE], "press", "").begin(False)


@pytest.mark.skipif(not ROOT, reason="writing as another user needs root")
def test_another_user_cannot_forge_a_safe_end_over_this_users_record() -> None:
    DeviceRecord([DEVICE], "press", "").begin(False)
    others("ended")
    assert [ended.station for ended in standing(DEVICE)] == ["press"]


@pytest.mark.skipif(not ROOT, reason="writing as another user needs root")
def test_a_file_that_does_not_belong_to_the_folders_owner_is_not_believed() -> None:
    file = others()
    os.chown(file, 1, 1)
    assert standing(DEVICE) == []


@pytest.mark.skipif(not ROOT, reason="writing as another user needs root")
def test_whoever_takes_this_users_name_first_changes_nothing() -> None:
    squatted = folders.lasting() / f"{folders.PREFIX}{os.getuid()}"
    squatted.mkdir()
    os.chown(squatted, NOBODY, NOBODY)
    DeviceRecord([DEVICE], "press", "").begin(False)
    assert [ended.station for ended in standing(DEVICE)] == ["press"]
    assert list(squatted.iterdir()) == []


@pytest.mark.skipif(not ROOT, reason="reading as another user needs root")
@pytest.mark.parametrize(("mode", "state"), [(0o755, "running"), (0o700, "unknown")])
def test_another_user_reads_this_users_record_and_takes_none_that_is_hidden_for_a_safe_end(
    monkeypatch: pytest.MonkeyPatch, mode: int, state: str
) -> None:
    with tempfile.TemporaryDirectory() as place:
        os.chmod(place, 0o1777)
        monkeypatch.setenv("UMO_STATE", place)
        DeviceRecord([DEVICE], "press", "").begin(False)
        own_folder().chmod(mode)
        child = os.fork()
        if child == 0:
            os.setuid(NOBODY)
            os._exit([(ended.user, ended.state) for ended in standing(DEVICE)] != [("user 0", state)])
        assert os.waitpid(child, 0)[1] == 0


def test_a_record_that_cannot_be_written_leaves_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UmoError, match="No space left"):
        DeviceRecord([DEVICE], "press", "bench").begin(False)
    assert list(own_folder().iterdir()) == []


def test_a_start_that_is_interrupted_while_it_is_recorded_leaves_no_record(monkeypatch: pytest.MonkeyPatch) -> None:
    waits = iter([False, False, True])

    def interrupted(file: int) -> None:
        if next(waits, False):
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        DeviceRecord([DEVICE, "bus 2"], "press", "bench").begin(False)
    assert list(own_folder().iterdir()) == []
