"""What a run was stands in its frames: enough to run the same again."""

import json
import os
from itertools import count
from pathlib import Path

import pytest

from umo.frames import Layout
from umo.frames.layout import without_job
from umo.process import job_facts as job_facts_module
from umo.process.job import Job, Plan
from umo.process.job_facts import files_hash, job_facts


def test_a_job_tells_station_wiring_options_and_versions() -> None:
    facts = job_facts(Plan(Job(station="ztheta", options={"seed": 7})), {"numbers": {"z.offset": {"value": 1.5}}})
    assert facts["station"] == "ztheta" and Path(facts["place"]).is_dir()
    assert "[wire]" in facts["wiring"]["text"] or "wire" in facts["wiring"]["text"]
    assert facts["options"]["given"] == {"seed": 7} and facts["options"]["drivers"]["seed"] == 7
    assert set(facts["versions"]) == {"umo", "python", "numpy", "platform"} and len(facts["files"]) == 64
    assert facts["kept"]["numbers"]["z.offset"]["value"] == 1.5
    assert json.loads(json.dumps(facts)) == facts


def test_the_hash_of_a_station_is_that_of_its_code(tmp_path: Path) -> None:
    (tmp_path / "wiring").mkdir()
    (tmp_path / "objects.py").write_text("a = 1")
    (tmp_path / "wiring" / "rig.toml").write_text("b = 2")
    before = files_hash(tmp_path)
    for name in ("__pycache__", "runs", ".git"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "x.py").write_text("")
    (tmp_path / "notes.txt").write_text("")
    assert files_hash(tmp_path) == before
    (tmp_path / "wiring" / "rig.toml").write_text("b = 3")
    assert files_hash(tmp_path) != before
    assert files_hash(tmp_path / "objects.py") != files_hash(tmp_path / "none.py")


def test_a_folder_that_takes_long_is_not_hashed_and_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "objects.py").write_bytes(bytes(100))
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "curves.json").write_bytes(bytes(100))
    assert len(files_hash(tmp_path)) == 64
    ticks = count(0.0, job_facts_module.MAX_TIME * 0.6)
    assert files_hash(tmp_path, lambda: next(ticks)) == f"not hashed: more than 30 ms in {tmp_path}"
    with monkeypatch.context() as patch:
        patch.setattr(job_facts_module, "MAX_NAMES", 2)
        assert files_hash(tmp_path) == f"not hashed: more than 2 names in {tmp_path}"
    with (tmp_path / "more" / "curves.json").open("r+b") as file:
        file.truncate(1 << 40)
    assert files_hash(tmp_path) == f"not hashed: more than 8 MiB in {tmp_path}"


def test_what_is_no_file_keeps_nothing_waiting(tmp_path: Path) -> None:
    (tmp_path / "objects.py").write_text("a = 1")
    before = files_hash(tmp_path)
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "endless.py").symlink_to("/dev/zero")
    (tmp_path / "nowhere.py").symlink_to("gone.py")
    assert files_hash(tmp_path) == before


def test_facts_that_cannot_be_told_do_not_keep_a_run_from_starting() -> None:
    plan = Plan(Job(station="ztheta"))
    plan.job.options["again"] = plan.job.options
    assert set(job_facts(plan)) == {"error"}


def test_other_computers_are_not_told_what_was_run() -> None:
    layout = Layout((), (), {"station": "press", "job": {"wiring": "secret"}})
    assert without_job(layout).about == {"station": "press"}
