"""The facts of a run as plain data, with which the run can be repeated. They are in the frames' description as
`about["job"]`."""

from __future__ import annotations

import json
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from umo.errors import text_of
from umo.process.job import Plan
from umo.process.source_files import later_files
from umo.system.packages import umo_version
from umo.system.processes import HASH_SEED
from umo.wiring.json_values import as_plain


def job_facts(plan: Plan, kept: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
    """Return the facts about a run. `kept`: the data taken over from the last run, by section. Values that are not
    plain data (such as a driver object) are given as strings. This function raises no error: if the facts cannot be
    found, the result has only `error`."""
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
            "umo": umo_version(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "platform": f"{sys.platform} {platform.release()} {platform.machine()}",
        },
        "sources": (sources := plan.all_sources()),
        "later": later_files(plan.place, sources),
        "host": platform.node(),
        "hash_seed": os.environ.get(HASH_SEED),
    }
    return dict(json.loads(json.dumps(facts, default=_plain)))


def _wiring(plan: Plan) -> dict[str, Any]:
    """Return the name, file and text of the wiring; for a wiring that is not a file, its table."""
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
