"""The scope in a real browser: lanes, ranges, marks on the time axis, the wall clock."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import pytest

from helpers.machines import Bench, bench, wired
from umo import DigitalActuator, connect, published
from umo.operation.alarms import Alarm, High
from umo.testing import Scripted, VirtualTimer, periods

from .conftest import eventually, running, serving

UTC = 1_795_600_000.25
"""s since 1970 at the station's time 0."""
NEUTRAL = "#566272"


@contextmanager
def shown(page: Any, address: str, *, kind: type[Bench] = Bench, missed: Any = (), **changes: Any) -> Iterator[Any]:
    """The scope of a station after 2 s, in which its encoder rose to 100 mm, at an address behind #: the machine."""
    m = bench(kind, **changes)
    box = Scripted({"encoder": [number % 200 for number in range(20_000)]})
    connection = connect(m, wired(m, box, clock=VirtualTimer(missed)))
    with connection, published(connection, "press", "rig"), serving() as served:
        periods(m, 2000)
        page.goto(f"{served.url}#{address}")
        page.locator(".legend tbody tr").first.wait_for()
        yield connection.machine


def kept(page: Any, name: str) -> str | None:
    """What the address keeps under a name."""
    found = parse_qs(str(page.evaluate("location.hash")).removeprefix("#"))
    return found[name][0] if name in found else None


def numbers(page: Any, fill: str | None = None) -> list[float]:
    """Numbers beside the lanes; of one colour if it is given."""
    found = page.evaluate("document.querySelector('.u-wrap canvas')?.written ?? []")
    return [
        float(each["text"])
        for each in found
        if re.fullmatch(r"-?[\d.]+(e-?\d+)?", each["text"]) and fill in (None, each["fill"])
    ]


def colour(page: Any, path: str) -> str:
    """The colour of a trace as a canvas tells it."""
    found = page.evaluate(
        """path => {
            const context = document.createElement("canvas").getContext("2d");
            const swatch = document.querySelector(`.legend tr[data-path="${path}"] .swatch`);
            context.fillStyle = getComputedStyle(swatch).backgroundColor;
            return context.fillStyle;
        }""",
        path,
    )
    return str(found)


WRITTEN = """{  // what is written on a canvas, with its left, top, right and bottom
    const { clearRect, fillText } = CanvasRenderingContext2D.prototype;
    Object.assign(CanvasRenderingContext2D.prototype, {
        clearRect(...area) {
            this.canvas.written = [];
            clearRect.apply(this, area);
        },
        fillText(text, x, y, ...more) {
            const size = this.measureText(text), at = this.getTransform();
            const corners = [
                [x - size.actualBoundingBoxLeft, y - size.actualBoundingBoxAscent],
                [x + size.actualBoundingBoxRight, y + size.actualBoundingBoxDescent],
            ].map(([x, y]) => at.transformPoint(new DOMPoint(x, y)));
            const [xs, ys] = [corners.map(({ x }) => x), corners.map(({ y }) => y)];
            const box = [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
            if (text.trim()) (this.canvas.written ??= []).push({ text, box, fill: this.fillStyle });
            fillText.call(this, text, x, y, ...more);
        },
    });
    const { toBlob } = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.toBlob = function (...given) {
        window.pictured = this.written.map(({ text }) => text);
        toBlob.apply(this, given);
    };
}"""


def written(page: Any) -> dict[str, list[float]]:
    """Texts on the chart with their boxes, in pixels of its canvas."""
    found = page.evaluate("document.querySelector('.u-wrap canvas')?.written ?? []")
    return {each["text"]: each["box"] for each in found}


LONG = {"-73933", "-73934", "-73935", "-73933.0", "-73934.0", "-73935.0"}


@pytest.mark.parametrize("width", [390, 1280])
def test_the_texts_of_the_axes_are_whole_and_none_covers_another(page: Any, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 844})
    page.add_init_script(WRITTEN)
    with running(box=Scripted({"encoder": [-147_866, -147_871] * 2000}), count=2000), serving() as served:
        page.goto(served.url + "#traces=encoder,motor&span=1")
        texts = eventually(lambda: (found := written(page)).keys() & LONG and "motor" in found and found)
        for (one, a), (other, b) in itertools.combinations(texts.items(), 2):
            apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
            assert apart, f"{one} and {other}"
        assert min(box[0] for box in texts.values()) >= 0
        assert max(box[2] for box in texts.values()) <= page.evaluate("document.querySelector('.u-wrap canvas').width")


def test_the_axis_of_a_constant_is_a_band_about_it_between_round_numbers(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with running(box=Scripted({"encoder": [227] * 5000}), count=2000), serving() as served:
        page.goto(served.url + "#traces=encoder&span=1")
        found = eventually(lambda: numbers(page))
        value = float(str(page.locator('.legend tr[data-path="encoder"] td').first.inner_text()).split()[0])
        assert min(found) < value < max(found)
        assert max(found) - min(found) < value / 2
        assert all(len(f"{number:g}") <= 4 for number in found)


def test_each_unit_has_a_lane_in_the_colour_of_its_trace(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with shown(page, "traces=encoder,motor,valve&span=1"):
        eventually(lambda: page.locator(".axis-range").count() == 2)
        eventually(lambda: numbers(page, colour(page, "encoder")))
        assert max(numbers(page, colour(page, "encoder"))) > 20
        assert {-1.0, 0.0, 1.0} <= set(numbers(page, colour(page, "motor")))
        assert numbers(page, NEUTRAL) == []


def test_traces_of_one_unit_share_a_lane_which_is_neutral_and_names_the_unit(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with shown(
        page,
        "traces=encoder,motor&span=1",
        motor=DigitalActuator("mm", default=0.0, minimum=-10.0, maximum=10.0, resolution=0.5),
    ):
        eventually(lambda: numbers(page, NEUTRAL))
        assert page.locator(".axis-range").count() == 1
        texts = page.evaluate("document.querySelector('.u-wrap canvas').written")
        fills = {each["text"]: each["fill"] for each in texts}
        assert fills["[mm]"] == NEUTRAL
        assert (fills["encoder"], fills["motor"]) == (colour(page, "encoder"), colour(page, "motor"))


IN_LANE = """([lane, lanes, colour]) => {  // pixels of a lane that have about this colour
    const canvas = document.querySelector(".u-wrap canvas");
    const over = document.querySelector(".u-over");
    const height = over.clientHeight / lanes;
    const area = [over.offsetLeft, over.offsetTop + lane * height + 3, over.clientWidth, height - 6];
    const { data } = canvas.getContext("2d").getImageData(...area.map((each) => each * window.devicePixelRatio));
    const wanted = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    let count = 0;
    for (let i = 0; i < data.length; i += 4) count += wanted.every((part, k) => Math.abs(data[i + k] - part) < 40);
    return count;
}"""


def test_a_curve_beyond_its_range_does_not_reach_into_another_lane(page: Any) -> None:
    with shown(page, "traces=encoder,motor&span=1&ranges=90:95:mm"):
        eventually(lambda: page.locator(".axis-fixed").count() == 1)
        blue = colour(page, "encoder")
        eventually(lambda: page.evaluate(IN_LANE, [0, 2, blue]) > 20)
        assert page.evaluate(IN_LANE, [1, 2, blue]) == 0


@pytest.mark.full
@pytest.mark.smoke
def test_a_range_is_typed_at_its_axis_kept_in_the_address_and_given_back_by_a_click(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with shown(page, "traces=encoder,motor&span=1"):
        page.get_by_label("Range of encoder [mm]: automatic").click()
        page.get_by_label("Least number").fill("-40")
        page.get_by_label("Greatest number").fill("300")
        page.keyboard.press("Enter")
        page.get_by_label("Range of encoder [mm]: fixed, -40 to 300").wait_for()
        assert kept(page, "ranges") == "-40:300:mm"
        mine = eventually(lambda: (found := numbers(page, colour(page, "encoder"))) and max(found) > 250 and found)
        assert min(mine) <= 0
        page.reload()
        page.get_by_text("fixed: -40 to 300 mm").click()
        page.get_by_label("Range of encoder [mm]: automatic").wait_for()
        assert kept(page, "ranges") is None
        eventually(lambda: (found := numbers(page, colour(page, "encoder"))) and max(found) <= 150)


def test_what_is_no_range_is_refused_with_a_reason_and_escape_closes_the_form(page: Any) -> None:
    with shown(page, "traces=encoder&span=1"):
        page.get_by_label("Range of encoder [mm]: automatic").click()
        for least, most, why in (("5", "5", "below"), ("9", "-1", "below"), ("", "1", "two numbers")):
            page.get_by_label("Least number").fill(least)
            page.get_by_label("Greatest number").fill(most)
            page.get_by_role("button", name="Set", exact=True).click()
            page.locator(".range-form [role=alert]").filter(has_text=re.compile(why)).wait_for()
        page.keyboard.press("Escape")
        page.locator(".range-form").wait_for(state="hidden")
        assert kept(page, "ranges") is None
        assert page.evaluate("document.activeElement.className") == "axis-range"


def test_a_range_that_was_typed_holds_beside_the_declared_ones(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with shown(page, "traces=encoder,motor&span=1&range=declared&ranges=0:4:V"):
        mine = eventually(lambda: (found := numbers(page, colour(page, "motor"))) and max(found) == 4 and found)
        assert min(mine) == 0
        assert max(numbers(page, colour(page, "encoder"))) == 100
        page.get_by_label("Declared range").uncheck()
        assert kept(page, "range") is None
        page.get_by_label("Range of motor [V]: fixed, 0 to 4").wait_for()


def test_an_address_that_keeps_nonsense_is_the_automatic_range(page: Any) -> None:
    with shown(page, "traces=encoder&span=1&ranges=4:1:mm,nan:2:mm,::,1e999:2:mm&clock=sun&range=wide"):
        page.get_by_label("Range of encoder [mm]: automatic").wait_for()


def tip_at(page: Any, share: float) -> str:
    """What is told at a place of the time axis; empty: nothing."""
    box = page.locator(".event-strip").bounding_box()
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)
    tip = page.locator(".tip")
    return str(tip.inner_text()) if tip.is_visible() else ""


def told_by(page: Any, share: float) -> str:
    """What the mark near a place tells; empty: there is none."""
    return next((told for off in range(-5, 6) if (told := tip_at(page, share + off / 500))), "")


def test_what_happened_stands_on_the_time_axis_and_is_told_to_the_mouse(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with shown(page, "traces=encoder&span=1", missed=[*[0] * 1700, 2]) as machine:
        for number in range(9):
            machine.root._machine.tell("motor", f"limited, {number}")
        periods(machine.root, 500)
        told = eventually(lambda: len(found := told_by(page, 0.5).splitlines()) == 7 and found)
        assert told[0].endswith(" s motor: limited, 0")
        assert told[-1] == "and 3 more"
        assert "9" in written(page)
        eventually(lambda: "2 periods missed" in told_by(page, 0.2))
        assert told_by(page, 0.35) == ""
        page.mouse.move(5, 5)
        assert not page.locator(".tip").is_visible()


class Measuring(Bench, alarms={"far": Alarm(High("encoder", 60.0), "too far")}):
    """A bench with an alarm, which comes and ends five times a second."""


def test_an_alarm_has_a_mark_where_it_comes_and_another_where_it_ends(page: Any) -> None:
    page.add_init_script(WRITTEN)
    with shown(page, "traces=encoder&span=1", kind=Measuring):
        told = eventually(lambda: {told for place in range(60) if (told := tip_at(page, place / 60))})
        assert any("far: alarm: unacknowledged (medium): too far" in text for text in told)
        assert any("far: alarm: returned (medium): too far" in text for text in told)
        with page.expect_download():
            page.get_by_role("button", name="PNG").click()
        assert {"alarm", "end of an alarm or a fault"} <= set(page.evaluate("window.pictured"))


def test_a_run_that_keeps_the_pace_of_the_wall_clock_can_show_its_local_times(
    page: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("umo.clients.page.watched_run.Watched.utc", UTC)
    page.add_init_script(WRITTEN)
    with shown(page, "traces=encoder&span=1"):
        page.get_by_label("Wall clock").check()
        assert kept(page, "clock") == "wall"
        local = datetime.fromtimestamp(UTC + 1.5)
        time = f"{local:%H:%M:%S}.{local.microsecond // 100_000}"
        eventually(lambda: time in written(page))
        assert any(text.startswith(str(local.date())) for text in written(page))
        page.get_by_label("Wall clock").uncheck()
        eventually(lambda: any(text.endswith(" s") for text in written(page)))
        with page.expect_download() as saved:
            page.get_by_role("button", name="PNG").click()
        saved.value.save_as(tmp_path / "scope.png")
        pictured = page.evaluate("window.pictured")
        assert any(text.startswith(f"local time, {local.date()}, UTC") for text in pictured)
        assert time in pictured
        with page.expect_download() as saved:
            page.get_by_role("button", name="CSV").click()
        saved.value.save_as(tmp_path / "scope.csv")
        head, first = (tmp_path / "scope.csv").read_text().splitlines()[:2]
        assert head.startswith("time [s],UTC,encoder")
        assert re.fullmatch(r"[\d.]+,2026-11-\d\dT[\d:.]+Z,[\d.]+", first)


def test_a_run_in_virtual_time_offers_no_wall_clock(page: Any) -> None:
    with shown(page, "traces=encoder&span=1&clock=wall"):
        page.get_by_label("Range of encoder [mm]: automatic").wait_for()
        assert not page.get_by_label("Wall clock").is_visible()
