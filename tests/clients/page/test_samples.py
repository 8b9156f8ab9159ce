"""The CSV of a part of the history."""

from __future__ import annotations

from http.client import HTTPConnection
from types import SimpleNamespace
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest

from umo.clients.page.subscriptions import HistoryPart, csv_of
from umo.objects.presentation.described import Described
from umo.recording.scope.history import History

from .conftest import TOKEN, Served, opened, running, serving


def stretch(
    history: History, entries: list[dict[str, str]], start: float, stop: float, utc: float | None = None
) -> HistoryPart:
    watched: Any = SimpleNamespace(history=history, entries=list(map(Described, entries)), utc=utc)
    return HistoryPart(watched, list(range(len(entries))), start, stop)


def test_numbers_states_and_missing_values_are_told() -> None:
    entries = [
        {"path": "motor", "unit": "V"},
        {"path": "valve", "one": "ON", "zero": "OFF"},
        {"path": "clock", "unit": "sampling_period"},
    ]
    history = History(3, 0.001)
    history.add(np.array([0.001, 0.002, 0.003]), np.array([[0.1, 1, 5], [np.nan, 0, 6], [2, np.nan, 7]]))
    lines = "".join(csv_of(stretch(history, entries, 0.001, 0.003))).splitlines()
    assert lines[0] == "time [s],motor [V],valve,clock"
    assert lines[1:] == ["0.001,0.1,ON,5.0", "0.002,,OFF,6.0", "0.003,2.0,,7.0"]


def test_an_object_has_the_digits_of_its_resolution_and_what_has_none_all_of_them() -> None:
    entries = [{"path": "motor", "unit": "V", "resolution": 0.005, "zero_offset": 0.0}, {"path": "error", "unit": "V"}]
    history = History(2, 0.001)
    history.add(np.array([0.001, 0.002]), np.array([[9.983e-5, 9.983e-5], [0.015, 1 / 3]]))
    lines = "".join(csv_of(stretch(history, entries, 0.001, 0.002))).splitlines()
    assert lines[1:] == ["0.001,0.000,9.983e-05", "0.002,0.015,0.3333333333333333"]


def test_of_a_run_in_real_time_each_sample_has_its_utc() -> None:
    history = History(1, 0.001)
    history.add(np.array([0.0, 1.5]), np.zeros((2, 1)))
    lines = "".join(csv_of(stretch(history, [{"path": "motor"}], 0.0, 2.0, utc=1_700_000_000.25))).splitlines()
    assert lines[0] == "time [s],UTC,motor"
    assert lines[1:] == ["0.0,2023-11-14T22:13:20.250000Z,0.0", "1.5,2023-11-14T22:13:21.750000Z,0.0"]


def test_the_utc_of_a_sample_is_rounded_to_a_microsecond() -> None:
    history = History(1, 0.001)
    history.add(np.arange(1000) * 0.001, np.zeros((1000, 1)))
    lines = "".join(csv_of(stretch(history, [{"path": "motor"}], 0.0, 2.0, utc=1_711_523_487.05))).splitlines()[1:]
    assert all(line.split(",")[1].endswith("000Z") for line in lines)


def test_only_the_samples_between_the_times_are_told() -> None:
    history = History(1, 0.001)
    times = np.arange(5000) * 0.001
    history.add(times, times[:, np.newaxis])
    lines = "".join(csv_of(stretch(history, [{"path": "motor"}], 0.1, 4.2))).splitlines()[1:]
    assert [float(line.partition(",")[0]) for line in lines] == times[100:4201].tolist()


@pytest.mark.full
def test_no_sample_of_many_traces_over_all_of_the_history_is_left_out() -> None:
    columns, count = 16, 290_000
    history = History(columns, 0.001)
    for start in range(0, count, 10_000):
        times = np.arange(start, start + 10_000) * 0.001
        history.add(times, np.zeros((10_000, columns)))
    entries = [{"path": f"trace{column}"} for column in range(columns)]
    assert sum(text.count("\n") for text in csv_of(stretch(history, entries, 0.0, 300.0))) == 1 + count


def ask(served: Served, path: str, token: str = TOKEN) -> tuple[int, str]:
    connection = HTTPConnection("127.0.0.1", served.port, timeout=20)
    try:
        connection.request("GET", f"{path}&token={quote(token)}")
        response = connection.getresponse()
        return response.status, response.read().decode()
    finally:
        connection.close()


def test_the_server_sends_every_sample_of_a_run() -> None:
    with running(count=700), serving() as served, opened(served.socket) as client:
        client.get("description")
        while client.get("state")["stop"] < 0.699:
            pass
        status, text = ask(served, "/csv/press?path=encoder&path=valve&start=0&stop=9")
        assert status == 200
        assert text.count("\n") == 701


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("/csv/oven?path=encoder&start=0&stop=9", 404),
        ("/csv/press?path=nothing&start=0&stop=9", 400),
        ("/csv/press?path=encoder&start=0", 400),
        ("/csv/press?path=encoder&start=nan&stop=9", 400),
        ("/csv/press?path=encoder&start=3&stop=2", 400),
    ],
)
def test_a_file_that_cannot_be_made_is_refused(path: str, status: int) -> None:
    with running(), serving() as served, opened(served.socket) as client:
        client.get("description")
        found, text = ask(served, path)
        assert (found, text.count("\n")) == (status, 1)


def test_the_file_is_not_sent_without_the_token() -> None:
    with serving() as served:
        assert ask(served, "/csv/press?path=encoder&start=0&stop=9", "wrong")[0] == 401
