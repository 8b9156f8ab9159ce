"""The ways by which a verb comes to a machine in this process: each translates as its client does."""

from __future__ import annotations

import asyncio
import json
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from types import SimpleNamespace
from typing import Any

from umo.clients.faces.conformance import TriedMachine
from umo.clients.faces.conformance.tried_machine import STEP
from umo.clients.faces.face import User
from umo.clients.faces.gateway import Gateway
from umo.clients.remote import RemoteStation
from umo.cycle.events import CommandState
from umo.errors import UmoError
from umo.operation.commands.verb import Names, Verb
from umo.operation.commands.verbs import MODE, TAKE_LEASE
from umo.process.frames.machine_items import declaration_of

KIND = re.compile(r"^(\w+(Error|Refused|Held|Fault|Failed)): ")


class Way(ABC):
    """One way to a machine. `name`: as roles and events tell it."""

    proves = True
    """Whether it proves the names of users."""
    tells_life = True
    """Whether it tells that a client lives."""
    takes_lease = False
    """Whether its user takes the lease; else it is taken for each command."""
    is_owner = False

    def __init__(self, machine: TriedMachine) -> None:
        self.machine = machine

    @property
    def name(self) -> str:
        return type(self).__name__.lower()

    async def open(self) -> None:
        """Be ready for commands."""
        return

    async def close(self) -> None:
        """Give the lease back."""
        return

    @abstractmethod
    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        """Its result."""

    async def give(self, verb: Verb, path: str = "", **arguments: Any) -> str:
        """The answer in words: "done: ..." with the result, else the reason of the refusal."""
        try:
            result = await self.ask(verb, path, arguments)
        except UmoError as error:
            return KIND.sub("", str(error))
        return f"done: {json.dumps(result)}"


class Attach(Way):
    is_owner = takes_lease = True

    async def open(self) -> None:
        self.station = await asyncio.to_thread(lambda: RemoteStation(self.machine.find()))
        self._lease: Any = None

    async def take(self) -> str:
        try:
            self._lease = await asyncio.to_thread(self.station.lease("bob").__enter__)
        except UmoError as error:
            return str(error)
        return ""

    async def close(self) -> None:
        await asyncio.to_thread(self.station.close)

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        return await asyncio.to_thread(lambda: self.station.do(verb.name, path, **arguments))


class Terminal(Attach):
    """`umo do`, by its own reading of the words of the command line."""

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        from umo_command.do import do_verb
        from umo_command.do.commanding import arguments_of

        words = [path] if verb.names is not Names.NOTHING else []
        words += [f"{name}={value}" for name, value in arguments.items()]
        place, rest = do_verb._path_of(verb, words)
        actions = {each["path"]: each for each in self.station.reader.layout.actions}
        given = arguments_of(actions[place], rest) if place in actions else do_verb.given_arguments(verb, rest)
        return await asyncio.to_thread(lambda: self.station.carry_out(verb, place, given))


class Page(Way):
    """A page of a visitor who has the token that was given. The page is open: it touches."""

    proves = False
    takes_lease = True

    async def open(self) -> None:
        from umo.clients.page.page_client import PageClient
        from umo.clients.page.visitor import Visitor

        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._number = 0
        watched: Any = SimpleNamespace(reader=self.machine.find(), number=0)
        feed: Any = SimpleNamespace(looked=lambda: asyncio.sleep(STEP))
        self._client = PageClient(watched, feed, Visitor("10.0.0.9"), self._tell)
        self._held: set[str] = set()
        self._touching = asyncio.create_task(self._touch())

    async def _touch(self) -> None:
        while True:
            self._client.touch(list(self._held), 0)
            await asyncio.sleep(STEP)

    async def _tell(self, answer: dict[str, Any]) -> None:
        if answer["state"] != str(CommandState.BEGUN):
            self._answers[answer["id"]].set_result(answer)

    async def take(self) -> str:
        answer = await self._send({"do": TAKE_LEASE.name, "who": "bob"})
        return "" if answer["state"] == "done" else KIND.sub("", answer["text"])

    async def _send(self, message: dict[str, Any]) -> dict[str, Any]:
        self._number += 1
        answer = self._answers[self._number] = asyncio.get_running_loop().create_future()
        await self._client.carry_out({"id": self._number, **message})
        return await answer

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        if verb.is_kept_up:
            self._held.add(path)
        answer = await self._send({"do": verb.name, "path": path, **verb.fields(arguments)})
        if answer["state"] != "done":
            raise UmoError(answer["text"])
        return json.loads(answer["text"]) if answer["text"] else None

    async def close(self) -> None:
        self._touching.cancel()
        await self._client.close()


class Face(Way):
    """A face: its translation, and a gateway of its own."""

    async def open(self) -> None:
        self.reader = self.machine.find()
        self.declaration = declaration_of(self.reader)
        self.gateway = self.made(self.reader)
        self.user = User("bob", self.proves, is_alive=(lambda: True) if self.tells_life else None)

    def made(self, reader: Any) -> Any:
        return Gateway(reader, self.name, self._looked)

    async def _looked(self) -> float:
        await asyncio.sleep(STEP)
        return float(self.machine.connection.machine.clock.now)

    async def close(self) -> None:
        await self.gateway.close()


class OpcUa(Face):
    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        from asyncua import ua

        from umo.clients.faces.opcua import ua_commands
        from umo.clients.faces.opcua.ua_machine import calling

        called = calling(verb, "" if verb.names is Names.NOTHING else None)
        own = [json.dumps(arguments)] if verb.of_action else [arguments.get(each.name) for each in verb.arguments]
        given = [*([path] if called.path is None else []), *own]
        place, more = ua_commands._arguments(called, [ua.Variant(each) for each in given])
        return await self.gateway.ask(self.user, called.verb.name, place, **more)


class Epics(Face):
    @cached_property
    def variables(self) -> Mapping[str, Any]:
        from umo.clients.faces.epics.epics_variables import variables_of

        return variables_of(self.declaration, "plant:", self.gateway).by_name

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        from p4p import Type, Value

        variable = self.variables[f"plant:run:{verb.word}"]
        if verb is MODE:  # which has a variable of its own
            (mode,) = (each for each in self.declaration.items if each.verb is MODE)
            chosen = Value(variable.value.type(), {})
            chosen["value.index"] = list(mode.states.values()).index(arguments["mode"])
            assert variable.write is not None
            return await variable.write(self.user, chosen)
        texts = {name: str(value) for name, value in arguments.items()}  # as a client in a shell sends them
        texts = {"arguments": json.dumps(arguments)} if verb.of_action else texts
        texts |= {} if verb.names is Names.NOTHING else {"path": path}
        query = Value(Type([("query", ("S", None, [(name, "s") for name in texts]))]), {"query": texts})
        assert variable.call is not None
        return await variable.call(self.user, query)


class Sparkplug(Face):
    proves = tells_life = False

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        from umo.clients.faces.mqtt.sparkplug import Sparkplug as SparkplugFace
        from umo.clients.faces.mqtt.sparkplug_node import SparkplugNode

        face = SparkplugFace()
        face._node, face._commands = SparkplugNode(self.declaration, 0), self.gateway
        text = json.dumps(arguments | ({} if verb.names is Names.NOTHING else {"path": path}))
        return await face._ask(f"verb:{verb.word}", text, self.user)


class HomeAssistant(Face):
    proves = tells_life = False

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        from umo.clients.faces.mqtt.home_assistant import HomeAssistant as HomeAssistantFace

        face, answers = HomeAssistantFace(), []
        face._commands = self.gateway
        face._answer = lambda topic, path, text: answers.append((topic, text))  # type: ignore[method-assign]
        text = json.dumps(arguments | ({} if verb.names is Names.NOTHING else {"path": path}))
        await face._carry_out(f"do/{verb.word}", text.encode())
        ((topic, told),) = answers
        words = told.removeprefix(f"{path}: ") if path else told.removeprefix(": ")
        if topic != "done":
            raise UmoError(words)
        return json.loads(words)


class Fleet(Face):
    def made(self, reader: Any) -> Any:
        from umo.clients.fleet.fleet_commands import FleetCommands, FleetUsers
        from umo.clients.fleet.sole_lease import SoleLease

        nothing = SimpleNamespace(undeclare=lambda: None)
        session: Any = SimpleNamespace(
            declare_queryable=lambda *given: nothing, declare_subscriber=lambda *given: nothing
        )
        key: Any = SimpleNamespace(key=lambda *given: "")
        found = SoleLease(reader, self.name, self._looked)
        self.commands = FleetCommands(session, key, FleetUsers(is_proved=True), lambda: found)
        return found

    async def ask(self, verb: Verb, path: str, arguments: Mapping[str, Any]) -> Any:
        fields = verb.fields(arguments)
        command = {"client": "c", "do": verb.name, "path": path, **fields}
        return await self.commands._carry_out("bob", json.loads(json.dumps(command)), lambda number: None)


WAYS: Mapping[str, type[Way]] = {
    each.__name__.lower(): each for each in (OpcUa, Epics, Sparkplug, HomeAssistant, Fleet, Page, Attach, Terminal)
}
