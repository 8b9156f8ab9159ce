"""Equipment against a model: random trees, failures, clears, modes and leases; what is in fault, and what is driven."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.machines import actuator, sensor, timer
from helpers.operator import Operator
from umo import Compound, DigitalActuator, DigitalSensor, TaskFailed, connect
from umo.control import next_period
from umo.cycle.events import CommandState
from umo.errors import ChannelsFailed, UmoError
from umo.objects import walk
from umo.testing import Scripted, VirtualTimer

DRIVERS = 3
PERIODS_TO_RETURN = 200
"""Periods after which a driver that works again has been found, whenever it was looked for last."""


class Node(Compound):
    """A law drives one actuator, a sequence the other."""

    by_law: DigitalActuator
    by_sequence: DigitalActuator
    gauge: DigitalSensor
    parts: Sequence[Node] = ()
    name: str = ""
    driver: int = 0

    def setup(self) -> None:
        self.level, self.breaks = 0.0, False

    def control(self) -> None:
        if self.breaks:
            raise ValueError(f"the law of {self.name} is broken")
        self.by_law.write(self.level)

    async def work(self) -> None:
        while True:
            self.by_sequence.write(self.level)
            await next_period()

    async def fail(self) -> None:
        raise TaskFailed(f"a sequence of {self.name} failed")


class Equipped(Node, equipment=True):
    pass


class Machine(Compound):
    timer: DigitalSensor
    top: Node


@st.composite
def trees(draw: st.DrawFn, depth: int = 3) -> Node:
    count = draw(st.integers(0, 2 if depth else 0))
    parts = [draw(trees(depth=depth - 1)) for _ in range(count)]
    kind = draw(st.sampled_from([Node, Equipped, Equipped] if depth < 3 else [Equipped] * 9 + [Node]))
    return kind(
        by_law=actuator(synchronous=draw(st.booleans())),
        by_sequence=actuator(synchronous=draw(st.booleans())),
        gauge=sensor(),
        parts=parts,
        driver=draw(st.integers(0, DRIVERS - 1)),
    )


class Model:
    """Which equipment is in fault, by the rules of design 13.6."""

    def __init__(self, nodes: list[Node]) -> None:
        self.nodes = nodes
        self.in_fault: set[int] = set()
        self.ended = False
        """Whether something has failed that no equipment contains: the run ends."""
        self.manual = False
        self.written: dict[int, int] = {}
        """The raw integer that the operator holds at the sequence's actuator of a node."""

    def above(self, node: Any) -> Iterator[Node]:
        """The node and what is around it, the innermost first."""
        while isinstance(node, Node):
            yield node
            node = node._parent

    def stands(self, node: Node) -> bool:
        return any(id(each) in self.in_fault for each in self.above(node))

    def fail(self, *failed: Node) -> None:
        """These fail in one period: of equipment within equipment, the outer alone is in fault."""
        around = [
            next((each for each in self.above(node) if isinstance(each, Equipped)), None)
            for node in failed
            if not self.stands(node)
        ]
        self.ended = self.ended or None in around
        for equipment in (node for node in self.nodes if node in around and not self.stands(node)):
            self.in_fault.add(id(equipment))
            self.written = {key: raw for key, raw in self.written.items() if not self._is_in(key, equipment)}

    def _is_in(self, key: int, equipment: Node) -> bool:
        return next(equipment in self.above(node) for node in self.nodes if id(node) == key)

    def expected(self, node: Node) -> list[int]:
        """The raw integers at the circuit: of the law's actuator, of the sequence's."""
        if self.stands(node):
            return [0, 0]
        level = round(node.level / node.by_law.resolution)
        return [level, self.written.get(id(node), 0) if self.manual else level]

    def clear(self, node: Node) -> None:
        for each in self.nodes:
            if node in self.above(each) or each in self.above(node):
                self.in_fault.discard(id(each))


KINDS = (
    "law", "sequence", "sensor", "driver", "clear", "level", "manual", "automatic", "write", "lease", "lease ends"
)  # fmt: skip
STEPS = st.lists(st.tuples(st.sampled_from(KINDS), st.integers(0, 30), st.integers(1, 9)), max_size=25)


class Rig:
    def __init__(self, top: Node) -> None:
        self.m = Machine(timer=timer(), top=top)
        self.nodes = [node for node in (top, *walk(top)) if isinstance(node, Node)]
        for node in self.nodes:
            node.name = node._path
        self.model = Model(self.nodes)
        self.boxes = [Scripted() for _ in range(DRIVERS)]
        wire: dict[str, Any] = {"timer": {"driver": "clock", "period": "10 ms"}}
        for node in self.nodes:
            for item in (node.by_law, node.by_sequence, node.gauge):
                wire[item.path] = {"driver": f"box{node.driver}"}
        drivers = {f"box{number}": box for number, box in enumerate(self.boxes)}
        self.connection = connect(self.m, {"drivers": {"clock": VirtualTimer(), **drivers}, "wire": wire})
        self.tasks: dict[int, Any] = {}
        self.settled = [True] * DRIVERS

    def __enter__(self) -> None:
        self.connection.__enter__()
        self.ann = Operator(self.m)
        self.ann.do("lease")

    def __exit__(self, *error: Any) -> None:
        self.connection.__exit__(*error)

    def periods(self, count: int = 1) -> None:
        self.ann.run(count)

    def work(self) -> None:
        """A sequence of each node that does not stand in fault."""
        for node in self.nodes:
            if node.cycle.fault is None and (id(node) not in self.tasks or self.tasks[id(node)].done):
                self.tasks[id(node)] = node.cycle.start(node.work())

    def check(self) -> None:
        for node in self.nodes:
            stands = self.model.stands(node)
            assert (node.cycle.fault is not None) == stands, node.name
            if self.settled[node.driver]:
                box, items = self.boxes[node.driver], (node.by_law, node.by_sequence)
                assert [box.get(item.path) for item in items] == self.model.expected(node), node.name
            if stands:
                assert self.tasks[id(node)].done

    def step(self, kind: str, place: int, amount: int) -> None:
        node, model = self.nodes[place % len(self.nodes)], self.model
        box = self.boxes[node.driver]
        if kind == "level":
            node.level = amount / 2
        elif kind == "clear":
            node.cycle.clear()
            model.clear(node)
        elif kind == "law":
            model.fail(node)
            node.breaks = True
            self.periods()
            node.breaks = False
        elif kind == "sequence" and not model.stands(node) and not model.manual:
            model.fail(node)
            node.cycle.start(node.fail())
        elif kind == "sensor":
            model.fail(node)
            box.set(node.gauge.path, ChannelsFailed({node.gauge.path: "broken"}))
            self.periods(amount)
            box.set(node.gauge.path, 0)
        elif kind == "driver":
            model.fail(*(each for each in self.nodes if each.driver == node.driver))
            box.broken, self.settled[node.driver] = OSError("unplugged"), False
            self.periods(amount)
            self.check()
            box.broken = None
            self.periods(PERIODS_TO_RETURN)
            self.settled[node.driver] = True
        else:
            self.operate(kind, node, amount)

    def operate(self, kind: str, node: Node, amount: int) -> None:
        """The operator, who has the lease or not."""
        model, ann = self.model, self.ann
        if kind == "lease":
            ann.do("lease")
        elif kind == "lease ends" and ann.clients.lease.holder:
            ann.do("give back")
            model.written = {}
        elif kind in ("manual", "automatic") and ann.clients.lease.holder:
            assert ann.mode(kind).state is CommandState.DONE
            if model.manual != (kind == "manual"):
                model.manual, model.written = kind == "manual", {}
            self.periods(4)
        elif kind == "write" and model.manual and ann.clients.lease.holder:
            done = ann.do("write", node.by_sequence.path, amount / 2).state is CommandState.DONE
            assert done is not model.stands(node)
            if done:
                model.written[id(node)] = amount


@given(trees(), STEPS)
@settings(max_examples=60)
def test_what_stands_in_fault_and_what_is_driven_is_what_the_model_says(
    top: Node, steps: list[tuple[str, int, int]]
) -> None:
    rig = Rig(top)
    with rig:
        rig.work()
        rig.periods(2)
        rig.check()
        for step in steps:
            try:
                rig.step(*step)
                rig.work()
                rig.periods(2)
            except (UmoError, ValueError):
                for box in rig.boxes:
                    box.broken = None
                assert rig.model.ended
                return
            assert not rig.model.ended
            rig.check()


def test_the_model_can_fail() -> None:
    rig = Rig(Equipped(by_law=actuator(), by_sequence=actuator(), gauge=sensor()))
    with rig:
        rig.work()
        rig.periods(2)
        rig.m.top.breaks = True
        rig.periods(2)
        with pytest.raises(AssertionError):
            rig.check()
