"""Who has no certificate, another one, or bad intentions, and what becomes of what they send."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="the extra fleet is not installed")

import zenoh

from helpers.fleet_authorities import ProvedFleet, authority_in, proved_fleet_of
from helpers.fleets import PLANT, Fleet, asked, fleet_of
from umo import Quality
from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import until
from umo.clients.fleet.fleet_certificates import Authority
from umo.clients.fleet.fleet_commands import MAX_WAITING, FleetCommands
from umo.clients.fleet.fleet_rules import FILE
from umo.clients.fleet.fleet_session import FleetNetwork, opened
from umo.clients.fleet.run_words import FULL, HEADER
from umo.clients.remote.who import UNVERIFIED, who_text
from umo.errors import CommandRefused, FramesError, OptionError, UmoError

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")
TUNE = {"do": "tune", "path": "cell.gain", "value": 3.0}


@pytest.fixture(autouse=True)
def roles(folders: None, tmp_path: Path) -> None:
    roles = tmp_path / "xdg_config_home" / "umo" / "roles.toml"
    roles.parent.mkdir(parents=True, exist_ok=True)
    roles.write_text('[users]\nann = "maintain"\neve = "maintain"\n')


@pytest.fixture
def authority(tmp_path: Path) -> Authority:
    return authority_in(tmp_path / "fleet")


def tried(authority: Authority, work: Callable[[TriedMachine, ProvedFleet], Awaitable[None]], **more: Any) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine, proved_fleet_of(machine, authority, **more) as fleet:
            await work(machine, fleet)

    asyncio.run(all_of_it())


def closed(session: Any) -> None:
    session.close()


def quality(client: Any, path: str) -> Quality:
    frame = client.reader.latest()
    return Quality(int(frame["quality"][client.reader.index(path)]))


async def refused_entry(fleet: ProvedFleet, network: FleetNetwork, words: str) -> None:
    with pytest.raises(UmoError, match=words) as caught:
        await asyncio.to_thread(opened, network, "client")
    assert "\n" not in str(caught.value)


# Entry -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("by_router", [True, pytest.param(False, marks=pytest.mark.full)])
def test_who_has_a_certificate_sees_and_commands_under_the_own_name(authority: Authority, by_router: bool) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        client = await fleet.client("ann")

        def tune() -> None:
            with client.lease("whoever"):
                client.cell.gain = 2.5

        await asyncio.to_thread(tune)
        assert machine.m.cell.gain == 2.5
        assert next(each for each in machine.events if each.path == "cell.gain").who == "ann (fleet)"
        bob = await fleet.client("bob")
        with pytest.raises(CommandRefused, match="bob has the role see; tune needs the role tune"):
            await asyncio.to_thread(bob.lease("bob").__enter__)

    tried(authority, work, by_router=by_router)


def test_what_a_visitor_of_a_page_asks_for_is_unverified_at_the_machine_under_whatever_certificate(
    authority: Authority,
) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        client = await fleet.client("ann")
        visitor = who_text("Mallory", f"{UNVERIFIED} (page, 10.0.0.7)")

        def tune(who: str) -> None:
            with client.lease(who):
                client.cell.gain = 2.5

        with pytest.raises(CommandRefused, match="ann, unverified, has the role see; tune needs the role tune"):
            await asyncio.to_thread(tune, visitor)
        assert machine.m.cell.gain != 2.5
        await asyncio.to_thread(tune, "ann")
        assert machine.m.cell.gain == 2.5

    tried(authority, work)


@pytest.mark.full
def test_without_a_certificate_of_the_authority_nobody_comes_in(authority: Authority, tmp_path: Path) -> None:
    other = authority_in(tmp_path / "other")

    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        plain = FleetNetwork(connect=[fleet.address.replace("tls/", "tcp/")])
        await refused_entry(fleet, plain, "does not speak plain tcp")
        foreign = FleetNetwork(connect=[fleet.address], certificates=other.folder / "ann")
        await refused_entry(fleet, foreign, "the certificate of the other side is not accepted")
        mixed = tmp_path / "mixed"  # trusts the router, which does not trust it
        mixed.mkdir()
        for name, source in (("ca", fleet.folder), ("certificate", other.folder), ("key", other.folder)):
            (mixed / f"{name}.pem").write_bytes((source / "ann" / f"{name}.pem").read_bytes())
        await refused_entry(
            fleet,
            FleetNetwork(connect=[fleet.address], certificates=mixed),
            "does not accept the certificate of this computer",
        )

    tried(authority, work)


@pytest.mark.full
def test_an_expired_certificate_does_not_come_in_whatever_its_owner_thinks(
    authority: Authority, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        with pytest.raises(OptionError, match="expired on"):
            fleet.network("late")
        monkeypatch.setattr(
            "umo.clients.fleet.fleet_identity.time.time", lambda: 0.0 + time.time_ns() * 1e-9 - 2 * 86_400
        )
        network = fleet.network("late")
        monkeypatch.undo()
        with pytest.raises(UmoError, match="expired"):
            await asyncio.to_thread(opened, network, "client")

    tried(authority, work)


@pytest.mark.full
def test_whom_the_rules_do_not_name_sees_and_does_nothing(authority: Authority) -> None:
    authority.withdraw("bob")

    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        await fleet.client("ann")
        with pytest.raises(FramesError, match="not in the fleet"):
            await fleet.client("bob")
        bob = await fleet.session("bob")
        assert await asked(bob, "bob", **TUNE) == []
        closed(bob)

    tried(authority, work)


@pytest.mark.full
def test_a_user_of_one_site_sees_and_commands_no_other(authority: Authority) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        await fleet.client("ann")
        eve = await fleet.session("eve")
        assert await asked(eve, "eve", **TUNE) == []
        there = [each for each in eve.liveliness().get("umo/*/*/alive", timeout=1.0) if each.ok]
        assert there
        assert not [each for each in eve.get(PLANT.key("declaration"), timeout=0.5) if each.ok]
        closed(eve)

    tried(authority, work)


# Forgery ---------------------------------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.parametrize("by_router", [True, False])
def test_a_command_under_another_name_does_not_arrive(authority: Authority, by_router: bool) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        await fleet.client("ann")
        for certificate in ("bob", "cell8", "cell7"):
            session = await fleet.session(certificate)
            for name in ("ann", "*", "a$*"):
                assert await asked(session, name, **TUNE) == []
            closed(session)
        assert machine.m.cell.gain == 1.0

    tried(authority, work, by_router=by_router)


@pytest.mark.full
@pytest.mark.parametrize("by_router", [True, False])
def test_another_site_publishes_nothing_and_answers_nothing_under_this_one(
    authority: Authority, by_router: bool
) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        client = await fleet.client("ann")
        ann = await fleet.session("ann")
        heard: list[str] = []
        listens = ann.declare_subscriber("umo/cell7/**", lambda sample: heard.append(str(sample.key_expr)))
        stolen: list[Any] = []
        for name in ("cell8", "bob"):
            forger = await fleet.session(name)
            kept = [
                forger.declare_queryable(PLANT.key("command", "*"), stolen.append),
                forger.declare_queryable(PLANT.key("declaration"), stolen.append),
                forger.liveliness().declare_token("umo/cell7/false/alive"),
            ]
            for kind in ("delta", "event", "status"):
                forger.put(PLANT.key(kind), secrets.token_bytes(100))
            assert not [each for each in ann.liveliness().get("umo/*/false/alive", timeout=0.5) if each.ok]
            assert "result" in (await asked(ann, "ann", **TUNE))[-1]
            closed(forger)
            del kept
        assert not stolen
        listens.undeclare()
        closed(ann)
        head = client.reader.head
        await until(lambda: client.reader.head > head + 5)

    tried(authority, work, by_router=by_router)


@pytest.mark.full
def test_a_signal_of_life_under_another_name_keeps_nothing_up(authority: Authority) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        ann, bob = await fleet.session("ann"), await fleet.session("bob")
        await fleet.client("ann")
        assert "result" in (await asked(ann, "ann", client="c", do="lease"))[-1]
        began = time.monotonic()

        async def sign() -> None:
            while True:
                bob.put(PLANT.key("sign", "ann", "c"), b"")
                await asyncio.sleep(0.1)

        signing = asyncio.create_task(sign())
        await until(lambda: time.monotonic() > began + 1.5)
        signing.cancel()
        other = await asked(ann, "ann", client="d", do="lease")
        assert "result" in other[-1]
        closed(ann), closed(bob)

    tried(authority, work)


# Damage by those who may publish ---------------------------------------------------------------------------------


@pytest.mark.full
def test_a_mirror_survives_what_its_own_site_sends_and_is_right_again(authority: Authority) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        client = await fleet.client("ann")
        machine.set("cell.level", 40)
        insider = await fleet.session("cell7")
        run = bytes.fromhex(json.loads(_declared(await fleet.session("ann")))["run"])
        far = 1 << 40
        words = [secrets.token_bytes(size) for size in (0, 1, 24, 25, 100, 70_000)]
        words += [HEADER.pack(run, far, 0, 3, 0, 0) + b"x", HEADER.pack(run, far, 0, 0xFFFFFFFF, 0xFFFFFFFF, FULL)]
        words += [
            HEADER.pack(run, far, 0, 1, 0, 0) + b"\xff" * 10,
            HEADER.pack(secrets.token_bytes(8), 1, 0, 0, 0, FULL),
        ]
        for data in words:
            insider.put(PLANT.key("delta"), data)
            insider.put(PLANT.key("event"), data)
        insider.put(PLANT.key("event"), json.dumps({"run": run.hex(), "events": [[1], "x", None]}))
        insider.put(PLANT.key("event"), b"[" * 100_000)
        head = client.reader.head
        await until(lambda: client.reader.head > head + 20)
        assert client.reader.alive
        machine.set("cell.level", 20)
        await until(lambda: dict(client.reader.values(client.reader.latest()))["cell.level"] == 10.0)
        assert quality(client, "cell.level") is Quality.GOOD
        closed(insider)

    tried(authority, work)


@pytest.mark.full
def test_a_delta_with_a_number_of_the_future_makes_values_stale_and_then_right(authority: Authority) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        client = await fleet.client("ann")
        insider, ann = await fleet.session("cell7"), await fleet.session("ann")
        run = bytes.fromhex(json.loads(_declared(ann))["run"])
        width = client.reader.layout.dtype.itemsize
        insider.put(PLANT.key("delta"), HEADER.pack(run, 1 << 40, 0, width // 8, 0, FULL) + b"\0" * width)
        head = client.reader.head
        await until(lambda: client.reader.head > head + 100)
        assert client.reader.latest()["number"] > 0
        closed(insider), closed(ann)

    tried(authority, work)


def _declared(session: Any) -> bytes:
    from umo.clients.fleet.message_parts import unpacked

    (reply,) = [each for each in session.get(PLANT.key("declaration"), timeout=2.0) if each.ok]
    return unpacked(bytes(reply.ok.payload))[0]


# Floods ----------------------------------------------------------------------------------------------------------


@pytest.mark.full
def test_a_flood_of_commands_of_one_user_does_not_hold_up_the_values_or_another_users_stop(
    authority: Authority,
) -> None:
    async def work(machine: TriedMachine, fleet: ProvedFleet) -> None:
        client = await fleet.client("ann")
        bob, ann = await fleet.session("bob"), await fleet.session("ann")
        answers: list[dict[str, Any]] = []

        def flood() -> None:
            now = time.time()
            for _ in range(10_000):
                command = {"id": secrets.token_hex(16), "client": "c", "sent": now, "until": now + 20.0, **TUNE}
                bob.get(
                    PLANT.key("command", "bob"),
                    zenoh.handlers.Callback(lambda reply: answers.append(json.loads(bytes(reply.ok.payload)))),
                    payload=json.dumps(command),
                    timeout=30.0,
                )

        before = machine.number
        flooding = asyncio.create_task(asyncio.to_thread(flood))
        assert "result" in (await asked(ann, "ann", **TUNE))[-1]
        await flooding
        await until(lambda: client.reader.latest()["number"] > before)
        await until(lambda: len(answers) > 9_000)
        assert all("error" in each for each in answers)
        numbers = client.reader.read()["number"].tolist()
        assert {after - first for first, after in pairwise(numbers)} - {0} == {20}  # 0: it grew stale
        closed(bob), closed(ann)

    tried(authority, work)


@pytest.mark.full
def test_what_one_user_sends_is_bounded_and_a_stop_is_let_through() -> None:
    async def work(machine: TriedMachine, fleet: Fleet) -> None:
        session = await fleet.session()
        await fleet.client()
        slow = {"do": "call", "path": "cell.cook"}
        cooking = [asyncio.create_task(asked(session, "ann", **slow)) for _ in range(4)]
        commands = _commands_of(fleet)
        await until(lambda: commands._waiting["ann"] >= 1)
        commands._waiting["ann"] += MAX_WAITING
        assert "too many" in (await asked(session, "ann", **TUNE))[-1]["error"]
        assert "result" in (await asked(session, "ann", do="stop"))[-1]
        commands._waiting["ann"] -= MAX_WAITING
        await asyncio.gather(*cooking)
        await until(lambda: not commands._waiting)
        for number in range(1_000):
            session.put(PLANT.key("sign", "ann", f"c{number}"), b"")
        await asyncio.sleep(0.1)
        assert len(commands._signs) < 10
        closed(session)

    async def all_of_it() -> None:
        async with TriedMachine() as machine, fleet_of(machine) as fleet:
            await work(machine, fleet)

    asyncio.run(all_of_it())


def _commands_of(fleet: Fleet) -> FleetCommands:
    import gc

    return next(each for each in gc.get_objects() if isinstance(each, FleetCommands))


# Topologies ------------------------------------------------------------------------------------------------------


@pytest.mark.full
def test_a_router_without_certificates_passes_no_command_on(tmp_path: Path) -> None:
    async def all_of_it() -> None:
        async with TriedMachine() as machine:
            fleet = Fleet(machine, 0)
            from helpers.fleets import free_port

            port = free_port()
            fleet.address = f"tcp/127.0.0.1:{port}"
            router = await asyncio.to_thread(opened, FleetNetwork(listen=[f"tcp/0.0.0.0:{port}"]), "router")
            from umo.clients.fleet.fleet_commands import FleetUsers

            await fleet.serve(await fleet.session(), FleetUsers(), rate=50.0, read_only=False)
            await fleet.client()
            session = await fleet.session()
            assert await asked(session, "ann", **TUNE) == []
            assert machine.m.cell.gain == 1.0
            closed(session)
            await fleet.close()
            closed(router)

    asyncio.run(all_of_it())


@pytest.mark.full
def test_a_gateway_that_listens_by_tls_without_rules_does_not_begin(authority: Authority) -> None:
    (authority.folder / "cell7" / FILE).unlink()
    with pytest.raises(OptionError, match="no certificate proves a name"):
        opened(FleetNetwork(listen=["tls/127.0.0.1:1"], certificates=authority.folder / "cell7"), "peer")


@pytest.mark.full
def test_nothing_is_lost_while_a_router_is_killed_and_back_after_two_seconds(authority: Authority) -> None:
    async def router(fleet: ProvedFleet) -> asyncio.subprocess.Process:
        code = "from umo_command import main; main()"
        arguments = ["connect", "router", "--listen", fleet.address, "--certificates", str(fleet.folder / "plant")]
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", code, *arguments, stdout=asyncio.subprocess.PIPE, env=dict(os.environ)
        )
        assert process.stdout is not None
        assert b"clients: those that its rules name" in await process.stdout.readline()
        return process

    async def all_of_it() -> None:
        async with TriedMachine() as machine:
            fleet = ProvedFleet(machine, authority)
            fleet.begin_router = lambda: asyncio.sleep(0)  # type: ignore[method-assign]
            first = await router(fleet)
            await fleet.begin(rate=20.0)
            client = await fleet.client("ann")
            await until(lambda: client.reader.head > 20)
            first.send_signal(signal.SIGKILL)
            await first.wait()
            before, began = machine.number, time.monotonic()
            await until(lambda: time.monotonic() > began + 2.0)
            second = await router(fleet)
            await until(lambda: client.reader.latest()["number"] > before + 400)
            numbers = client.reader.read()["number"].tolist()
            steps = {after - first for first, after in pairwise(dict.fromkeys(numbers))}  # a stale one is shown twice
            assert steps == {50}
            second.terminate()
            await second.wait()
            await fleet.close()

    asyncio.run(all_of_it())
