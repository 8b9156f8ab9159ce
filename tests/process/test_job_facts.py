"""What a run was stands in its frames: enough to run the same again."""

import json
from pathlib import Path

from umo.process.frames import Layout
from umo.process.frames.layout import without_job
from umo.process.job import Job, Plan
from umo.process.job_facts import job_facts


def test_a_job_tells_station_wiring_options_and_versions() -> None:
    facts = job_facts(Plan(Job(station="ztheta", options={"seed": 7})), {"numbers": {"z.offset": {"value": 1.5}}})
    assert facts["station"] == "ztheta" and Path(facts["place"]).is_dir()
    assert "[wire]" in facts["wiring"]["text"] or "wire" in facts["wiring"]["text"]
    assert facts["options"]["given"] == {"seed": 7} and facts["options"]["drivers"]["seed"] == 7
    assert set(facts["versions"]) == {"umo", "python", "numpy", "platform"}
    assert any(file.endswith("ztheta/objects.py") for file in facts["sources"])
    assert facts["kept"]["numbers"]["z.offset"]["value"] == 1.5
    assert json.loads(json.dumps(facts)) == facts


def test_facts_that_cannot_be_told_do_not_keep_a_run_from_starting() -> None:
    plan = Plan(Job(station="ztheta"))
    plan.job.options["again"] = plan.job.options
    assert set(job_facts(plan)) == {"error"}


def test_other_computers_are_not_told_what_was_run() -> None:
    layout = Layout((), (), {"station": "press", "job": {"wiring": "secret"}})
    assert without_job(layout).about == {"station": "press"}
