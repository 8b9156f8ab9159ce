"""Folders that are shared in places where anybody may write: whatever stands there already, nobody is led astray."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from umo.errors import FramesError
from umo.process.frames import blackbox
from umo.process.frames.frame_server import folder
from umo.system import folders

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="users are known by numbers here")
needs_root = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives folders away")
NOBODY = 65534


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


def given_away(path: Path) -> Path:
    path.mkdir()
    os.chown(path, NOBODY, -1)
    return path


def test_a_folder_of_ones_own_is_made_once_and_found_again(tmp_path: Path) -> None:
    path = folders.own(tmp_path)
    assert (path.parent, mode(path)) == (tmp_path, 0o700)
    assert folders.own(tmp_path) == path
    assert list(tmp_path.iterdir()) == [path]


def test_others_may_look_where_one_use_wants_that_and_never_write(tmp_path: Path) -> None:
    path = folders.own(tmp_path, 0o755)
    assert mode(path) == 0o755
    assert mode(folders.own(tmp_path, 0o700)) == 0o755
    path.chmod(0o777)
    assert mode(folders.own(tmp_path)) == 0o755
    path.chmod(0o500)
    assert mode(folders.own(tmp_path)) == 0o700


@needs_root
def test_a_folder_of_another_owner_with_our_name_is_passed_over(tmp_path: Path) -> None:
    theirs = given_away(tmp_path / f"umo-{os.getuid()}")
    path = folders.own(tmp_path)
    assert path != theirs
    assert path.stat().st_uid == os.getuid()
    assert folders.own(tmp_path) == path


@needs_root
def test_all_likely_names_may_be_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "MAX_FOLDERS", 3)
    for end in ("", "-1", "-2"):
        given_away(tmp_path / f"umo-{os.getuid()}{end}")
    path = folders.own(tmp_path)
    assert path.stat().st_uid == os.getuid()
    assert folders.own(tmp_path) == path


def test_links_and_files_with_our_name_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / f"umo-{os.getuid()}").symlink_to(tmp_path / "there")
    (tmp_path / f"umo-{os.getuid()}-1").write_text("")
    path = folders.own(tmp_path)
    assert folders.is_own(path)
    assert path.resolve() == path
    assert list((tmp_path / "there").iterdir()) == []


def test_a_folder_that_only_begins_like_ours_is_not_ours_to_use(tmp_path: Path) -> None:
    for name in ("umo-checkout", f"umo-{os.getuid()}0"):
        (tmp_path / name).mkdir()
    assert folders.own(tmp_path) == tmp_path / f"umo-{os.getuid()}"


OWN = "import sys; from pathlib import Path; from umo.system.folders import own; sys.stdin.read(1); "
OWN += "print(own(Path(sys.argv[1]), 0o755))"


@pytest.mark.full
def test_processes_that_make_it_at_the_same_time_agree(tmp_path: Path) -> None:
    command = [sys.executable, "-c", OWN, str(tmp_path)]
    many = [
        subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # all wait, then go at once
        for _ in range(4)
    ]
    for process in many:
        assert process.stdin is not None
        process.stdin.write("!")
        process.stdin.flush()
    assert len({process.communicate()[0] for process in many}) == 1
    assert len(list(tmp_path.iterdir())) == 1


def test_another_process_of_ours_may_be_quicker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the look and the making."""
    path = tmp_path / f"umo-{os.getuid()}"
    monkeypatch.setattr(folders, "folders", lambda place: iter([path.mkdir()][1:]))
    assert folders.own(tmp_path) == path


def test_a_folder_named_by_hand_is_made(tmp_path: Path) -> None:
    path = folders.checked(tmp_path / "a" / "b")
    assert path.is_dir()
    assert folders.checked(path) == path


def test_a_folder_named_by_hand_must_be_ones_own_and_a_folder(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    (tmp_path / "file").write_text("")
    for name in ("link", "file"):
        with pytest.raises(OSError):
            folders.checked(tmp_path / name)


@needs_root
def test_a_folder_named_by_hand_must_not_be_anothers(tmp_path: Path) -> None:
    path = given_away(tmp_path / "theirs")
    with pytest.raises(PermissionError, match="another user's"):
        folders.checked(path)


def test_only_a_regular_file_of_ones_own_is_opened(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    os.mkfifo(tmp_path / "pipe")
    for follow, names in ((False, ("link", "pipe", "nothing")), (True, ("pipe", "nothing"))):
        for name in names:
            with pytest.raises(OSError):
                folders.open_own(tmp_path / name, follow=follow)
    for name, follow in (("file", False), ("link", True)):
        file = folders.open_own(tmp_path / name, follow=follow)
        assert os.read(file, 10) == b"mine"
        os.close(file)


@needs_root
def test_a_link_to_another_users_file_does_not_hide_whose_it_is(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("theirs")
    os.chown(tmp_path / "file", NOBODY, -1)
    (tmp_path / "link").symlink_to(tmp_path / "file")
    with pytest.raises(PermissionError, match=r"belongs to another user \(uid 65534\)"):
        folders.open_own(tmp_path / "link", follow=True)


# Where frames and black boxes lie -----------------------------------------------------------------------


@needs_root
def test_another_users_folder_of_frames_does_not_refuse_ours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("UMO_FRAMES")
    monkeypatch.setattr("umo.process.frames.frame_server.SHARED_MEMORY", tmp_path)
    theirs = given_away(tmp_path / f"umo-{os.getuid()}")
    path = folder()
    assert path.parent == tmp_path
    assert path != theirs
    assert mode(path) == 0o700


def test_without_shared_memory_frames_lie_with_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("UMO_FRAMES")
    monkeypatch.setattr("umo.process.frames.frame_server.SHARED_MEMORY", tmp_path / "nowhere")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert folder().parent == tmp_path


@needs_root
def test_a_folder_named_for_frames_must_be_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(given_away(tmp_path / "theirs")))
    with pytest.raises(FramesError, match="another user's"):
        folder()


@needs_root
def test_black_boxes_do_not_go_to_another_users_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_STATE", str(tmp_path))
    theirs = given_away(tmp_path / f"umo-{os.getuid()}")
    path = blackbox.folder()
    assert theirs not in path.parents
    assert (path.stat().st_uid, mode(path)) == (os.getuid(), 0o700)


def test_a_link_in_the_place_of_the_folder_of_black_boxes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UMO_STATE", str(tmp_path))
    (tmp_path / "there").mkdir()
    (folders.own(tmp_path) / "blackbox").symlink_to(tmp_path / "there")
    with pytest.raises(FramesError, match="the folder for black boxes cannot be used"):
        blackbox.folder()


def test_a_file_that_opens_itself_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    with folders.replaced(file) as new:
        new.write_text("whole")
        assert new.suffix == ".txt"
        assert not file.exists()
    with pytest.raises(KeyboardInterrupt), folders.replaced(file) as new:
        new.write_text("half")
        raise KeyboardInterrupt
    assert file.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [file]


def test_the_umask_decides_who_may_read_a_file_that_is_replaced(tmp_path: Path) -> None:
    mask = os.umask(0o027)
    try:
        with folders.replaced(tmp_path / "a.txt"):
            pass
    finally:
        os.umask(mask)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_a_link_at_the_place_of_the_new_file_is_not_followed(tmp_path: Path) -> None:
    other, file = tmp_path / "other", tmp_path / "a.txt"
    other.write_text("of somebody else")
    (tmp_path / f".{os.getpid()}.a.txt").symlink_to(other)
    with folders.replaced(file) as new:
        new.write_text("mine")
    assert (file.read_text(), other.read_text()) == ("mine", "of somebody else")
