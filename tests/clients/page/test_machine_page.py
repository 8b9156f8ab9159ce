"""The machine on the page: written from its rows, its least and greatest values, what is not good first; recipes and
the progress of actions in the view Operate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from umo.process.start import LINUX
from umo.testing import Scripted

from .conftest import control, eventually, running, serving, started, take_lease

pytestmark = pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")


@pytest.fixture
def page(page: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Of a server that is patient: a busy computer may stop the browser for a second."""
    monkeypatch.setattr("umo.clients.page.page_client.TOUCH_TIME", 3.0)
    monkeypatch.setattr("umo.clients.page.page_client.MAX_STATES_BEHIND", 30)
    return page


def row(page: Any, path: str) -> Any:
    return page.locator(f'tr[data-path="{path}"]')


def test_an_actuator_is_written_from_its_row_under_the_lease(page: Any, tmp_path: Path) -> None:
    with started(tmp_path) as station, serving() as served:
        page.goto(served.url + "#view=machine&write=1")
        written = row(page, "sorter.belt.setpoint")
        assert written.get_by_role("button", name="Set", exact=True).is_disabled()
        page.get_by_label("Your name").fill("Ann")
        page.get_by_role("button", name="Take control").click()
        page.get_by_text("You have control.").wait_for()
        written.locator('input[type="number"]').fill("0.1")
        written.get_by_role("button", name="Set", exact=True).click()
        eventually(lambda: station.sorter.belt.setpoint.read() > 0.09)
        written.get_by_text("by client: Ann").wait_for()
        row(page, "sorter.diverter").get_by_role("button", name="ON").click()
        row(page, "sorter.diverter").locator('[data-state="ON"][aria-pressed="true"]').wait_for()
        assert station.sorter.diverter.read() == "ON"
        before = written.bounding_box()
        written.locator('input[type="number"]').fill("99")
        written.locator('input[type="number"]').press("Enter")
        page.locator(".lease").get_by_text("99 m/s is outside").wait_for()
        assert "99 m/s is outside" in written.inner_text()
        assert written.bounding_box() == before  # nothing moves
        written.get_by_role("button", name="Release").click()
        eventually(lambda: station.sorter.belt.setpoint.read() == 0.0)


def test_the_rows_of_a_read_only_page_cannot_be_written(page: Any) -> None:
    with running(), serving(operate=False) as served:
        page.goto(served.url + "#view=machine&write=1")
        page.get_by_text("This page is read-only.").wait_for()
        assert page.locator(".objects .write button").first.is_disabled()


def test_the_least_and_the_greatest_value_are_kept_until_they_are_begun_anew(page: Any) -> None:
    with running(box=Scripted({"encoder": [*[40] * 60, 90, *[40] * 9999]})) as run, serving() as served:
        page.goto(served.url + "#view=machine")
        extremes = row(page, "encoder").locator(".extreme")
        run(60)  # the peak of one period
        eventually(lambda: extremes.all_inner_texts()[1:] == ["45.0 mm"])
        page.get_by_text("the oldest period that this server has read").wait_for()
        page.get_by_role("button", name="Anew").click()
        eventually(lambda: [run(1), extremes.all_inner_texts() == ["20.0 mm", "20.0 mm"]][1])  # no period is awaited


def test_what_is_not_good_stands_first_and_no_row_moves_under_the_pointer(page: Any, tmp_path: Path) -> None:
    paths = "[...document.querySelectorAll('.objects tbody tr')].map((row) => row.dataset.path ?? row.innerText)"
    fault = "reactors.1.level disconnect at 2 s for 3 s"
    with started(tmp_path, "batch", fault=fault) as station, serving() as served:
        page.goto(served.url + "#view=machine")
        row(page, "reactors.1.level").hover()
        before = page.evaluate(paths)
        page.locator('tr[data-path="reactors.1.level"]:is([data-quality="stale"], [data-quality="bad"])').wait_for()
        assert page.evaluate(paths) == before
        page.mouse.move(5, 5)
        eventually(lambda: page.evaluate(paths)[:2] == ["Not good now, or shortly before", "reactors.1.level"])
        eventually(lambda: station.frames(0.01)["time"][-1] > 5.5)
        station.lease("a test").__enter__()
        station.clear("reactors.1")
        eventually(lambda: page.evaluate(paths) == before)


# Operate -----------------------------------------------------------------------------------------------


def test_the_recipe_of_the_next_batch_is_chosen_with_its_values_before_the_eyes(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, "batch") as station, serving() as served:
        take_lease(page, served.url)
        page.get_by_role("button", name="automatic").click()
        book = page.locator("[data-book='book']")
        book.get_by_text("glue").first.wait_for(state="attached")
        page.locator("[data-states='reactors.0.unit']").get_by_text("making glue").wait_for()
        book.get_by_text("Values").click()
        assert book.get_by_role("row", name="temperature").inner_text().split() == [
            "temperature",
            "°C",
            "60",
            "50",
            "75",
        ]
        book.get_by_label("Recipe from the next batch on").select_option("paint")
        book.get_by_role("button", name="Use from the next batch on").click()
        book.locator(".answer[data-state='done']").wait_for()
        eventually(lambda: station.book.choice == "paint")
        book.evaluate("(element) => { element.querySelector('option').value = 'lacquer'; }")
        book.get_by_label("Recipe from the next batch on").select_option("lacquer")
        book.get_by_role("button", name="Use from the next batch on").click()
        book.get_by_text("no recipe 'lacquer'").wait_for()
        assert station.book.choice == "paint"
        book.get_by_role("button", name="Follow the program").click()
        eventually(lambda: station.book.choice == "the program's own")


def test_an_action_tells_its_progress_and_its_end_where_it_was_started(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, "furnace") as station, serving() as served:
        take_lease(page, served.url)
        soak = control(page, "soak")
        soak.get_by_label("soak duration").fill("36000")
        before = control(page, "switch_off").bounding_box()
        soak.get_by_role("button", name="soak").click()
        soak.get_by_text(": soaking").wait_for()
        assert soak.inner_text().count("runs for") == 1
        page.reload()  # the machine knows it, whoever asks
        control(page, "soak").get_by_text("runs for").or_(control(page, "soak").get_by_text("cancelled")).wait_for()
        control(page, "soak").get_by_text("cancelled").wait_for()  # with the lease of the page that was left
        page.get_by_role("button", name="Take control").click()
        soak.get_by_label("soak duration").fill("-1")
        soak.get_by_role("button", name="soak").click()
        soak.get_by_text("refused: duration: -1 s is outside 0 to 36000").wait_for()
        assert control(page, "switch_off").bounding_box() == before
        assert station.running


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_moves_when_the_lease_is_taken_an_alarm_comes_and_a_command_is_answered(
    page: Any, tmp_path: Path, width: int
) -> None:
    boxes = """[...document.querySelectorAll(".commands button, .choose button, .control button")].map((each) => {
        const box = each.getBoundingClientRect();
        const scrolled = document.querySelector("section.operate").scrollTop;
        return [each.dataset.command ?? each.textContent, box.x, box.y + scrolled, box.width];
    })"""
    page.set_viewport_size({"width": width, "height": 900})
    fault = "reactors.1.level disconnect at 8 s"
    with started(tmp_path, "batch", fault=fault) as station, serving() as served:
        page.goto(served.url + "#view=operate")
        page.locator("[data-states='reactors.1.unit'] .state-name[data-state='idle']").wait_for()
        page.locator("[data-control='reactors.0.heater']").wait_for()
        page.wait_for_timeout(300)
        before = page.evaluate(boxes)
        assert not station.faults
        page.locator("[data-states='reactors.1.unit'] .state-name[data-state='aborted']").wait_for()
        page.get_by_text("Alarms: 1 (1 active").wait_for()
        assert page.evaluate(boxes) == before
        page.get_by_label("Your name").fill("Ann")
        page.get_by_role("button", name="Take control").click()
        page.get_by_text("You have control.").wait_for()
        leased = page.evaluate(boxes)
        page.locator("[data-states='reactors.1.unit']").get_by_role("button", name="clear").click()
        page.get_by_text("the fault cannot be cleared").first.wait_for()
        assert page.evaluate(boxes) == leased
        if width > 1000:
            assert leased == before
