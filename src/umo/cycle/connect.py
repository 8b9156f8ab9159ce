"""Connecting a machine to its hardware, and disconnecting it safely."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Any, Generic, NoReturn, TypeVar

from umo.cycle import not_awaited
from umo.cycle.image import Image
from umo.cycle.insisting import call_limit
from umo.cycle.journal import CAPACITY, Journal
from umo.cycle.laid_out import machine_of, taken_parts
from umo.cycle.machine import ConnectedMachine
from umo.cycle.opened_drivers import OpenedDrivers
from umo.cycle.program_end import check_thread
from umo.cycle.restoring import restore
from umo.cycle.segments import wait_for
from umo.cycle.sequences import error_of
from umo.cycle.stopping import StopFlag, end_forked
from umo.drivers.optional import EndsWait
from umo.drivers.wrapping import bare
from umo.errors import DeclarationError, DriverError, Failure, StopError, WiringError, text_of
from umo.objects import Compound
from umo.objects.compound import check_machine
from umo.objects.description import html_of
from umo.system.device_record import DeviceClaim
from umo.text import Moment, add_note
from umo.user_code import attempt
from umo.wiring import Wired, distribute_options, resolve
from umo.wiring.wired import apply_calibrations, apply_parameters

C = TypeVar("C", bound=Compound)

_ENTERING = threading.Lock()
_ENTERED: dict[int, Compound] = {}
"""The machines that are connected or being connected, by their ids. No other object can have the id of a machine in
this dict."""


class connect(Generic[C]):
    """Connect a machine: `with connect(machine, "wiring/simulated.toml") as m:`.

    `wiring` is a TOML file, its contents as a dict, or None (default: all objects on simulated channels, period 1 ms).
    `options` are passed to every driver that has an option of this name, such as `seed=1` (raises OptionError if no
    driver has it); `realtime=True` lets a timer in virtual time keep the pace of the wall clock, `fault="z.encoder
    stuck at 5 s"` (or a list) injects faults (`umo.testing.faults`).

    On entry: check the wiring (WiringError lists every error); reserve the devices (DeviceHeld names the owner;
    AcknowledgeRequired is raised if the last run on a device ended unsafely, unless `acknowledge` is given); open the
    drivers; initialise every object at its default; arm the watchdogs; take one sample. On exit: reset every actuator
    in stop order, then finalise in reverse order. A failure does not stop the other resets; StopError lists by path the
    actuators that are not at their defaults. If entry fails, the objects initialised so far are reset and finalised
    too.
    """

    def __init__(
        self,
        root: C,
        wiring: Path | str | Mapping[str, Any] | Wired | None = None,
        *,
        acknowledge: bool = False,
        **options: Any,
    ) -> None:
        check_machine("connect", root)
        if root._parent is not None:
            raise DeclarationError(f"{root._path} is a part of a machine; connect the whole machine")
        self.root = root
        self._wiring = wiring
        self._options = options
        self._acknowledge = acknowledge
        self.stop = StopFlag()
        self.on_step: Callable[[], object] = lambda: None
        """The function that is called before every call of a driver while connecting and disconnecting, as a
        heartbeat."""
        self.pause: Callable[[float], object] = time.sleep
        """The function that waits for a time in s before the second reset."""
        self.reached = True
        """True if every initialised actuator is known to be at its default."""
        self.reports: dict[str, Mapping[str, Any]] = {}
        """Reports of the drivers on their circuits or plants (`Reports.report`), by driver; empty before the end."""
        self.afterwards: list[Callable[[], object]] = []
        """Functions that are called when the actuators have been reset and the last period has been shown."""
        self.kept: Mapping[str, Any] = {}
        """The kept values of the last run by path (`umo.cycle.restoring`). They override the wiring's parameters."""
        self.states: Mapping[str, Any] = {}
        """The states of capabilities at the end of the last run, by their names, such as the states of `alarms` by
        path."""
        self.not_restored: dict[str, str] = {}
        """The reasons why kept values were not restored, by path. Each of these numbers has its default."""
        self.laid_out: Callable[[ConnectedMachine], object] = lambda machine: None
        """The function that is called when the machine has its parameters, its kept values and its laws. No device is
        open yet."""
        self.before_first_sample: Callable[[], object] = lambda: None
        """Function that is called when every object is initialised."""
        self.first_entries = b""
        """The journal of the first sample (`umo.cycle.journal.ENTRY`)."""
        self.seed = 0
        """Seed of the machine's random numbers (`m.cycle.random`)."""
        self.device_claim: DeviceClaim | None = None
        """The owner of the devices, if this is not the connection itself."""
        self.wired: Wired
        self.machine: ConnectedMachine
        self._restore = ExitStack()
        self._drivers: OpenedDrivers
        self.started = False

    @property
    def image(self) -> Image:
        """The process image."""
        return self.machine.image

    def refuse(self, instead: Callable[..., NoReturn]) -> None:
        """Replace every call of a driver in this process by `instead`, which does not return."""
        self.on_step = instead
        if hasattr(self, "machine"):
            self.machine.refuse(instead)

    def _stand_aside(self, device_claim: DeviceClaim) -> None:
        """Mark a forked process: the devices are not its own, and it ends as soon as it would use one."""
        self.refuse(lambda *_: end_forked(self.stop.title))
        with suppress(OSError):
            device_claim.hold.release()

    def driver(self, name: str) -> Any:
        """Return the open driver with this name in the wiring, of the class that the wiring names."""
        return bare(self.wired.drivers[name])

    def __enter__(self) -> C:
        with _ENTERING:
            if id(self.root) in _ENTERED:
                raise DeclarationError(f"{type(self.root).__name__} is already connected")
            _ENTERED[id(self.root)] = self.root
        try:
            self._enter()
        except BaseException:
            _ENTERED.pop(id(self.root), None)
            raise
        return self.root

    def _repr_html_(self) -> str:
        return html_of(self.root)

    def _enter(self) -> None:
        self._restore, self.started = ExitStack(), False
        self._device_claim: DeviceClaim | None = None
        given = self._wiring
        if isinstance(given, Wired):
            distribute_options(self._options, wiring={})  # it has its options
            if given.mixed_times:
                raise WiringError(f"{given.mixed_times}: this wiring runs with --realtime only")
            self.wired = given
        else:
            self.wired = resolve(self.root, given, distribute_options(self._options, wiring=given).wiring)
        check_thread(bool(self.wired.hardware))
        name = self.stop.title = type(self.root).__name__
        device_claim = self.device_claim or DeviceClaim(self.wired.devices, name, acknowledge=self._acknowledge)
        self.stop.call_limit, self.stop.leave_at_once = partial(_call_limit, self.wired), self._leave_at_once
        if self.device_claim is None and self.wired.hardware:
            self.stop.stand_aside = partial(self._stand_aside, device_claim)
        self.stop.install()
        self._restore.callback(self.stop.restore)
        undo, machine = self._restore.callback, None
        try:
            undo(not_awaited.hear())
            undo(apply_calibrations(self.wired.wires))
            if self.kept:
                self.not_restored = restore(self.root, self.wired.parameters, self.kept, undo)
            else:
                apply_parameters(self.root, self.wired.parameters, undo)
            taken = taken_parts(self.root, self.wired)
            timer = None if self.wired.timer_wire is None else self.wired.timer_wire.driver
            if isinstance(timer, EndsWait):
                # it runs in a signal handler: what it raised would come up in any call of a driver, also in a reset
                self.stop.end_wait = partial(attempt, timer.stop_waiting)
            self.machine = machine = machine_of(self.root, self.wired, self.stop, self.states)
            self.machine.random = Random(self.seed)
            for each in taken:
                self.machine.attach(each)
            self.laid_out(self.machine)
        except BaseException:
            if machine is not None:
                machine.disconnect()
            self._restore.close()
            if device_claim is not self.device_claim:
                device_claim.abandon()
            raise
        self._drivers = OpenedDrivers(self.machine, self.wired, lambda s: wait_for(s, self.pause, self.on_step))
        self._device_claim = device_claim
        self.reached = False
        try:
            self._start()
        except BaseException as error:
            self._leave(error)
            raise

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        moment = _moment(self.machine)
        try:
            self._leave(error)
        except BaseException as left:
            _date(left, moment)
            raise
        finally:
            if error is not None:
                _date(error, moment)
            _ENTERED.pop(id(self.root), None)

    def _start(self) -> None:
        """Open the drivers, begin the parts and take the first sample. The failures and arrivals in this sample are
        kept, because a replay begins with them."""
        machine, transfer = self.machine, self.image.transfer
        self.image.segments.on_call = self.on_step
        self._drivers.open()
        journal = transfer.journal = Journal(CAPACITY + len(self.image.items))
        self.before_first_sample()
        try:
            for each in machine.attached:
                each.begin()
            machine.has_begun = True
            machine.phases.sample_all()
        finally:
            transfer.journal = None
        self.first_entries = journal.entries
        machine.contain_failures(True)
        self.started = True

    def _leave(self, cause: BaseException | None) -> None:
        """Reset everything, then release everything. At the end, raise StopError if an actuator was not reached."""
        unreached: list[Failure] | None = None
        hindered: list[Failure] = []
        self.stop.is_leaving = True
        self.machine.contain_failures(False)
        try:
            stopping = error_of(self.machine.under_way.cancel)
            self.machine.end()
            found, late = self._drivers.reset()
            if self.wired.injection is not None and self.wired.injection.end():
                hindered = found  # this is told; the machine is not left there
                found, late = self._drivers.reset()
            unreached = found
            self.reached = not unreached
            self.image.transfer.callees.end_writing()
            showing = error_of(self._show_last)  # what is shown comes after what is safe
            if self.started:
                self.reports.update(self._drivers.reports())
            failures = late + self._drivers.close()
        finally:
            if unreached is None:
                unreached = self._drivers.not_reset("disconnecting was interrupted")
            try:
                self.machine.disconnect()
            finally:
                self._end_custody(unreached, cause)  # while signals are still only noted: it is not to be interrupted
                self._restore.close()
        if unreached:
            raise StopError("not brought to their defaults", [*unreached, *failures]) from cause or stopping or showing
        if hindered:
            what = "not brought to their defaults until the injected faults ended"
            raise StopError(what, [*hindered, *failures]) from cause or stopping or showing
        if cause is None and not (self.stop.requested or self.machine.under_way.is_cut_short):
            not_awaited.tell_kept(self.root)
        failed = DriverError("failures at the end of the run", failures) if failures else None
        raised = cause
        for what, error in ("stopping its sequences", stopping), ("showing its last period", showing), ("", failed):
            if raised is None:
                raised = error
            elif error is not None:
                add_note(raised, f"also, while {what}: {text_of(error)}" if what else str(error))
        if raised is not None and raised is not cause:
            raise raised

    def _leave_at_once(self) -> list[str]:
        """Reset and release everything in the middle of the user's code, which does not end and is not called any more.
        Return the paths of the actuators that were not reached."""
        if self._device_claim is None:  # it is not connected yet
            return []
        self.machine.end(parts=False)
        unreached, _ = self._drivers.reset()
        self.image.transfer.callees.end_writing()
        self._drivers.close()
        self._end_custody(unreached, None)
        return [failure.path for failure in unreached]

    def _show_last(self) -> None:
        self.machine.phases.finish()
        self.machine.events.tell_all()
        while self.afterwards:
            self.afterwards.pop()()

    def _end_custody(self, unreached: list[Failure], cause: BaseException | None) -> None:
        claim = self._device_claim
        if claim is None or claim is self.device_claim:  # its keeper looks after what was not reached
            return
        if unreached:
            what = "the connection was closed" if cause is None else text_of(cause)
            claim.stopped(what, [failure.path for failure in unreached])
        elif self.started:
            claim.finish()
        else:
            claim.abandon()


def _moment(machine: ConnectedMachine) -> Moment | None:
    """Return the time of the run, or None before its first period."""
    return Moment.at(machine.clock.now) if machine.clock.number else None


def _call_limit(wired: Wired) -> float:
    """Return the time in s after which a call of a driver counts as hanging."""
    return call_limit([wired.drivers[name].timeout for name in wired.hardware])


def _date(error: BaseException, moment: Moment | None) -> None:
    """Note on an exception when it ended the run. An exception that is raised again keeps one such note."""
    with suppress(BaseException):  # an exception of the user's may refuse anything
        notes = getattr(error, "__notes__", [])
        notes[:] = [note for note in notes if not isinstance(note, Moment)]
        if moment is not None:
            error.add_note(moment)
