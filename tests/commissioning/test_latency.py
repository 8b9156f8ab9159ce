"""`umo show latency`: the rule of its verdict, its advice, and one short real run, of whose times nothing is
asserted."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers.begun_programs import programs_begun
from helpers.tiers import first
from umo.commissioning.latency import Samples, judge
from umo.commissioning.latency.loop import Loop
from umo.commissioning.latency.measure import Measured
from umo.commissioning.latency.native import Slice
from umo.commissioning.latency.verdict import advice, recommend
from umo.errors import DriverError
from umo.system.realtime import Refusal
from umo_command.app import app
from umo_command.show.latency import _histogram, _table


def measured(total_us: list[float], missed: int = 0, refusals: tuple[Refusal, ...] = ()) -> Measured:
    """A loop of 1 ms with these wake-ups, and 5 us of work; waiting busily it is always quicker."""
    umo = Samples(np.array(total_us) - 5.0, np.full(len(total_us), 5.0), missed, 1e6, 1e7)
    awake = Samples(np.zeros(max(len(total_us), 1)), np.full(max(len(total_us), 1), 5.0), 0, 2e6, 1e7)
    c = Samples(np.array([20.0]), np.array([0.5]))
    return Measured(0.001, 200e-6, list(refusals), umo=umo, umo_busy=awake, c=c, c_busy=c)


@pytest.mark.parametrize(
    ("found", "word"),
    [
        (measured([50.0] * 999 + [499.0]), "yes"),
        (measured([50.0] * 999 + [501.0]), "with care"),
        (measured([50.0] * 9999, missed=1), "with care"),
        (measured([50.0] * 99, missed=1), "no"),
        (measured([50.0] * 990 + [1100.0] * 10), "no"),
        (measured([], missed=10), "no"),
    ],
)
def test_the_rule_of_the_verdict(found: Measured, word: str) -> None:
    assert judge(found).word == word


def test_the_verdict_says_what_it_rests_on() -> None:
    text = judge(measured([50.0] * 999 + [212.0])).text
    assert text == "None of 1,000 periods missed; the longest wake-up plus work was 212 µs, 21% of the period"


def test_the_verdict_is_on_what_umo_run_does_on_this_computer() -> None:
    found = measured([50.0] * 99, missed=1)
    assert judge(found).word == "no"
    found.granted = True
    assert judge(found).word == "yes"


BETTER = "99 % of the periods that begin in time end within 5 µs instead of 90 µs, 0 instead of 0 are missed, for 10%"


@pytest.mark.parametrize(
    ("granted", "better", "said"),
    [
        (True, True, f"umo run waits busily for 200 µs here: {BETTER}"),
        (False, True, f'`busy_wait = "200 us"` in [process]: {BETTER}'),
        (True, False, "`busy_wait = 0` in [process]: busy waiting for 200 µs does not help here"),
        (False, False, "busy waiting does not help here"),
    ],
)
def test_early_rising_is_recommended_where_it_helps_and_its_cost_is_said(
    granted: bool, better: bool, said: str
) -> None:
    found = measured([90.0] * 1000 if better else [5.0] * 1000)
    found.granted = granted
    assert recommend(found).startswith(said)


def files(**content: str) -> Callable[[str], str]:
    return lambda path: content.get(Path(path).name, "")


def test_advice_is_given_only_for_what_is_not_as_it_should_be(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.commissioning.latency.verdict.is_built", lambda: True)
    good = files(realtime="1", scaling_governor="performance", sched_rt_runtime_us="-1", cpuinfo="", isolated="3")
    assert [line for line in advice(measured([50.0]), good, cores=4) if "fair_server" not in line] == []
    bad = files(realtime="", scaling_governor="powersave", sched_rt_runtime_us="950000", cpuinfo="flags : hypervisor")
    refused = Refusal("memory is not locked", "ulimit -l is 64 kB", "`me - memlock unlimited`")
    monkeypatch.setattr("umo.commissioning.latency.verdict.is_built", lambda: False)
    lines = "\n".join(advice(measured([50.0], refusals=(refused,)), bad, cores=1))
    for word in (
        "extension in C",
        "only 3 of 1,000 periods are checked for two writers of one actuator",
        "memlock unlimited",
        "PREEMPT_RT",
        "powersave",
        "virtual machine",
        "one core",
    ):
        assert word in lines


def test_samples_leave_out_ticks_that_had_passed() -> None:
    samples = Samples()
    samples.add(Slice(np.array([[30_000, 5_000], [-1, 900_000], [40_000, 6_000]]), 300_000, 3_000_000))
    assert samples.missed == 1
    assert samples.busy == pytest.approx(0.1)
    assert samples.total.tolist() == [35.0, 46.0]


def test_the_histogram_counts_everything_and_fits_the_terminal() -> None:
    found = measured([20.0] * 1000 + [300.0] * 10 + [4000.0])
    lines = _histogram(found)
    assert max(map(len, lines)) <= 80
    assert any(line.endswith(" 1,000") or " 1,000 " in line for line in lines)
    assert "4000" in lines[-1] or " 1" in lines[-1]
    assert _table(found, load=False).row_count == 14


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
@pytest.mark.parametrize("compiler", first(1, [True, False]))
def test_a_short_run_leaves_figures_of_both_loops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiler: bool
) -> None:
    if not compiler:
        monkeypatch.setattr("umo.commissioning.latency.native.compiler", lambda: None)
    file = tmp_path / "figures.json"
    result = CliRunner().invoke(app, ["show", "latency", "--period", "5ms", "--for", "0.5", "--out", str(file)])
    assert result.exit_code == 0, result.output + result.stderr
    found = json.loads(file.read_text())
    assert found["umo"]["periods"] + found["umo"]["missed"] == 100
    assert found["umo_busy"]["periods"] + found["umo_busy"]["missed"] == 100
    assert (found["c"] is None) == (not compiler) or "no C compiler" in result.stderr
    assert found["laws_us"] is None or found["laws_us"].keys() == {"python", "compiled"}
    assert (found["laws_us"] is None) == ("`compile = true`" not in result.stdout)
    assert found["verdict"] in ("yes", "with care", "no")
    assert f"5 ms: {found['verdict']}. " in result.stdout


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_the_loop_has_a_process_of_one_thread_which_is_not_a_fork(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fork", lambda: pytest.fail("forked"))
    begun = programs_begun(monkeypatch)
    with closing(Loop(0.005, 0)) as loop:
        (process,) = begun
        status = Path(f"/proc/{process.pid}/status").read_text()
        assert "Threads:\t1\n" in status
        assert len(loop.run(3, busy_wait=0.001).times) == 3
    assert process.returncode == 0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="real time needs Linux")
def test_a_loop_that_cannot_begin_is_an_error_and_leaves_no_process(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(DriverError, match="ended before it started measuring"):
        Loop(0.0, 0)
    assert "is 0" in capfd.readouterr().err


@pytest.mark.parametrize("period", ["1 us", "2 s", "1 kg", "soon"])
def test_a_period_that_makes_no_sense_is_a_line_and_status_2(period: str) -> None:
    result = CliRunner().invoke(app, ["show", "latency", "--period", period])
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) <= 2
