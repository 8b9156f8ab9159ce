"""The conformance kit for faces: a face that keeps the contract passes it, and each of ten broken ones is caught."""

from __future__ import annotations

import asyncio
import dataclasses
import sys
import time
from typing import Any

import pytest

from helpers.mirror import Mirror, MirrorClient
from helpers.tiers import some
from umo import Quality
from umo.clients.faces.conformance import RULES, Seen, TriedFace, try_rule
from umo.clients.faces.conformance.client import Grade
from umo.clients.faces.face import User

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="frames need Linux")


@pytest.fixture(autouse=True)
def folders(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UMO_FRAMES", str(tmp_path / "frames"))
    monkeypatch.setenv("UMO_STATE", str(tmp_path / "state"))


async def client(face: Any, user: str) -> MirrorClient:
    return MirrorClient(face, user)


@pytest.mark.parametrize("name", RULES)
def test_a_face_that_keeps_the_contract_passes(name: str) -> None:
    assert asyncio.run(try_rule(TriedFace("mirror", Mirror, client), RULES[name])) in (None, "")


def test_a_computer_that_holds_everything_up_accuses_no_face(monkeypatch: pytest.MonkeyPatch) -> None:
    held = 0.0

    class HeldUp(MirrorClient):
        async def read(self, name: str) -> Seen:
            nonlocal held
            held += 10.0
            return await super().read(name)

    async def held_up(face: Any, user: str) -> MirrorClient:
        monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: time.monotonic() + held)
        return HeldUp(face, user)

    assert asyncio.run(try_rule(TriedFace("mirror", Mirror, held_up), RULES["changes"])) is None


class Frozen(Mirror):
    """Its values stand still after the end."""

    async def end(self, why: str) -> None:
        pass


class AllGood(Mirror):
    """It knows no qualities."""

    def grade(self, quality: Quality) -> Grade:
        return Grade.GOOD


class StaleIsGood(Mirror):
    def grade(self, quality: Quality) -> Grade:
        return Grade.GOOD if quality is Quality.STALE else super().grade(quality)


class OwnTimes(Mirror):
    """Its times are those of its calls."""

    def seen(self, item: Any, changes: Any) -> Any:
        import time

        return dataclasses.replace(super().seen(item, changes), time=time.time())

    async def frames(self, changes: Any) -> None:
        changes = dataclasses.replace(changes, places=range(len(changes.values)))
        await super().frames(changes)


class FirstOnly(Mirror):
    """It shows what was first."""

    async def frames(self, changes: Any) -> None:
        if not self.shown:
            await super().frames(changes)


class Numbers(Mirror):
    """It has no names of states."""

    def seen(self, item: Any, changes: Any) -> Any:
        seen = super().seen(item, changes)
        return dataclasses.replace(seen, value=float(changes.values[item.number]))


class WrongUnit(Mirror):
    def seen(self, item: Any, changes: Any) -> Any:
        return dataclasses.replace(super().seen(item, changes), unit="m")


class Silent(Mirror):
    """It loses the words of a refusal."""

    async def begin(self, machine: Any, commands: Any) -> None:
        class Quiet:
            async def ask(self, *given: Any, **more: Any) -> Any:
                from umo.errors import CommandRefused, UmoError

                try:
                    return await commands.ask(*given, **more)
                except UmoError:
                    raise CommandRefused("no") from None

        await super().begin(machine, Quiet())


class Swallows(Mirror):
    """It tells no refusal."""

    async def begin(self, machine: Any, commands: Any) -> None:
        class ItemKind:
            async def ask(self, *given: Any, **more: Any) -> Any:
                from umo.errors import UmoError

                try:
                    return await commands.ask(*given, **more)
                except UmoError:
                    return None

        await super().begin(machine, ItemKind())


class Nobody(Mirror):
    """Every user has the same name."""

    async def begin(self, machine: Any, commands: Any) -> None:
        class Same:
            async def ask(self, user: User, *given: Any, **more: Any) -> Any:
                return await commands.ask(dataclasses.replace(user, name="gateway"), *given, **more)

        await super().begin(machine, Same())


class Immortal(Mirror):
    """For it, every client lives for ever."""

    async def begin(self, machine: Any, commands: Any) -> None:
        class Same:
            async def ask(self, user: User, *given: Any, **more: Any) -> Any:
                return await commands.ask(dataclasses.replace(user, is_alive=lambda: True), *given, **more)

        await super().begin(machine, Same())


BROKEN: dict[type[Mirror], str] = {
    Frozen: "ends",
    AllGood: "qualities",
    StaleIsGood: "stale",
    OwnTimes: "stale",
    FirstOnly: "changes",
    Numbers: "states",
    WrongUnit: "units",
    Silent: "refusals",
    Swallows: "refusals",
    Nobody: "users",
    Immortal: "held",
}
"""Each broken face, and the rule that catches it."""


@pytest.mark.parametrize("face", some(lambda face: face is not Immortal, BROKEN), ids=lambda face: face.__name__)
def test_a_broken_face_is_caught_in_words(face: type[Mirror], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("umo.clients.faces.conformance.face_rules.CHANGE_TIMEOUT", 0.3)
    found = asyncio.run(try_rule(TriedFace("broken", face, client), RULES[BROKEN[face]]))
    assert found
    assert RULES[BROKEN[face]].sentence in found
