"""Several machines in one process: in threads, and one within a sequence of another. None takes another for itself."""

from __future__ import annotations

import ast
import re
import threading

import pytest

import umo
from helpers.cycling import Cycle, after
from helpers.machines import actuator, timer
from helpers.own_modules import texts
from umo import Compound, DigitalActuator, DigitalSensor, TaskFailed, connect
from umo.control import Lock, next_period, timeout, together, wait
from umo.errors import TimeExpired
from umo.testing import periods

LONG = 30.0
"""Seconds after which a thread is given up."""


class Meeting:
    """Two threads that are in a step of a sequence each: the second begins its own within that of the first."""

    def __init__(self) -> None:
        self.inside, self.over = [threading.Event(), threading.Event()], threading.Event()

    def first(self) -> None:
        self.inside[0].set()
        assert self.inside[1].wait(LONG)

    def second(self) -> None:
        self.inside[1].set()
        assert self.over.wait(LONG)


def in_two_threads(one, other):
    """What each returns or raises."""
    results = {}

    def work(name, call):
        try:
            results[name] = call()
        except BaseException as error:
            results[name] = error

    threads = [threading.Thread(target=work, args=each) for each in (("one", one), ("other", other))]
    for each in threads:
        each.start()
    for each in threads:
        each.join(LONG)
    return results["one"], results["other"]


async def limited() -> None:
    async with timeout("3 ms"):
        await wait("1 s")


async def locked(lock: Lock) -> str:
    async with lock:
        return str(lock.holder).rpartition(".")[2]


async def awaits_started(m) -> str:
    task = m.cycle.start(after(2, "done"))
    return await task


@pytest.mark.parametrize(
    ("act", "expected"),
    [
        (lambda m: limited(), TimeExpired),
        (lambda m: locked(Lock()), "main"),
        (awaits_started, "done"),
        (lambda m: together(after(1, 1), after(2, 2)), (1, 2)),
    ],
    ids=["timeout", "lock", "await", "together"],
)
def test_a_sequence_is_its_own_machines_while_another_thread_is_in_a_step(act, expected):
    """A time limit of one machine landed on the sequence of another, and never expired."""
    meeting = Meeting()

    def one():
        async def main(m):
            meeting.first()  # stands for a device call, which lets the other thread run
            try:
                return await act(m)
            finally:
                meeting.over.set()

        return umo.run(Small(timer=timer(), motor=actuator()), None, main)

    def other():
        async def main(m):
            meeting.second()

        assert meeting.inside[0].wait(LONG)
        return umo.run(Small(timer=timer(), motor=actuator()), None, main)

    found, quiet = in_two_threads(one, other)
    assert quiet is None
    assert isinstance(found, expected) if isinstance(expected, type) else found == expected


class Small(Compound):
    timer: DigitalSensor
    motor: DigitalActuator


@pytest.mark.parametrize(
    ("act", "expires"), [(lambda m: limited(), True), (lambda m: locked(Lock()), False), (awaits_started, False)]
)
def test_a_machine_that_runs_within_a_step_of_another_has_its_own_sequences(act, expires):
    seen = []

    async def outer():
        inner = Small(timer=timer(), motor=actuator())
        with connect(inner):
            task = inner.cycle.start(act(inner))
            try:
                periods(inner, 6)
            except TimeExpired:
                seen.append("expired")
            seen.append("done" if task.done else "waits")
        async with timeout("2 ms"):  # and the outer one has its own again
            await wait("1 s")

    with Cycle() as cycle:
        cycle.start(outer())
        with pytest.raises(TimeExpired):
            cycle.steps(6)
    assert seen == (["expired", "done"] if expires else ["done"])


def test_the_sequence_that_takes_a_step_is_known_to_its_machine_alone():
    seen = []

    async def looks(own, others):
        await next_period()
        seen.append((own.sequences.current.task is not None, [each.sequences.current.task for each in others]))

    with Cycle() as one, Cycle() as other:
        one.start(looks(one.connection.machine, [other.connection.machine]))
        one.steps(2)
        assert one.connection.machine.sequences.current.task is None
    assert seen == [(True, [None])]


def test_what_a_cancelled_sequence_cleans_up_with_is_its_own():
    """It was taken for the sequence that cancelled it: a lock belonged to that, and a time limit counted for it."""
    log = []

    async def tidy(lock):
        try:
            await wait("1 s")
        finally:
            async with lock, timeout("1 s"):
                log.append(str(lock.holder).rpartition(".")[2])

    async def canceller(task):
        task.cancel()
        log.append("goes on")
        await wait("5 ms")
        log.append("ends")

    lock = Lock()
    with Cycle() as cycle:
        task = cycle.start(tidy(lock))
        cycle.steps(1)
        cycle.start(canceller(task))
        cycle.steps(8)
        assert not lock.locked
    assert log == ["tidy", "goes on", "ends"]


# State of modules ----------------------------------------------------------------------------------------

CHANGED = {
    "cycle/connect.py:_ENTERED": "the ids of connected machines, behind a lock: none is connected twice",
    "cycle/not_awaited.py:_ADVANCING": "filled by a decorator while umo is imported",
    "cycle/not_awaited.py:_EXPECTING": "filled by a decorator while umo is imported",
    "cycle/sequences.py:_ADOPTING": "filled by a decorator while umo is imported",
    "system/signal_handling.py:SIGNALS": "completed while umo is imported",
    "cycle/stopping.py:_insistence": "how often the process was asked to stop since its machines were connected",
    "cycle/stopping.py:_before": "the handlers of the process's signals, which stop every machine of it",
    "cycle/stopping.py:_flags": "the stop flags of all machines: a signal sets every one",
    "drivers/fmu/instance.py:_logs": "by the number of each instance of a model",
    "process/frames/publish.py:_pipes": "the pipes of all runs of the process, which a forked process releases",
    "system/streams.py:_unlogged": "the number of lines of the process's log that nobody has read",
    "system/streams.py:late": "the standard streams of the process that have something left to write",
    "testing/conformance/rules.py:_RULES": "filled by a decorator while the kit is imported",
    "clients/faces/conformance/face_rules.py:RULES": "filled by a decorator while the kit is imported",
}
"""Containers of modules that code changes, and why no machine takes one of another for its own."""
CHANGING = {"append", "add", "pop", "update", "setdefault", "clear", "remove", "extend", "discard", "insert", "popitem"}


USED = re.compile(rf"\b(\w+)(?:\.(?:{'|'.join(CHANGING)})\(|\[)")
"""A name whose container may be changed."""
ASSIGNED = re.compile(r"^(?!from |import |class |def |async |@)(\w[^=\n]*)=", re.MULTILINE)
"""The names that a line of a module, outside of functions and classes, assigns."""


def may_change(code: str) -> bool:
    """Whether a module may have containers that its code changes, as far as its text says: most have none."""
    own = {name for names in ASSIGNED.findall(code) for name in re.findall(r"\w+", names)}
    return "global " in code or not own.isdisjoint(USED.findall(code))


def changed_in(code: str) -> set[str]:
    """The names of a module's own containers that its code changes, and those that it declares global."""
    if not may_change(code):
        return set()
    tree = ast.parse(code)
    own = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Global):
            found |= set(node.names)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGING:
            found |= {node.func.value.id} & own if isinstance(node.func.value, ast.Name) else set()
        elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store | ast.Del):
            found |= {node.value.id} & own if isinstance(node.value, ast.Name) else set()
    return found


def test_no_module_keeps_what_belongs_to_a_machine():
    found = {
        f"{place}:{name}"
        for place, code in texts().items()
        if "stations" not in place.split("/")
        for name in changed_in(code)
    }
    assert found == set(CHANGED), "state of a module: give it to the machine, or say here why it is of the process"


def test_a_sequence_may_not_be_run_from_within_a_step_of_its_own_machine():
    async def main(m):
        periods(m, 1)

    with Cycle() as cycle:
        cycle.start(main(cycle.m))
        with pytest.raises(TaskFailed, match="only the cycle may call it"):
            cycle.steps(1)
