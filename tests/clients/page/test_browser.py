"""The page in a real browser: Chromium, headless."""

from __future__ import annotations

import os
import platform
import re
import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from umo.process import source_files
from umo.testing import Scripted

from .conftest import PATIENCE, alarming, eventually, running, serving, viewing


def cell(page: Any, path: str, column: str) -> str:
    return str(page.locator(f'tr[data-path="{path}"] .{column}').inner_text())


@pytest.mark.smoke
def test_the_values_on_the_page_are_those_of_the_station(page: Any) -> None:
    with running() as step, serving() as served:
        page.goto(served.url + "#view=machine&raw=1")
        eventually(lambda: cell(page, "encoder", "raw") == "51")
        step(7)
        eventually(lambda: cell(page, "encoder", "raw") == "58")
        assert cell(page, "valve", "value") == "OFF"
        assert page.locator('tr[data-path="encoder"] .quality').get_attribute("aria-label") == "good"


def test_files_that_have_changed_on_disk_are_named_and_the_values_stay_those_of_now(page: Any, tmp_path: Path) -> None:
    file = tmp_path / "control.py"
    file.write_text("a = 1")
    known = {str(file): source_files.digest_of(str(file))}
    with running(place=tmp_path, host=platform.node(), sources=known) as step, serving() as served:
        page.goto(served.url + "#view=machine&raw=1")
        eventually(lambda: cell(page, "encoder", "raw") == "51")
        assert "former" not in page.locator("#summary").inner_text()
        file.write_text("a = 2")
        eventually(lambda: "▲ it runs the former control.py" in page.locator("#summary").inner_text())
        assert "former control.py" in page.locator('[data-fact="changed"]').inner_text()
        eventually(lambda: step(1) or not page.locator("body.stale").count())  # it is no reason to take values for old
        assert page.locator("#summary").is_visible()


def test_the_token_does_not_stay_in_the_address(page: Any) -> None:
    with running(), serving() as served:
        page.goto(served.url)
        page.locator("[data-view=scope][aria-selected=true]").wait_for()
        assert "token" not in page.url
        page.reload()
        page.locator("[data-view=scope][aria-selected=true]").wait_for()


def test_a_click_on_an_object_puts_it_on_the_scope(page: Any) -> None:
    with running(), serving() as served:
        page.goto(served.url + "#view=machine&traces=encoder")
        page.get_by_role("button", name="limit").click()
        page.locator("[data-view=scope]").click()
        page.locator('.legend tr[data-path="limit"]').wait_for()
        assert page.locator(".legend tbody tr").count() == 2
        assert "traces=encoder,limit" in page.url


def test_the_filter_leaves_what_it_names(page: Any) -> None:
    with running(), serving() as served:
        page.goto(served.url + "#view=machine")
        page.get_by_label("Filter").fill("enc")
        assert page.locator("tr[data-path]").count() == 1


def test_the_scope_measures_pauses_and_saves(page: Any, tmp_path: Path) -> None:
    with running(box=Scripted({"encoder": [1, 3] * 1000}), count=1000), serving() as served:
        page.goto(served.url + "#traces=encoder,valve&span=1")
        row = page.locator('.legend tr[data-path="encoder"] td')
        eventually(lambda: row.nth(8).inner_text().startswith("500"))
        page.locator(".plot .u-over").click(position={"x": 100, "y": 50})
        page.locator(".plot .u-over").click(position={"x": 300, "y": 50})
        eventually(lambda: "between the cursors" in page.locator("caption").inner_text())
        page.keyboard.press("Space")
        assert page.get_by_role("button", name="Continue").is_visible()
        with page.expect_download() as saved:
            page.get_by_role("button", name="CSV").click()
        saved.value.save_as(tmp_path / "scope.csv")
        lines = (tmp_path / "scope.csv").read_text().splitlines()
        assert re.match(r"time \[s\],encoder \[\w+\],valve", lines[0])
        assert len(lines) == pytest.approx(1001, abs=2)
        assert lines[1].endswith(",OFF")
        with page.expect_download() as saved:
            page.get_by_role("button", name="PNG").click()
        saved.value.save_as(tmp_path / "scope.png")
        assert (tmp_path / "scope.png").read_bytes().startswith(b"\x89PNG")


def test_the_scope_asks_for_measured_values_when_it_has_got_the_last_ones(
    page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = threading.Event()
    sent: list[str] = []
    states: list[str] = []
    monkeypatch.setattr(
        "umo.clients.page.subscriptions.measured", lambda times, values: {"maximum": 7.0, "w": go_on.wait(PATIENCE)}
    )
    page.on("websocket", lambda socket: socket.on("framesent", lambda text: sent.append(text)))
    page.on("websocket", lambda socket: socket.on("framereceived", lambda text: states.append(text)))
    with running(), serving() as served:
        page.goto(served.url + "#traces=encoder&span=1")
        eventually(lambda: page.evaluate("1") and any("measure" in text for text in sent))
        before = len(states)
        eventually(lambda: page.evaluate("1") and len(states) > before + 25)  # ten a second
        assert sum("measure" in text for text in sent) == 1
        go_on.set()
        eventually(lambda: page.locator('.legend tr[data-path="encoder"] td').nth(5).inner_text() == "7.0")


def test_of_a_state_the_share_of_time_and_the_changes_are_shown(page: Any) -> None:
    with (
        running(box=Scripted({"encoder": range(1, 5000), "limit": [0, 0, 0, 1] * 1000}), count=1000),
        serving() as served,
    ):
        page.goto(served.url + "#traces=limit&span=1")
        cells = page.locator('.legend tr[data-path="limit"] td')
        eventually(lambda: cells.nth(4).inner_text() == "FAIL 25.0 % of the time, changes: 500")


def test_the_wheel_changes_the_time_shown_and_a_drag_zooms_in(page: Any) -> None:
    with running(count=3000, box=Scripted({"encoder": range(1, 9000)})), serving() as served:
        page.goto(served.url + "#traces=encoder&span=2")
        plot = page.locator(".plot .u-over")
        plot.hover()
        page.mouse.wheel(0, -150)
        eventually(lambda: 0 < float(re.search(r"span=([\d.]+)", page.evaluate("location.hash"))[1]) < 2)
        box = plot.bounding_box()
        page.mouse.move(box["x"] + 100, box["y"] + 50)
        page.mouse.down()
        page.mouse.move(box["x"] + 300, box["y"] + 50, steps=5)
        page.mouse.up()
        assert page.get_by_role("button", name="Continue").is_visible()


def test_a_trigger_stops_at_an_edge(page: Any) -> None:
    with running(box=Scripted({"encoder": [1] * 500 + [900] * 5000}), count=400) as step, serving() as served:
        page.goto(served.url + "#traces=encoder&span=0.1")
        page.get_by_label("Trigger", exact=True).select_option("rising")
        for label in ("trigger", "level", "before", "once"):
            page.locator(".trigger label").filter(has_text=re.compile(f"^{label}")).wait_for()
        eventually(lambda: "waiting" in page.locator(".bar .hint").first.inner_text())
        page.locator('.legend tr[data-path="encoder"] td').nth(4).filter(has_text=re.compile(".")).wait_for()
        step(400)
        eventually(lambda: "triggered at" in page.locator(".bar .hint").first.inner_text())


def test_the_page_says_what_to_type_when_nothing_runs_and_then_shows_it(page: Any) -> None:
    with serving() as served:
        page.goto(served.url)
        page.get_by_text("umo run ztheta --realtime").wait_for()
        with running():
            page.locator(".legend").wait_for()


def test_several_stations_are_a_list_and_a_choice_in_each_view(page: Any) -> None:
    with running("press"), running("oven"), serving() as served:
        page.goto(served.url)
        choice = page.get_by_label("Station", exact=True)
        names = ["All stations", "press (rig)", "oven (rig)"]
        eventually(lambda: choice.locator("option").all_inner_texts() == names)
        page.get_by_role("button", name=re.compile("oven")).click()
        page.locator(".legend").wait_for()
        assert choice.input_value() == "oven"
        choice.select_option("press")
        eventually(lambda: page.title() == "press · umo")
        choice.select_option("")
        page.get_by_role("button", name=re.compile("oven")).wait_for()


def test_the_list_of_stations_tells_what_is_wrong_in_each(page: Any) -> None:
    with alarming() as go_wrong, running("oven"), serving() as served:
        page.goto(served.url)
        page.get_by_role("button", name=re.compile("tank")).wait_for()
        go_wrong(5)
        page.locator("section.stations li p.failed", has_text="✕ cell: could not be read").wait_for()
        page.locator("section.stations li p.warn", has_text="▲ cell.full: too full").wait_for()
        assert page.locator("section.stations li").nth(1).locator("p").count() == 0


def test_the_page_of_a_run_that_has_ended_leads_to_the_other_run_of_its_station(page: Any) -> None:
    with serving() as served, ExitStack() as first:
        first.enter_context(running())
        page.goto(served.url + "#view=machine&raw=1")
        eventually(lambda: page.locator('tr[data-path="encoder"]').count())
        with running("oven"), running(count=20):
            eventually(lambda: page.locator("#station option").count() == 4)
            first.close()
            page.locator("#notice").get_by_text("press has ended").wait_for()
            page.get_by_role("button", name=re.compile(r"Show press \(pid \d+\) \(rig\), which runs")).click()
            eventually(lambda: cell(page, "encoder", "raw") == "21")
            assert not page.locator("#newer").is_visible()


LONG = "the emergency stop at the door of the second hall was pressed, and the guard of the press is open. " * 3


@pytest.mark.parametrize("size", [(1280, 800), (800, 600)])
def test_a_long_reason_in_the_red_line_can_be_read_to_its_end(
    page: Any, size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.clients.page.watched_run.Watched._clients", lambda watched: {"inhibited": {"valve": LONG}})
    page.set_viewport_size({"width": size[0], "height": size[1]})
    cut = "document.querySelector('#forbidden').scrollHeight > document.querySelector('#forbidden').clientHeight + 1"
    with running(), serving() as served:
        page.goto(served.url)
        page.get_by_role("button", name="Show all").click()
        assert not page.evaluate(cut)
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        page.get_by_role("button", name="Show less").click()
        assert page.evaluate(cut)


def test_a_station_without_a_twin_is_not_asked_for_it(page: Any) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    with running(), serving() as served:
        page.goto(served.url + "#view=twin")
        page.get_by_text("This station declares no twin.").wait_for()
    assert not [url for url in asked if "/twin/press" in url]


def test_who_works_an_actuator_by_client_is_named_beside_it(page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    told = {"by_client": ["valve"], "mode": "manual", "tuned": {}, "lease": {"number": 1, "holder": "Ann (page, ::1)"}}
    monkeypatch.setattr("umo.clients.page.watched_run.Watched._clients", lambda watched: told)
    with running(), serving() as served:
        page.goto(served.url + "#view=machine")
        page.locator('tr[data-path="valve"]').get_by_text("by client: Ann (page, ::1)").wait_for()
        driver = page.locator('tr[data-path="valve"] .value').get_attribute("title")
        assert driver.startswith("Driven by a client: Ann (page, ::1). Writes of the program are refused.")


@pytest.mark.full
@pytest.mark.smoke
def test_the_page_follows_a_station_that_starts_again(page: Any) -> None:
    with serving() as served:
        with running():
            page.goto(served.url + "#view=machine&raw=1")
            eventually(lambda: page.locator('tr[data-path="encoder"]').count())
        page.locator("#notice").get_by_text("has ended").wait_for()
        with running(count=20):
            page.get_by_text("has started again").wait_for()
            eventually(lambda: cell(page, "encoder", "raw") == "21")


def test_the_page_comes_back_when_the_server_does(page: Any) -> None:
    with running():
        with serving() as served:
            page.goto(served.url)
            page.locator(".legend").wait_for()
        page.get_by_text("The connection to the server is lost").wait_for()
        with serving(served.port):
            page.get_by_text("is back").wait_for()
            page.locator("#notice").wait_for(state="hidden")


def is_stale(page: Any) -> bool:
    """Whether the values on the page are marked as old."""
    return bool(page.evaluate("document.body.classList.contains('stale')"))


def test_the_page_says_that_it_hears_nothing_from_the_server(page: Any) -> None:
    with running(), viewing("press") as (server, address):
        page.goto(f"{address}#view=machine")
        page.locator('tr[data-path="encoder"]').wait_for()
        os.kill(server.pid, signal.SIGSTOP)
        page.get_by_text("Nothing heard from the server for").wait_for()
        assert is_stale(page)
        os.kill(server.pid, signal.SIGCONT)
        page.get_by_text("Nothing heard from the server for").wait_for(state="hidden")


def test_a_station_that_ended_while_the_server_was_away_is_not_shown_any_longer(page: Any) -> None:
    with running(), serving() as served:
        page.goto(f"{served.url}#view=machine")
        page.locator('tr[data-path="encoder"]').wait_for()
    page.get_by_text("The connection to the server is lost").wait_for()
    with serving(served.port):
        page.get_by_text("press is not running").wait_for()
        assert page.locator("#summary").inner_text() == ""
        assert not page.locator('tr[data-path="encoder"]').is_visible()
        assert not page.locator("#stop").is_visible()


def test_the_page_stays_with_its_station_when_two_run_after_the_server_came_back(page: Any) -> None:
    with running() as step:
        with serving() as served:
            page.goto(f"{served.url}#view=machine&raw=1")
            eventually(lambda: cell(page, "encoder", "raw") == "51")
        page.get_by_text("The connection to the server is lost").wait_for()
        with running("oven"), serving(served.port):
            page.get_by_text("is back").wait_for()
            step(7)
            eventually(lambda: cell(page, "encoder", "raw") == "58")


def test_a_view_that_does_not_exist_is_the_scope(page: Any) -> None:
    with running(), serving() as served:
        page.goto(f"{served.url}#view=constructor")
        page.locator("[data-view=scope][aria-selected=true]").wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_theme_is_the_systems_until_the_switch_changes_it(page: Any, scheme: str) -> None:
    with serving() as served:
        page.emulate_media(color_scheme=scheme)
        page.goto(served.url)
        theme = "getComputedStyle(document.documentElement).colorScheme"
        assert page.evaluate(theme) == scheme
        page.locator("#theme").click()
        assert page.evaluate(theme) != scheme


def test_nothing_is_wider_than_a_phone(page: Any) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    with running(), serving() as served:
        for view in ("scope", "machine"):
            page.goto(f"{served.url}#view={view}")
            page.locator(f"section.{view} tbody tr").first.wait_for()
            assert page.evaluate("document.documentElement.scrollWidth") <= 390
            page.goto("about:blank")


def test_a_run_that_failed_is_red_in_each_view_and_its_values_are_the_last(page: Any) -> None:
    with serving() as served:
        with pytest.raises(ValueError, match="no part"), running():
            page.goto(served.url + "#view=scope")
            page.locator(".legend").wait_for()
            raise ValueError("no part under the cup")
        for view in ("machine", "scope", "operate"):
            page.locator(f"[data-view={view}]").click()
            page.locator(f"section.{view}").wait_for()
            page.locator("#status.failed").get_by_text("press failed: ValueError: no part under the cup").wait_for()
        page.locator("[data-view=machine]").click()
        page.locator('tr[data-path="encoder"][data-quality="last"]').wait_for()
        assert page.locator('tr[data-quality="good"]').count() == 0


def test_the_views_are_tabs_with_a_panel_and_arrow_keys(page: Any) -> None:
    with running(), serving() as served:
        page.goto(served.url)
        page.locator(".legend").wait_for()
        page.get_by_role("tab", name="Scope").focus()
        page.keyboard.press("ArrowRight")
        page.get_by_role("tabpanel", name="Machine").locator(".objects").wait_for()
        assert page.evaluate("document.activeElement.id") == "tab-machine"
        page.keyboard.press("End")
        page.get_by_role("tabpanel", name="Operate").locator(".parts").wait_for()


def test_a_double_click_sets_no_cursor_and_a_zoom_changes_the_time_select(page: Any) -> None:
    with running(count=3000, box=Scripted({"encoder": range(1, 9000)})), serving() as served:
        page.goto(served.url + "#traces=encoder,motor,valve&span=2")
        plot = page.locator(".plot .u-over")
        plot.dblclick(position={"x": 200, "y": 50})
        assert page.locator("caption").inner_text() == "measured over the time shown"
        swatch = page.locator('tr[data-path="valve"] .swatch')
        colour = swatch.get_attribute("style")
        page.get_by_label("Remove motor").click()
        page.locator('tr[data-path="motor"]').wait_for(state="detached")
        assert swatch.get_attribute("style") == colour
        box = plot.bounding_box()
        page.mouse.move(box["x"] + 100, box["y"] + 50)
        page.mouse.down()
        page.mouse.move(box["x"] + 100 + box["width"] / 4, box["y"] + 50, steps=5)
        page.mouse.up()
        assert float(page.get_by_label("Time shown").input_value()) == pytest.approx(0.5, rel=0.05)
