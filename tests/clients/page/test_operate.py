"""Commands of a page: its lease, what it holds, and what the machine answers; by websocket and in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

import umo
from umo.process.start import LINUX

from .conftest import (
    PATIENCE,
    Client,
    Served,
    control,
    eventually,
    opened,
    running,
    serving,
    started,
    take_lease,
    viewing,
)

pytestmark = [pytest.mark.full, pytest.mark.skipif(not LINUX, reason="machines run in other processes on Linux only")]


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Iterator[umo.RemoteStation]:
    """One run for all tests that do not end it."""
    folder = tmp_path_factory.mktemp("conveyor")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("UMO_FRAMES", str(folder / "frames"))
        patch.setenv("UMO_STATE", str(folder / "state"))
        with started(folder) as station:
            yield station


@pytest.fixture
def station(lasting: umo.RemoteStation, monkeypatch: pytest.MonkeyPatch) -> Iterator[umo.RemoteStation]:
    """That run, which nobody has the lease of at the end."""
    monkeypatch.setenv("UMO_FRAMES", str(lasting.reader.path.parent))
    yield lasting
    eventually(lambda: not lasting.reader.now().holder)


@pytest.fixture
def served(station: umo.RemoteStation) -> Iterator[Served]:
    with serving() as served:
        yield served


def answer(client: Client, number: int) -> Any:
    """The end of a command."""
    while True:
        found = client.get("answer")
        if found["id"] == number and found["state"] != "begun":
            return found


def command(client: Client, number: int, do: str, **more: Any) -> Any:
    client.send(type="command", id=number, do=do, **more)
    return answer(client, number)


def ran_on(station: umo.RemoteStation, seconds: float) -> Callable[[], bool]:
    """True as soon as the machine has run for so many s from now."""
    until = station.frames(0.01)["time"][-1] + seconds
    return lambda: bool(station.frames(0.01)["time"][-1] > until)


def touching(client: Client, held: list[str], until: Callable[[], bool]) -> None:
    """Answer each state, as a page does."""

    def touch() -> Any:
        client.send(type="touch", number=client.get("state")["number"], held=held)
        return until()

    eventually(touch)


def in_one_try(tried: Callable[[int], bool]) -> None:
    """True of one try of five, each with ten numbers of commands: a busy computer may make a page touch too late."""
    assert any(tried(10 * number) for number in range(1, 6))


# By websocket -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("do", ["lease", "stop"])
def test_a_read_only_server_takes_no_command(do: str) -> None:
    with running(), serving(operate=False) as served, opened(served.socket) as client:
        client.get("description")
        client.send(type="command", id=1, do=do)
        assert client.get("error")["text"] == "this page is read-only"


@pytest.mark.full
def test_a_station_that_takes_no_commands_says_so() -> None:
    with running(), serving() as served, opened(served.socket) as client:
        client.get("description")
        assert command(client, 1, "lease") == {
            "type": "answer", "id": 1, "state": "refused", "text": "press: it takes no commands",
        }  # fmt: skip


@dataclass(frozen=True)
class Door:
    """How somebody comes to the page. `address`: how the machine names their computer."""

    own_token: bool = True
    own_process: bool = True
    proxy: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    address: str = "127.0.0.1"
    is_owner: bool = False


SHARED = "a token for everybody"
PROXY = "https://cell.example"
DOORS = {
    "the printed token, a program of this user": Door(is_owner=True),
    "the printed token, a program of another account or computer": Door(own_process=False),
    "the printed token, through a proxy that is not told": Door(
        headers={"X-Forwarded-For": "10.0.0.7"}, address="a proxy at 127.0.0.1"
    ),
    "the printed token, through the proxy": Door(
        proxy=PROXY, headers={"X-Forwarded-For": "1.2.3.4, 10.0.0.7"}, address="10.0.0.7"
    ),
    "the given token, a program of this user": Door(own_token=False),
    "the given token, through the proxy": Door(
        own_token=False, proxy=PROXY, headers={"Forwarded": 'for=1.2.3.4, For="[2001:db8::7]";proto=https'},
        address="[2001:db8::7]",
    ),
    "the printed token, through the proxy that tells no address": Door(proxy=PROXY, address="a proxy at 127.0.0.1"),
}  # fmt: skip
FILES = {"no file": None, "a role": '[unverified]\npage = "operate"\n', "a mistake": '[unverified]\npage = "boss"\n'}


def in_roles(folder: Path, text: str) -> None:
    (folder / "umo").mkdir(exist_ok=True)
    (folder / "umo" / "roles.toml").write_text(text)


@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_who_may_command_from_a_page(
    station: umo.RemoteStation, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, door: Door
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    if not door.own_process:
        monkeypatch.setattr("umo.clients.page.visitor.is_own", lambda connection: False)
    with serving(shared=SHARED, proxy=door.proxy) as served:
        url = served.socket if door.own_token else served.socket.partition("?")[0] + f"?token={quote(SHARED)}"
        origin = door.proxy or served.origin
        for text in FILES.values():
            if text is not None:
                in_roles(tmp_path, text)
            with opened(url, additional_headers=door.headers, origin=origin) as client:
                client.get("description")
                found = command(client, 1, "lease", who="Ann")
                may = door.is_owner or text == FILES["a role"]
                assert found["state"] == ("done" if may else "refused"), (text, found)
                if may:
                    mark = "" if door.is_owner else ", unverified"
                    assert station.reader.now().holder == f"Ann{mark} (page, {door.address})"
                    assert command(client, 2, "shelve", path="sorter")["state"] != "done"
                else:
                    assert command(client, 2, "stop")["state"] == "refused"
            eventually(lambda: not station.reader.now().holder)


def test_roles_bind_a_page_of_others(
    station: umo.RemoteStation, served: Served, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setattr("umo.clients.page.visitor.is_own", lambda connection: False)
    in_roles(tmp_path, '[users]\nEve = "see"\n[unverified]\npage = "operate"\n')
    with opened(served.socket) as client:
        client.get("description")
        refused = command(client, 1, "lease", who="Eve")
        assert refused["state"] == "refused"
        assert "Eve, unverified, has the role see; lease needs the role tune" in refused["text"]
        assert command(client, 2, "lease", who=" bob ")["state"] == "done"
        refused = command(client, 3, "shelve", path="sorter.belt", value=60.0)
        assert refused["state"] == "refused"
        assert "bob, unverified, has the role operate; shelve needs the role maintain" in refused["text"]
        assert command(client, 4, "acknowledge")["state"] == "done"
        in_roles(tmp_path, '[unverified]\npage = "see"\n')
        assert command(client, 5, "lease", who="bob")["state"] == "refused"
        assert command(client, 6, "acknowledge")["state"] == "refused"


@pytest.mark.full
def test_what_a_page_holds_lasts_as_long_as_it_touches_and_then_its_lease_ends(
    station: umo.RemoteStation, served: Served
) -> None:
    with opened(served.socket) as client:
        client.get("description")
        found = command(client, 1, "lease", who="Ann\n")
        assert found["state"] == "done"
        now = station.reader.now()
        assert (now.lease, now.holder) == (found["lease"], "Ann (page, 127.0.0.1)")

        def lasts(number: int) -> bool:
            command(client, number, "lease", who="Ann\n")
            assert command(client, number + 1, "write", path="sorter.diverter", value="ON")["state"] == "done"
            touching(client, ["sorter.diverter"], ran_on(station, 1.5))
            return station.sorter.diverter.read() == "ON"

        in_one_try(lasts)
        eventually(lambda: station.sorter.diverter.read() == "OFF")
        assert station.reader.now().holder
        eventually(lambda: not station.reader.now().holder)


def test_a_page_that_is_closed_gives_its_lease_back_at_once(
    station: umo.RemoteStation, served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("LEASE_TIME", "TOUCH_TIME"):  # nothing ends because a busy computer is slow
        monkeypatch.setattr(f"umo.clients.page.page_client.{name}", PATIENCE)
    with opened(served.socket) as client:
        client.get("description")
        command(client, 1, "lease")
        command(client, 2, "call", path="sorter.belt.run_at", arguments={"speed": 0.3})
        touching(client, ["sorter.belt.run_at"], lambda: station.sorter.belt.setpoint.read() > 0.2)
    ends = ["the lease was given back", ""]
    eventually(lambda: [event.text for event in station.events if event.who][-2:] == ends)  # told after the lease
    assert not station.reader.now().holder
    eventually(lambda: station.sorter.belt.setpoint.read() == 0.0 and station.sorter.belt.run.read() == "OFF")


def test_a_page_cannot_command_with_the_lease_of_another(station: umo.RemoteStation, served: Served) -> None:
    with opened(served.socket) as first, opened(served.socket) as second:
        for client in (first, second):
            client.get("description")
        command(first, 1, "lease", who="Ann")
        found = command(second, 1, "write", path="sorter.diverter", value="ON")
        assert (found["state"], found["text"]) == ("refused", "LeaseHeld: Ann (page, 127.0.0.1) has the lease")
        assert command(second, 2, "lease", who="Ben", over=True)["state"] == "done"
        assert command(first, 2, "write", path="sorter.diverter", value="ON")["state"] == "refused"


@pytest.mark.full
def test_what_a_page_jogs_ends_when_its_server_is_killed(station: umo.RemoteStation) -> None:
    with viewing() as (process, address), opened(address.replace("http", "ws", 1).replace("/?", "/ws?")) as client:
        client.get("description")

        def jogs(number: int) -> bool:
            command(client, number, "lease", who="Ann")
            command(client, number + 1, "call", path="sorter.belt.run_at", arguments={"speed": 0.3})
            runs = ran_on(station, 1.5)
            touching(client, ["sorter.belt.run_at"], lambda: station.sorter.belt.setpoint.read() > 0.2 or runs())
            return station.sorter.belt.setpoint.read() > 0.2

        in_one_try(jogs)
        process.kill()
        eventually(lambda: station.sorter.belt.setpoint.read() == 0.0)
        eventually(lambda: not station.reader.now().holder)
        latest = [event.text for event in station.events][::-1]
        assert latest.index("the lease of Ann (page, 127.0.0.1) has ended, because it was not renewed") < latest.index(
            "dead-man timeout"
        )


def test_a_touch_that_answers_an_old_state_does_not_count(station: umo.RemoteStation, served: Served) -> None:
    with opened(served.socket) as client:
        client.get("description")
        first = client.get("state")["number"]
        command(client, 1, "lease")
        command(client, 2, "write", path="sorter.diverter", value="ON")

        def gone() -> bool:
            client.send(type="touch", number=first, held=["sorter.diverter"])
            return station.sorter.diverter.read() == "OFF"

        eventually(gone)


@pytest.mark.full
def test_more_paths_are_held_than_one_command_can_carry(station: umo.RemoteStation, served: Served) -> None:
    others = [f"{'a' * 40}.{i}" for i in range(100)]
    with opened(served.socket) as client:
        client.get("description")

        def lasts(number: int) -> bool:
            command(client, number, "lease")
            command(client, number + 1, "write", path="sorter.diverter", value="ON")
            touching(client, [*others, "sorter.diverter"], ran_on(station, 2.5))
            return bool(station.reader.now().holder) and station.sorter.diverter.read() == "ON"

        in_one_try(lasts)


@pytest.mark.full
def test_of_two_pages_only_the_last_to_take_the_lease_has_it(station: umo.RemoteStation, served: Served) -> None:
    with opened(served.socket) as first, opened(served.socket) as second:
        for client in (first, second):
            client.get("description")
        first.send(type="command", id=1, do="lease", over=True)
        second.send(type="command", id=1, do="lease", over=True)
        numbers = [answer(client, 1)["lease"] for client in (first, second)]
        assert len(set(numbers)) == 2
        assert station.reader.now().lease == max(numbers)


@pytest.mark.full
def test_a_page_that_looks_at_another_run_gives_its_lease_back(station: umo.RemoteStation, served: Served) -> None:
    with opened(served.socket) as client:
        client.get("description")
        command(client, 1, "lease")
        client.send(type="watch", name="another")
        eventually(lambda: not station.reader.now().holder)


@pytest.mark.full
def test_a_flood_of_commands_is_refused_in_part_and_all_are_answered(
    station: umo.RemoteStation, served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("umo.clients.page.page_client.MAX_COMMANDS", 2)
    with opened(served.socket) as client:
        client.get("description")
        command(client, 1, "lease")
        numbers = range(2, 102)
        for number in numbers:
            client.send(type="command", id=number, do="tune", path="sorter.window", value=number % 50 + 1)
        answered = [client.get("answer") for _ in numbers]
        assert {each["id"] for each in answered} == set(numbers)
        assert {each["text"] for each in answered if each["state"] == "refused"} == {
            "a page may have at most 2 commands in progress"
        }
        eventually(lambda: command(client, 1000, "tune", path="sorter.window", value=25)["state"] == "done")


@pytest.mark.full
def test_a_command_without_meaning_is_refused_by_the_machine(station: umo.RemoteStation, served: Served) -> None:
    with opened(served.socket) as client:
        client.get("description")
        client.send(type="command", id=1)
        assert "there is no command 'None'" in answer(client, 1)["text"]


def test_a_touch_without_meaning_is_answered_by_an_error(station: umo.RemoteStation, served: Served) -> None:
    with opened(served.socket) as client:
        client.get("description")
        command(client, 1, "lease")
        for held in (None, "sorter.diverter", [1], ["x"] * 257):
            client.send(type="touch", number=1, held=held)
            assert "held must be a list of at most 256 paths" in client.get("error")["text"]


# In a browser -------------------------------------------------------------------------------------------


@pytest.fixture
def page(page: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Of a server that is patient: a busy computer may stop the browser for a second."""
    monkeypatch.setattr("umo.clients.page.page_client.TOUCH_TIME", 3.0)
    monkeypatch.setattr("umo.clients.page.page_client.MAX_STATES_BEHIND", 30)
    return page


def take_again(page: Any) -> None:
    """More than once where the page does not answer in time to keep the lease, as on a busy computer."""
    held, take = page.get_by_text("You have control."), page.get_by_role("button", name="Take control")

    def taken() -> bool:
        if take.is_visible():
            take.click()
        page.wait_for_timeout(500)
        return bool(held.is_visible())

    eventually(taken)


def jog(page: Any, station: umo.RemoteStation) -> None:
    """Press the button of the belt with the mouse, until it runs."""
    control(page, "sorter.belt.run_at").get_by_label("sorter.belt.run_at speed").fill("0.3")
    control(page, "sorter.belt.run_at").get_by_role("button", name="Hold to run").hover()
    page.mouse.down()
    eventually(lambda: station.sorter.belt.setpoint.read() > 0.2)


def answers(page: Any) -> str:
    return str(page.get_by_label("Commands and answers").inner_text())


def test_an_actuator_is_written_and_released(page: Any, station: umo.RemoteStation, served: Served) -> None:
    take_lease(page, served.url)
    diverter = control(page, "sorter.diverter")
    diverter.get_by_role("button", name="ON").click()
    eventually(lambda: station.sorter.diverter.read() == "ON")
    diverter.locator('[data-state="ON"][aria-pressed="true"]').wait_for()
    eventually(ran_on(station, 1.5))
    assert station.sorter.diverter.read() == "ON"  # held by the page
    diverter.get_by_role("button", name="Release").click()
    eventually(lambda: station.sorter.diverter.read() == "OFF")


@pytest.mark.parametrize("size", [(1280, 800), (800, 600), (390, 844)])
def test_the_parts_of_a_control_stand_beside_one_another_within_its_part(
    page: Any, station: umo.RemoteStation, served: Served, size: tuple[int, int]
) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.goto(served.url + "#view=operate")
    control(page, "sorter.window").wait_for()
    astray = """() => [...document.querySelectorAll(".control")].flatMap((control) => {
        const part = control.closest(".part").getBoundingClientRect();
        const boxes = [...control.children].map((each) => [each.className, each.getBoundingClientRect()]);
        const apart = (a, b) => a.right <= b.left + 1 || b.right <= a.left + 1 || a.bottom <= b.top + 1 || b.bottom <= a.top + 1;
        const outside = boxes.filter(([, box]) => box.left < part.left || box.right > part.right);
        const over = boxes.filter(([, a], i) => boxes.some(([, b], j) => i < j && !apart(a, b)));
        return [...outside, ...over].map(([name]) => `${control.dataset.control}: ${name}`);
    })"""  # noqa: E501
    assert page.evaluate(astray) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    stop = page.locator("#stop").bounding_box()
    assert 0 <= stop["x"] <= size[0] - stop["width"]
    assert 0 <= stop["y"] <= size[1] - stop["height"]


@pytest.mark.full
@pytest.mark.smoke
def test_a_wrong_value_is_refused_in_the_machine_s_own_words(
    page: Any, station: umo.RemoteStation, served: Served
) -> None:
    take_lease(page, served.url)
    field = control(page, "sorter.window").locator('input[type="number"]')
    field.fill("1000")
    field.press("Enter")
    eventually(lambda: "window: 1000 mm is outside 1 to 100" in answers(page))
    for value in (31.0, 25.0):
        field.fill(f"{value:g}")
        field.press("Enter")
        eventually(lambda value=value: f"-> {value:g}" in answers(page))  # type: ignore[misc]
    eventually(lambda: control(page, "sorter.window").get_by_label("sorter.window", exact=True).input_value() == "25")
    control(page, "sorter.window").get_by_role("button", name="Undo").click()
    eventually(lambda: station.sorter.window == 31.0)


def test_a_refused_value_leaves_an_actuator_as_it_is_held(
    page: Any, station: umo.RemoteStation, served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("LEASE_TIME", "TOUCH_TIME"):  # a browser on a busy computer may be silent for long
        monkeypatch.setattr(f"umo.clients.page.page_client.{name}", PATIENCE)
    take_lease(page, served.url)
    setpoint = control(page, "sorter.belt.setpoint")
    setpoint.locator('input[type="number"]').fill("0.1")
    page.get_by_label("Filter").focus()  # a field that is left writes nothing
    assert not answers(page).startswith("sorter.belt.setpoint")
    setpoint.locator('input[type="number"]').fill("0.1")
    setpoint.get_by_role("button", name="Set").click()
    eventually(lambda: station.sorter.belt.setpoint.read() > 0.09)
    setpoint.locator('input[type="number"]').fill("99")
    setpoint.get_by_role("button", name="Set").hover()
    page.mouse.down()
    eventually(ran_on(station, 0.5))  # a slow click: states come meanwhile
    page.mouse.up()
    eventually(lambda: "refused" in answers(page))
    eventually(ran_on(station, 1.5))
    assert station.sorter.belt.setpoint.read() > 0.09


def test_release_comes_after_whatever_the_slider_has_asked_for(
    page: Any, station: umo.RemoteStation, served: Served
) -> None:
    take_lease(page, served.url)
    setpoint = control(page, "sorter.belt.setpoint")
    setpoint.get_by_role("button", name="Set").click()
    eventually(lambda: setpoint.get_by_role("button", name="Release").is_enabled())
    setpoint.evaluate(
        """(element) => {
            const slider = element.querySelector("[type=range]");
            slider.value = slider.max;
            slider.dispatchEvent(new Event("input"));
            [...element.querySelectorAll("button")].find(({ textContent }) => textContent === "Release").click();
        }"""
    )
    eventually(lambda: "release sorter.belt.setpoint: done" in answers(page))
    eventually(ran_on(station, 0.5))
    assert station.sorter.belt.setpoint.read() == 0.0
    assert setpoint.get_by_role("button", name="Release").is_disabled()


def test_a_running_action_can_be_cancelled_also_after_a_change_of_the_view(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, "furnace") as station, serving() as served:
        take_lease(page, served.url)
        control(page, "soak").get_by_label("soak duration").fill("36000")
        control(page, "soak").get_by_role("button", name="soak").click()
        control(page, "soak").get_by_role("button", name="Cancel").wait_for()
        page.locator("[data-view=machine]").click()
        page.locator("[data-view=operate]").click()
        control(page, "soak").get_by_role("button", name="Cancel").click()
        eventually(lambda: "soak duration=36000: cancelled" in answers(page))
        assert station.running


def test_a_jog_lasts_while_its_button_is_held(page: Any, station: umo.RemoteStation, served: Served) -> None:
    take_lease(page, served.url)
    jog(page, station)
    eventually(ran_on(station, 1.0))
    assert station.sorter.belt.setpoint.read() > 0.2
    page.mouse.up()
    eventually(lambda: station.sorter.belt.setpoint.read() == 0.0)


def test_a_jog_by_the_keyboard_ends_with_the_key_the_focus_or_the_view(
    page: Any, station: umo.RemoteStation, served: Served
) -> None:
    take_lease(page, served.url)
    control(page, "sorter.belt.run_at").get_by_label("sorter.belt.run_at speed").fill("0.3")
    ends = (
        lambda: page.keyboard.up("Space"),
        lambda: page.get_by_label("Filter").focus(),
        lambda: page.evaluate("document.querySelector('[data-view=scope]').click()"),
    )
    for end in ends:
        control(page, "sorter.belt.run_at").get_by_role("button", name="Hold to run").focus()
        page.keyboard.down("Space")
        eventually(lambda: station.sorter.belt.setpoint.read() > 0.2)
        end()
        eventually(lambda: station.sorter.belt.setpoint.read() == 0.0)
        page.keyboard.up("Space")


def test_closing_the_tab_releases_a_jog(page: Any, station: umo.RemoteStation, served: Served) -> None:
    take_lease(page, served.url)
    jog(page, station)
    page.close()
    eventually(lambda: station.sorter.belt.setpoint.read() == 0.0)
    eventually(lambda: not station.reader.now().holder)


def test_a_lease_is_taken_over_by_a_second_click_and_its_holder_sees_it(
    page: Any, station: umo.RemoteStation, served: Served
) -> None:
    take_lease(page, served.url)
    control(page, "sorter.diverter").get_by_role("button", name="ON").click()
    eventually(lambda: station.sorter.diverter.read() == "ON")
    other = page.context.new_page()
    other.goto(served.url + "#view=operate")
    other.get_by_label("Your name").fill("Ben")
    other.get_by_text("Ann (page, 127.0.0.1) has control.").wait_for()
    assert control(other, "sorter.diverter").get_by_role("button", name="ON").is_disabled()
    other.get_by_role("button", name="Take it over").click()
    assert station.reader.now().holder.startswith("Ann")
    other.get_by_role("button", name="Yes, take it over").click()
    other.get_by_text("You have control.").wait_for()
    page.get_by_text("Ben (page, 127.0.0.1) has control.").wait_for()
    assert "your control: cancelled: Ben (page, 127.0.0.1) has taken it over" in answers(page)
    assert control(page, "sorter.diverter").get_by_role("button", name="ON").is_disabled()
    eventually(lambda: station.sorter.diverter.read() == "OFF")
    page.locator("[data-view=machine]").click()
    page.locator(".events li").first.wait_for()  # also in a view that is opened later


def test_a_latched_interlock_is_acknowledged_under_the_lease_when_its_cause_is_gone(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, fault="sorter.emergency_stop stuck OPEN at 0.5 s for 0.5 s") as station, serving() as served:
        page.goto(served.url + "#view=operate")
        page.get_by_text("⊘ the emergency stop was pressed").first.wait_for()
        button = page.get_by_role("button", name="Acknowledge", exact=True)
        button.wait_for()  # when its cause is gone
        assert button.is_disabled()
        take_lease(page, served.url)
        eventually(lambda: station.frames(0.01)["time"][-1] > 1.1)
        button.click()
        button.wait_for(state="hidden")
        assert "acknowledge: done" in answers(page)
        control(page, "sorter.diverter").get_by_role("button", name="ON").click()
        eventually(lambda: station.sorter.diverter.read() == "ON")


def test_equipment_in_fault_is_told_with_its_reason_and_cleared_under_the_lease(page: Any, tmp_path: Path) -> None:
    fault = "reactors.1.level disconnect at 0.5 s for 3 s"  # longer than the second that its sensors hold
    with started(tmp_path, "batch", fault=fault) as station, serving() as served:
        page.goto(served.url + "#view=machine")
        page.get_by_text("Reactors 1 is in fault: could not be read").first.wait_for()
        assert list(station.faults) == ["reactors.1"]
        button = page.locator("#faults").get_by_role("button", name="Clear reactors 1")
        assert button.is_disabled()
        take_lease(page, served.url)
        eventually(lambda: station.frames(0.01)["time"][-1] > 3.7)
        button.click()
        button.wait_for(state="detached")
        assert "clear reactors 1: done" in answers(page)
        assert station.faults == {}


def test_an_alarm_is_acknowledged_and_shelved_on_the_page(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, "batch", fault="reactors.1.level disconnect at 0.5 s") as station, serving() as served:
        take_lease(page, served.url)
        row = page.locator("[data-alarm='reactors.1.fault']")
        row.wait_for()
        assert row.get_attribute("data-state") == "unacknowledged"
        page.get_by_text("Alarms: 1 (1 active, 1 to be acknowledged)").wait_for()
        row.get_by_role("button", name="Acknowledge").click()
        page.locator("[data-alarm='reactors.1.fault'][data-state='acknowledged']").wait_for()
        page.get_by_role("button", name="Shelve 10 min reactors.1.fault").click()
        page.locator("[data-alarm='reactors.1.fault'][data-state='shelved active']").wait_for()
        page.get_by_text("Alarms: none, 1 shelved or out of service").wait_for()
        assert [(str(alarm.state), alarm.annunciated) for alarm in station.alarms] == [("shelved active", False)]
        page.get_by_role("button", name="Unshelve reactors.1.fault").click()
        page.locator("[data-alarm='reactors.1.fault'][data-state='unacknowledged']").wait_for()


def test_a_part_with_states_is_held_and_restarted_on_the_page(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, "batch") as station, serving() as served:
        take_lease(page, served.url)
        page.get_by_role("button", name="automatic").click()
        unit = page.locator("[data-states='reactors.0.unit']")
        state, buttons = unit.locator(".state-name"), unit.get_by_role("group")
        unit.locator("[data-state='running']").wait_for()
        assert buttons.get_by_role("button", name="restart").is_disabled()
        buttons.get_by_role("button", name="hold").click()
        unit.locator("[data-state='held']").wait_for()
        assert (state.inner_text().lower(), station.reactors[0].unit.state) == ("held", "held")
        assert unit.get_by_role("img", name="state held").is_visible()
        buttons.get_by_role("button", name="restart").click()
        unit.locator("[data-state='running']").wait_for()
        buttons.get_by_role("button", name="abort").click()
        unit.get_by_text("in fault: aborted by a command").wait_for()
        buttons.get_by_role("button", name="clear").click()
        unit.locator("[data-state='running']").wait_for()  # the application makes its batch again
        assert unit.locator("text=0 produced").is_visible()


def test_a_command_that_cannot_be_given_says_why(page: Any, tmp_path: Path) -> None:
    with started(tmp_path, "batch") as station, serving() as served:
        page.goto(served.url + "#view=operate")
        unit = page.get_by_role("region", name="Reactors 0")
        why = unit.locator("p.barrier")
        hold, restart = (unit.get_by_role("button", name=f"{name} reactors 0") for name in ("Hold", "Restart"))
        unit.get_by_text("Take control first").wait_for()
        assert hold.get_attribute("title").startswith("Take control first")
        assert (
            page.get_by_role("button", name="Use from the next batch on").get_attribute("title") == "Take control first"
        )
        with station.lease("Ben"):
            page.get_by_text("Ben has control.").wait_for()
            assert why.inner_text() == "Ben has control"
        eventually(lambda: not station.reader.now().holder)
        take_lease(page, served.url)
        unit.get_by_text("Manual mode: only stop, abort and clear").wait_for()
        assert hold.get_attribute("title").startswith("Not in manual mode")
        heater = page.locator("[data-part='reactors.0']").get_by_text("Actuators")
        page.get_by_role("button", name="automatic").click()
        unit.locator("[data-state='running']").wait_for()
        eventually(
            lambda: hold.is_enabled() and restart.get_attribute("title").startswith("Restart is possible in Held")
        )
        assert (why.inner_text(), restart.inner_text().split("\n")) == ("", ["Restart", "in Held"])
        assert "In manual mode only" in heater.inner_text()
        page.get_by_role("button", name="End the run").wait_for()
        assert page.get_by_role("button", name="Stop", exact=True).count() == 0


def test_in_automatic_mode_numbers_can_be_tuned_and_actuators_cannot_be_written(page: Any, tmp_path: Path) -> None:
    with started(tmp_path) as station, serving() as served:
        take_lease(page, served.url)
        page.get_by_role("button", name="automatic").click()
        page.get_by_text("Automatic mode:").wait_for()
        assert station.mode == "automatic"
        assert control(page, "sorter.diverter").get_by_role("button", name="ON").is_disabled()
        assert control(page, "sorter.window").get_by_role("button", name="Set").is_enabled()


def test_the_run_is_ended_by_a_button_in_every_view_the_run_without_the_lease(page: Any, tmp_path: Path) -> None:
    with started(tmp_path) as station, serving() as served:
        for view in ("scope", "machine", "twin", "operate"):
            page.goto(served.url + f"#view={view}")
            page.locator(f"section.{view}").wait_for()
            assert page.get_by_role("button", name="End the run", exact=True).is_visible()
        page.get_by_role("button", name="End the run", exact=True).click()
        eventually(lambda: not station.running)
        page.get_by_text("conveyor has ended: stopped by ").first.wait_for()


def test_a_read_only_page_has_no_button_that_ends_the_run_and_says_why_its_controls_are_off(
    page: Any, station: umo.RemoteStation
) -> None:
    with serving(operate=False) as served:
        page.goto(served.url + "#view=operate")
        page.get_by_text("This page is read-only.").wait_for()
        assert not page.get_by_role("button", name="End the run", exact=True).is_visible()
        assert not page.get_by_role("button", name="Take control").is_visible()
        assert control(page, "sorter.diverter").get_by_role("button", name="ON").is_disabled()


def test_after_a_new_start_of_the_station_the_page_shows_it_and_the_lease_is_to_be_taken_again(
    page: Any, tmp_path: Path
) -> None:
    with serving() as served:
        with started(tmp_path):
            take_lease(page, served.url)
        page.locator(".holder").get_by_text("conveyor has ended.").wait_for()
        with started(tmp_path):
            page.get_by_text("Nobody has control.").wait_for()
            take_again(page)
