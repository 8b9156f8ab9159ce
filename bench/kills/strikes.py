"""Kills and disturbances of a running machine. Every strike waits for its moment and returns it, in ns of
CLOCK_MONOTONIC."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from random import Random
from time import monotonic_ns, sleep

from bench.kills import limits, processes
from bench.kills.box import Box
from bench.kills.run import START_LIMIT, How, NotStruck, Run, Setting

Strike = Callable[[Run, Random], int]
INT, TERM, HUP = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
KILL, STOP, CONT = signal.SIGKILL, signal.SIGSTOP, signal.SIGCONT
THREE = ("starter", "guardian", "control")
LATEST = 0.06
"""s after the machine runs at which it is struck at the latest."""
STARTING = {"starter": 1.5, "guardian": 1.0, "control": 0.15}
"""s that a process lives about before the machine runs."""
AROUND = 0.5
"""s by which an outage ends before a limit, or after it, at most."""
LASTING = (0.02, 1.0)
"""s that a fault of the box stays."""
GRACE = 1.0
"""s after a fault in which a machine may end by itself before it is asked to."""


def at_work(run: Run, moments: Random) -> int:
    """A random moment while it runs."""
    run.wait_running()
    sleep(moments.uniform(0.0, LATEST))
    if run.starter.poll() is not None:
        raise NotStruck(f"it ended by itself: {run.said()}")
    return monotonic_ns()


def one(which: str, number: int) -> Strike:
    """A signal to one of the three."""

    def strike(run: Run, moments: Random) -> int:
        moment = at_work(run, moments)
        processes.send(run.process(which), number)
        return moment

    return strike


def together(*which: str, number: int = KILL, apart: tuple[float, float] = (0.0, 0.0), group: bool = False) -> Strike:
    """A signal to several of them, or to their groups, one after the other in this order, `apart` s from one another;
    without that at once, in any order."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        pids = [run.process(each) for each in which]
        if not any(apart):
            moments.shuffle(pids)
        moment = monotonic_ns()
        for i, pid in enumerate(pids):
            if i and any(apart):
                sleep(moments.uniform(*apart))
            (processes.send_to_group if group else processes.send)(pid, number)
        return moment

    return strike


def stopped_then_killed(*which: str) -> Strike:
    """Some of them stand still for a moment, and are killed."""

    def strike(run: Run, moments: Random) -> int:
        together(*which, number=STOP)(run, moments)
        sleep(moments.uniform(0.0, 0.3))
        return together(*which)(run, moments)

    return strike


def aged(strike: Strike, least: float = 0.5, most: float = 2.5) -> Strike:
    """The machine runs for so many s before."""

    def later(run: Run, moments: Random) -> int:
        run.wait_running()
        sleep(moments.uniform(least, most))
        return strike(run, moments)

    return later


def then_stopped(strike: Strike) -> Strike:
    """The machine rides over it, and is asked to stop afterwards; the moment is that of asking."""

    def struck(run: Run, moments: Random) -> int:
        strike(run, moments)
        sleep(moments.uniform(0.1, 0.3))
        if run.starter.poll() is not None or not all(run.box.values):
            raise NotStruck(f"it did not go on: {run.said()}")
        moment = monotonic_ns()
        processes.send(run.starter.pid, TERM)
        return moment

    return struck


def standby_killed_then_both(run: Run, moments: Random) -> int:
    """The standby guardian is killed; a little later, when another one has taken its place, guardian and control."""
    at_work(run, moments)
    before = run.process("standby")
    processes.send(before, KILL)
    until = monotonic_ns() + round(START_LIMIT * 1e9)
    while run.process("standby") in (0, before) and monotonic_ns() < until:
        sleep(processes.LOOK)
    return together("guardian", "control")(run, moments)


def neighbours_loop(run: Run, moments: Random) -> int:
    """Two more stations are started and loop for ever, on two cores; each is ended by its own guardian."""
    run.wait_running()
    folders = [run.folder / f"neighbour{i}" for i in range(2)]
    for folder in folders:
        folder.mkdir()
    boxes = [Box(folder) for folder in folders]
    setting = Setting(arguments=("--loop", "100"))
    neighbours = [Run(How.PROGRAM, box, folder, setting) for box, folder in zip(boxes, folders, strict=True)]
    try:
        for each in neighbours:
            if not each.wait_end(START_LIMIT) or each.status != 1 or any(each.box.values):
                raise NotStruck(f"a neighbour did not end as it must: {each.said()}")
    finally:
        for each in neighbours:
            each.close()
            each.box.close()
    return then_stopped(lambda run, moments: 0)(run, moments)


def each(number: int) -> Strike:
    """To all of them at once, as a service manager does."""

    def strike(run: Run, moments: Random) -> int:
        moment = at_work(run, moments)
        for pid in moments.sample(run.all, len(run.all)):
            processes.send(pid, number)
        return moment

    return strike


def twice(number: int) -> Strike:
    """Twice to the starter, 5 to 60 ms apart."""

    def strike(run: Run, moments: Random) -> int:
        moment = at_work(run, moments)
        processes.send(run.starter.pid, number)
        sleep(moments.uniform(0.005, 0.06))
        processes.send(run.starter.pid, number)
        return moment

    return strike


def all_stopped_then(number: int) -> Strike:
    """Nobody is left to stop the machine; then a signal to the starter."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        for pid in run.all[1:]:
            processes.send(pid, STOP)
        sleep(moments.uniform(0.0, 0.5))
        moment = monotonic_ns()
        processes.send(run.starter.pid, number)
        return moment

    return strike


def guardian_stopped_then(which: str, number: int) -> Strike:
    """The guardian stands still when something else happens."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        processes.send(run.guardian, STOP)
        sleep(moments.uniform(0.0, 0.05))
        processes.send(run.process(which), number)
        return monotonic_ns()

    return strike


def asleep(seconds: float) -> Strike:
    """All of them stand still for a while, as on a suspended laptop; the moment is that of going on."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        pids = moments.sample(run.all, len(run.all))
        for pid in pids:
            processes.send(pid, STOP)
        sleep(seconds)
        moment = monotonic_ns()
        for pid in moments.sample(pids, len(pids)):
            processes.send(pid, CONT)
        return moment

    return strike


def starting(run: Run, moments: Random) -> int:
    """Any of the three is killed while the machine starts."""
    which = moments.choice(THREE)
    pid = run.process(which)
    sleep(moments.uniform(0.0, STARTING[which]))
    moment = monotonic_ns()
    processes.send(pid, KILL)
    return ask_to_stop_if_it_goes_on(run, moment)


def stopping(run: Run, moments: Random) -> int:
    """Any of the three is killed while the machine stops."""
    at_work(run, moments)
    pid = run.process(moments.choice(THREE))
    processes.send(run.starter.pid, TERM)
    sleep(moments.uniform(0.0, 0.03))
    moment = monotonic_ns()
    processes.send(pid, KILL)
    return moment


def ending(run: Run, moments: Random) -> int:
    """Nothing: the application ends, and the program leaves its block at about that moment."""
    run.wait_running()
    return monotonic_ns()


def faulty(name: str, value: int | tuple[int, int] = 0, *, then: Strike | None = None) -> Strike:
    """A fault of the box for a random time, its value perhaps random, too; `then` something else, shortly after it
    began. A machine that rides over the fault is asked to stop afterwards; the moment is that of the fault, or of
    asking."""

    def strike(run: Run, moments: Random) -> int:
        moment = at_work(run, moments)
        chosen = value if isinstance(value, int) else moments.randint(*value)
        run.box.fault(name, chosen, moments.uniform(*LASTING))
        if then is not None:
            sleep(moments.uniform(0.0, 0.04))
            return then(run, moments)
        while run.box.faulty:
            sleep(processes.LOOK)
        return ask_to_stop_if_it_goes_on(run, moment)

    return strike


def outage(which: str, number: int, limits: Sequence[float]) -> Strike:
    """The box is away, in one of three ways, from just before the strike to about one of the limits (s) after it; it
    comes back by itself."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        around = moments.choice(limits) + moments.uniform(-AROUND, AROUND)
        run.box.fault(moments.choice(("silent", "refuse", "restart")), 0, max(LASTING[0], around))
        sleep(moments.uniform(0.0, 0.01))
        return at_once(which, number)(run, moments)

    return strike


def again_and_again(which: str, number: int, times: int) -> Strike:
    """Whatever takes the place of a process meets with the same, until the outputs are driven again."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        moment = monotonic_ns()
        for _ in range(times):
            pid = run.process(which)
            sleep(moments.uniform(0.0, 0.3))
            moment = monotonic_ns()
            processes.send(pid, number)
            until = monotonic_ns() + round(START_LIMIT * 1e9)
            while processes.alive(pid) and monotonic_ns() < until:
                sleep(processes.LOOK)
        while not all(run.box.values) and run.starter.poll() is None and monotonic_ns() < until:
            sleep(processes.LOOK)  # they stay at their defaults for a while
        return moment

    return strike


def all_of(*strikes: tuple[str, int]) -> Strike:
    """Signals to several of them, in any order, up to 60 ms apart."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        found = [(run.process(which), number) for which, number in strikes]
        moments.shuffle(found)
        moment = monotonic_ns()
        for pid, number in found:
            moment = monotonic_ns()
            processes.send(pid, number)
            sleep(moments.choice((0.0, moments.uniform(0.0, 0.06))))
        return moment

    return strike


def at_once(which: str, number: int) -> Strike:
    """A signal without waiting for anything; part of a larger strike."""

    def strike(run: Run, moments: Random) -> int:
        moment = monotonic_ns()
        processes.send(run.process(which), number)
        return moment

    return strike


def interrupted_while_retrying(run: Run, moments: Random) -> int:
    """The control process is killed while the box refuses connections; Ctrl-C while the guardian tries to reach it."""
    at_work(run, moments)
    run.box.fault("refuse", 0, moments.uniform(0.5, 1.5))
    moment = at_once("control", KILL)(run, moments)
    sleep(moments.uniform(0.1, 0.4))
    processes.send(run.starter.pid, INT)
    return moment


def without_processes(run: Run, moments: Random) -> int:
    """The guardian cannot make a process any more; the control process is killed."""
    at_work(run, moments)
    with limits.no_more_processes(run.guardian):
        moment = at_once("control", KILL)(run, moments)
        run.wait_end(5.0)
    return moment


def without_descriptors(which: str) -> Strike:
    """Guardian and control process have 0 to 3 descriptors left when one of them is killed."""

    def strike(run: Run, moments: Random) -> int:
        at_work(run, moments)
        for pid in (run.guardian, run.control):
            limits.descriptors_left(pid, moments.randrange(4))
        return at_once(which, KILL)(run, moments)

    return strike


def ask_to_stop_if_it_goes_on(run: Run, moment: int) -> int:
    """SIGTERM to the starter if the machine runs on, or comes to run after all."""
    until = monotonic_ns() + round(START_LIMIT * 1e9)
    while not run.wait_end(GRACE) and run.starter.poll() is None and monotonic_ns() < until:
        if run.control and processes.alive(run.control) and not run.box.since:
            moment = monotonic_ns()
            processes.send(run.starter.pid, TERM)
            break
    return moment
