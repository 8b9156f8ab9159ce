"""A client of the Prometheus face of a station: `python -m bench.fleet.scraper REPORT PORT`. It counts its scrapes,
and those without an answer."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from bench.fleet import report_file

PAUSE = 1.0
"""Time in s from one scrape to the next."""
PATIENCE = 2.0
"""Time in s that an answer is waited for."""


def main(report: Path, port: int) -> None:
    file = report_file.ReportFile(report)
    told: dict[str, Any] = {"scrapes": 0, "failed": 0, "samples": 0, "why": ""}
    while not file.ends:
        told["scrapes"] += 1
        try:
            with urlopen(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE) as answer:
                told["samples"] += sum(not line.startswith(b"#") for line in answer)
        except OSError as error:
            told["failed"] += 1
            told["why"] = str(error)
        file.write(lambda: told)
        time.sleep(PAUSE)
    file.write(lambda: told, now=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
