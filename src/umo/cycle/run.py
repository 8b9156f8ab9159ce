"""Running a machine: the standard loop. A program may write its own."""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Iterable, Mapping
from functools import partial
from inspect import isasyncgen
from pathlib import Path
from typing import Any, Concatenate, TypeVar

from umo.cycle.connect import connect
from umo.cycle.frame import Observer
from umo.cycle.insisting import tell_in_a_line
from umo.cycle.not_awaited import expects_errors
from umo.cycle.sequence_mistakes import no_machine
from umo.cycle.stopping import TimeLimit, in_main_thread
from umo.duration import seconds as in_seconds
from umo.errors import DeclarationError, Interrupted, TimeExpired, text_of
from umo.objects import Compound, DigitalSensor, children
from umo.objects.compound import check_machine
from umo.system.signal_handling import signal_name
from umo.text import cut_repr, in_brackets, shown_place
from umo.user_code import check_acts_at_once, definition, is_interrupt
from umo.wiring import distribute_options

C = TypeVar("C", bound=Compound)
Application = Callable[Concatenate[C, ...], Coroutine[Any, Any, Any]]
"""An `async def` function that takes the machine; its keyword parameters are options of the run."""


def run(
    machine: C,
    wiring: Path | str | Mapping[str, Any] | None = None,
    application: Application[C] | None = None,
    *,
    observers: Iterable[Observer] = (),
    acknowledge: bool = False,
    until: str | float | None = None,
    **options: Any,
) -> Any:
    """Connect the machine, run the application's sequence to its end and disconnect safely. Returns its result.

    Without an application the machine's `control` runs until a signal. SIGINT (Ctrl-C), SIGTERM and SIGHUP end the run
    between two periods: `umo.errors.Interrupted`, a KeyboardInterrupt, is raised when the actuators have been reset.
    The `result` of this exception is the last result that `m.cycle.result` has reported. In a thread other than the
    main thread nothing is raised and this result is returned, because only the main thread handles signals. Errors of
    the application, the control code and the devices are raised after the actuators have been reset to their defaults.
    Each of the `options` is passed to the application and to all drivers that have an option of this name, as for `umo
    run` and `umo.start`. Raises OptionError if neither the application nor a driver has such an option. `acknowledge`
    has the same meaning as in `connect`. `until` is a limit for the machine's time ("10 min", or in s): if the run has
    not ended by then, the actuators are reset and TimeExpired is raised, with the lines at which the application waits.
    Use it in tests: in virtual time an application that waits for something that never happens would not end.
    """
    check_machine("run", machine)
    _timer_of(machine)
    _check_application(application)
    watching = _checked_observers(observers)
    limit = None if until is None else in_seconds(until)
    shares = distribute_options(options, application=application, wiring=wiring)
    connection = connect(machine, wiring, acknowledge=acknowledge, **shares.wiring)
    with connection as m:
        connection.machine.observers.extend(watching)
        if limit is not None:
            connection.machine.observers.append(TimeLimit(limit, connection.stop))
        returned = drive(m, application, **shares.application)
        waits = ", ".join(dict.fromkeys(filter(None, connection.machine.sequences.places)))
    result, stop = result_of(returned, connection), connection.stop
    waited = f"; the application waited at {waits}" if waits else ""
    if stop.time_over:
        raise TimeExpired(f"the run has not ended by {limit:g} s{waited}")
    if stop.signal is not None and in_main_thread():
        tell_in_a_line()
        text = f"stopped by {signal_name(stop.signal)}; every actuator is at its default{waited}"
        raise Interrupted(text, stop.signal, result)
    return result


def result_of(returned: Any, connection: connect[Any]) -> Any:
    """Return the result of an ended run: the return value of its application, or else its last result so far. If the
    function that returns this result has failed, the text of its error is the result."""
    machine = getattr(connection, "machine", None)
    if returned is not None or machine is None:
        return returned
    so_far = machine.result_so_far
    if not callable(so_far):
        return so_far
    try:
        return so_far()
    except BaseException as error:  # SystemExit too
        if is_interrupt(error):
            raise
        return f"no result so far: {text_of(error)}"


@expects_errors
def drive(m: C, application: Application[C] | None = None, **options: Any) -> Any:
    """Run the loop of a connected machine. It ends when the application ends or a stop is requested; such a request
    ends the wait for a tick. The `options` are those of the application (options of drivers belong to `connect`).
    Raises OptionError if the application does not have one of these options."""
    check_machine("drive", m)
    _check_application(application)
    shares = distribute_options(options, application=application, wiring={})
    timer, cycle = _timer_of(m), m.cycle
    task = None if application is None else m.cycle.start(_sequence_of(application, m, shares.application))
    view: Any = m._machine
    phases = view.whole.phases
    while cycle.running and not (task is not None and task.done):
        if phases.several is not None:
            if not phases.several():
                break
            continue
        if timer.read() < 0:
            break
        m.sample()
        m.control()
        m.update()
    return task.result if task is not None and task.done else None


def _sequence_of(application: Application[C], m: C, options: Mapping[str, Any]) -> Coroutine[Any, Any, Any]:
    """Return the sequence of the application. Raises DeclarationError for an application that takes no machine, or that
    is a plain function, because such a function has already done all its work."""
    function = application.func if isinstance(application, partial) else application
    place = in_brackets(shown_place(definition(function)))
    if text := no_machine(function):
        raise DeclarationError(f"{text}{place}")
    sequence = application(m, **options)
    if not isinstance(sequence, Coroutine):
        name = getattr(function, "__name__", "it")
        why = "there is a `yield` in it" if isasyncgen(sequence) else f"write `async def {name}`"
        raise DeclarationError(f"{name} is not a sequence, but an application must be one: {why}{place}")
    return sequence


def _check_application(application: object) -> None:
    if application is not None and not callable(application):
        raise DeclarationError(f"an application is an `async def` function of the machine, not {cut_repr(application)}")


def _checked_observers(observers: Iterable[Observer]) -> list[Observer]:
    found = list(observers) if isinstance(observers, Iterable) else [observers]
    for each in found:
        if not callable(each):
            raise DeclarationError(f"observers are a list of functions that take a frame, not {cut_repr(observers)}")
        check_acts_at_once("an observer", each)
    return found


def _timer_of(machine: Compound) -> DigitalSensor:
    """Return the timer of the machine. Raises DeclarationError if there is none."""
    timer = children(machine).get("timer")
    if not isinstance(timer, DigitalSensor):
        raise DeclarationError(f"{type(machine).__name__} has no `timer`: umo.run needs a DigitalSensor with this name")
    return timer
