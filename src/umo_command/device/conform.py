"""`umo device conform`: runs the conformance kit on a driver of a wiring, with the hardware to which the driver is
connected."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.table import Table

from umo.cycle.segments import UNCONTROLLED_TIMEOUT
from umo.drivers import Direction, Driver
from umo.drivers.streams import Host, Serial
from umo.drivers.wrapping import bare
from umo.errors import DriverError, PathError, StopError, text_of
from umo.exit_status import ExitStatus
from umo.objects import Compound, described
from umo.objects.presentation.value_text import span
from umo.objects.units import convert
from umo.process.station import Station, StationError, find
from umo.signature import signature_of
from umo.system.device_record import DeviceClaim
from umo.system.packages import station_of
from umo.system.signal_handling import SIGNALS, handling
from umo.system.streams import limit_waits
from umo.testing.conformance import Certificate, Input, Output, PtyTap, Subject, Tap, TcpTap, all_rules, conform
from umo.testing.conformance.process_snapshot import State, state
from umo.text import did_you_mean, in_brackets, some
from umo.wiring import Wire, Wired, resolve
from umo.wiring.controller_table import ON_CONTROLLER
from umo.wiring.run_options import maker_of
from umo_command.console import err, out, say
from umo_command.progress_line import OneLine
from umo_command.shared import interrupt_once
from umo_command.station_options import machine_of
from umo_command.values import check_file

ROUNDING_SHARE = 1e-9
BOTH_ENDS = "; both ends of a loop-back need an object, which --only must not leave out"
IN_PART = 3
"""The exit status if no rule is broken, but the line was not disturbed, or the time was too short."""


@dataclass(frozen=True)
class Choice:
    """The choices of the user on the command line."""

    driver: str | None = None
    only: Sequence[str] = ()
    loopbacks: Sequence[str] = ()
    refused: Sequence[str] = ()
    steady: Sequence[str] = ()
    structured: bool = True
    sole_writer: bool = False
    tolerance: float = 0.0
    minutes: float = 2.0
    json: Path | None = None
    yes: bool = False
    acknowledge: bool = False


def conform_wiring(target: str, wiring: str | None, choice: Choice, arguments: Sequence[str] = ()) -> int:
    """Try the rules. Return 0 if no rule is broken, 1 if a rule is broken, and 3 if the line was not disturbed or the
    time was too short."""
    limit_waits()
    check_file("--out", choice.json)
    certificate_file = None if choice.json is None else choice.json.absolute()  # whatever folder a driver changes to
    station, wiring = _station(target, wiring)
    machine = machine_of(station, arguments)
    with handling(interrupt_once, SIGNALS):  # nothing interrupts the way to the defaults
        certificate = _proved(station, station.wiring(wiring), machine, choice)
    out.print(certificate.table())
    if certificate_file is not None:
        certificate_file.write_text(certificate.to_json(), encoding="utf-8")
    if not certificate.passed:
        return ExitStatus.FAILED
    return 0 if certificate.whole else IN_PART


def _proved(station: Station, file: Path | None, machine: Compound, choice: Choice) -> Certificate:
    before = state()
    wired = resolve(machine, file, to_run=False)
    name = _driver(wired, choice.driver)
    others = (type(driver).__module__ for other, driver in wired.drivers.items() if other != name)
    if not all(module.startswith("umo.") for module in others):
        before = state()  # another driver may have changed the process while it was made
    if hasattr(bare(wired.drivers[name]), ON_CONTROLLER):
        return _of_link(station, file, machine, wired, name, choice)
    wires = _wires(wired, name, choice.only)
    subject = _subject(station, file, wired, name, wires, choice)
    devices = wired.hardware.get(name, ())
    device_claim = DeviceClaim(devices, station.name, "conform", acknowledge=choice.acknowledge)
    with _kept(device_claim) as stopped:
        _consent(subject, wires, devices, choice.yes)
        place = getattr(bare(wired.drivers[name]), "place", None)
        with _line(subject, maker_of(file, name), place) as tapped:
            _check_opens(tapped, name)
            certificate = _driven(tapped, choice.minutes, before)
        stopped += certificate.unreached
    return certificate


def _of_link(
    station: Station, file: Path | None, machine: Compound, wired: Wired, name: str, choice: Choice
) -> Certificate:
    """Test the rules of the link to a controller. Nothing is driven, so the user is not asked to agree."""
    from umo_command.device.conform_link import link_certificate

    if choice.only or choice.loopbacks or choice.refused or choice.steady:
        raise StationError(f"{name} is a controller: the kit tests its link, so no channels can be chosen")
    claim = DeviceClaim(wired.hardware.get(name, ()), station.name, "conform", acknowledge=choice.acknowledge)
    try:
        return link_certificate(_title(station, file, name), machine, wired, name)
    finally:
        claim.abandon()


def _title(station: Station, file: Path | None, name: str) -> str:
    return "-".join([station.name, *([file.stem] if file else []), name])


def _station(target: str, wiring: str | None) -> tuple[Station, str | None]:
    """Return the station that is named, or the station to which the named wiring file belongs, and the wiring."""
    file = Path(target)
    if file.suffix != ".toml" or wiring is not None:
        return find(target), wiring
    if not file.is_file():
        raise StationError(f"there is no wiring {target}")
    folder = station_of(file)
    if folder is None:
        raise StationError(f"{target} is not in the folder of a station; give the station, and the wiring with -w")
    return find(folder), target


def _driver(wired: Wired, given: str | None) -> str:
    names = ", ".join(wired.drivers)
    if given is not None:
        if given not in wired.drivers:
            raise StationError(
                f"there is no driver {given!r}{did_you_mean(given, wired.drivers)} in the wiring: {names}"
            )
        return given
    timer = wired.timer_wire
    others = [name for name, driver in wired.drivers.items() if timer is None or driver is not timer.driver]
    for found in (list(wired.hardware), others, list(wired.drivers)):
        if len(found) == 1:
            return found[0]
        if found:
            break
    raise StationError(f"the wiring has several drivers: choose one with --driver: {names}")


def _wires(wired: Wired, name: str, only: Sequence[str]) -> list[Wire]:
    """Return the wires of the driver, or only those that `only` names. The timer is included only if nothing else is
    wired to the driver."""
    own = [wire for wire in wired.wires if wire.driver is wired.drivers[name]]
    wires = [wire for wire in own if wire.item is not wired.timer] or own
    if not wires:
        raise StationError(f"no object is wired to {name}")
    return [_wire(wires, text, wired, name) for text in dict.fromkeys(only)] if only else wires


def _wire(wires: Iterable[Wire], text: str, wired: Wired, name: str, why: str = "") -> Wire:
    """Find a wire of a driver by the text of its channel or the path of its object. `why`: why it must be wired."""
    known = {wire.path: wire for wire in wires} | {wire.channel.text: wire for wire in wires}
    if text in known:
        return known[text]
    driver, near = wired.drivers[name], did_you_mean(text, known)
    for wire in wired.wires:
        if wire.driver is driver and text in (wire.path, wire.channel.text):
            raise PathError(f"{text!r} is wired to {name}, but cannot be chosen here{why}")
    try:
        driver.channel(text)
    except Exception:
        raise PathError(f"{text!r} is neither a channel of {name} nor an object wired to it{near}") from None
    raise PathError(f"{text!r} is a channel of {name}, but no object is wired to it{near}{why}")


def _subject(
    station: Station, file: Path | None, wired: Wired, name: str, wires: list[Wire], choice: Choice
) -> Subject:
    outputs = [wire for wire in wires if wire.item.direction is Direction.OUTPUT]
    inputs = [wire for wire in wires if wire.item.direction is not Direction.OUTPUT]
    loops = [_loop(wires, text, wired, name) for text in choice.loopbacks]
    by_text = {wire.channel.text: wire for wire in wires}
    steady = [_wire(inputs, text, wired, name, "; --steady needs an input") for text in choice.steady]
    driver = wired.drivers[name]
    return Subject(
        name=_title(station, file, name),
        make=maker_of(file, name),
        outputs=tuple(_output(wire) for wire in outputs),
        inputs=tuple(Input(wire.channel.text, steady=wire in steady) for wire in inputs),
        loopbacks=tuple((one.channel.text, other.channel.text) for one, other in loops),
        timeout=driver.timeout,
        device=", ".join(wired.hardware.get(name, ())),
        period=driver.period,
        watchdog=wired.watchdogs.get(name, 0.0),
        refused=_refused(driver, wired, choice.refused),
        agree=partial(_agree, by_text, choice.tolerance),
        structured=choice.structured,
        sole_writer=choice.sole_writer,
    )


def _refused(driver: Driver[Any], wired: Wired, texts: Sequence[str]) -> tuple[str, ...]:
    """Return channels of the driver to which nothing is wired. The kit reads them, and writes 0 to the outputs among
    them."""
    for text in texts:
        places = set(driver.channel(text).places)
        for wire in wired.wires:
            if wire.driver is driver and places & set(wire.channel.places):
                raise StationError(f"--refused {text}: {wire.path} is wired to this channel")
    return tuple(texts)


def _output(wire: Wire) -> Output:
    least, greatest = wire.raw_bounds
    default = wire.default
    assert default is not None  # of an actuator
    return Output(wire.channel.text, default, least, greatest)


def _loop(wires: Sequence[Wire], text: str, wired: Wired, name: str) -> tuple[Wire, Wire]:
    first, sign, second = text.partition("=")
    if not sign:
        raise StationError(f"--loopback {text}: give OUTPUT=INPUT")
    output, back = (_wire(wires, end, wired, name, BOTH_ENDS) for end in (first, second))
    if output.item.direction is not Direction.OUTPUT or Direction.INPUT not in back.channel.direction:
        raise StationError(f"--loopback {text}: {first} must be an actuator and {second} a channel that can be read")
    return output, back


def _agree(wires: dict[str, Wire], tolerance: float, output: str, raw: int, back: str, level: int) -> bool:
    """True if both levels mean the same value. The difference may be up to half a resolution of each object, plus the
    tolerance in the output's unit. An output that is read back has the same raw level."""
    one, other = wires[output], wires[back]
    if one.item._has_states or other.item._has_states:
        return raw == level
    if output == back:
        return abs(one.value(level) - one.value(raw)) <= tolerance
    value, read_back, half = one.value(raw), other.value(level), abs(other.scale[0]) / 2
    units = described(other.item).unit, described(one.item).unit
    near = abs(convert(read_back, *units) - value)
    halves = abs(convert(half, *units) - convert(0.0, *units)) + abs(one.scale[0]) / 2
    return near < tolerance + halves * (1 - ROUNDING_SHARE)


# Before and after -------------------------------------------------------------------------------------


class NotDriven(StationError):
    """Raised if the user did not agree that the outputs are driven."""


def _consent(subject: Subject, wires: Sequence[Wire], devices: Sequence[str], yes: bool) -> None:
    """List the outputs that will be driven, and ask the user. Raises NotDriven if the user does not agree. A simulation
    needs no consent."""
    if not subject.outputs or not devices:
        return
    err.print(_plan(subject, wires, devices))
    if yes:
        return
    if not sys.stdin.isatty():
        paths = [wire.path for wire in wires if wire.item.direction is Direction.OUTPUT]
        raise NotDriven(f"this command drives {some(paths)} over the whole range: confirm with --yes")
    try:
        agreed = input("Drive these outputs? [y/N] ").strip().lower() in ("y", "yes")
    except (EOFError, KeyboardInterrupt):
        err.print()
        agreed = False
    if not agreed:
        raise NotDriven("nothing was driven")


def _plan(subject: Subject, wires: Sequence[Wire], devices: Sequence[str]) -> Table:
    ranges = {output.channel: output for output in subject.outputs}
    table = Table(
        "object", "channel", "raw levels", "values", "default", title=f"outputs to drive on {', '.join(devices)}"
    )
    for wire in wires:
        if (output := ranges.get(wire.channel.text)) is None:
            table.add_row(wire.path, wire.channel.text, "read; a write must be refused", "", "")
            continue
        low, high = sorted((wire.value(output.least), wire.value(output.greatest)))
        about = described(wire.item)
        values = span(low, high, about.unit) if about.is_number else about.range_text
        table.add_row(
            wire.path,
            output.channel,
            f"{output.least} to {output.greatest}",
            values,
            about.default_text,
        )
    return table


@contextmanager
def _kept(device_claim: DeviceClaim) -> Iterator[list[str]]:
    """Return a context in which the devices are held. It yields a list, to which it adds, at the end, the outputs that
    are not at their defaults."""
    unreached: list[str] = []
    end = device_claim.finish
    try:
        yield unreached
    except StopError as error:
        unreached += [failure.path for failure in error.failures]
        raise
    except (OSError, NotDriven):  # nothing was driven, so the record of an earlier unsafe end remains
        end = device_claim.abandon
        raise
    finally:
        if unreached:
            device_claim.stopped("conformance", unreached)
        else:
            end()


@contextmanager
def _line(subject: Subject, make: partial[Driver[Any]], place: object) -> Iterator[Subject]:
    """Put a tap before the device, if the driver's address can be changed."""
    parameters = signature_of(make.func)
    options: dict[str, Any] = {
        name: parameters[name].default for name in ("host", "port", "serial") if name in parameters
    }
    options |= {name: value for name, value in make.keywords.items() if name in options}
    tap = _tap(options, place)
    with tap or nullcontext():
        if isinstance(tap, PtyTap):
            subject = replace(subject, make=partial(make, serial=tap.serial), line=tap)
        elif isinstance(tap, TcpTap):
            subject = replace(subject, make=partial(make, host=tap.host, port=tap.port), direct=make, line=tap)
        yield subject


def _tap(options: dict[str, Any], place: object) -> Tap | None:
    """Make a tap for the driver's `place`, which also has the values that the wiring omits. If the driver has no
    `place`, use its options."""
    if isinstance(place, Serial) and "serial" in options:
        if place.rs485:  # a pseudo terminal has no direction to switch
            return None
        return PtyTap(place.path, parity=place.parity, data_bits=place.data_bits)
    if isinstance(place, Host) and {"host", "port"} <= options.keys():
        return TcpTap(place.host, place.port)
    if options.get("serial"):
        return PtyTap(str(options["serial"]))
    if options.get("host") and isinstance(options.get("port"), int):
        return TcpTap(options["host"], options["port"])
    return None


def _check_opens(subject: Subject, name: str) -> None:
    """Raise one clear error in place of a table of failures."""
    try:
        driver = subject.make()
    except Exception as error:
        raise DriverError(f"driver {name} cannot be created again: {text_of(error)}") from error
    driver.timeout, driver.period = max(UNCONTROLLED_TIMEOUT, subject.timeout), subject.period
    inputs = [driver.channel(each.channel) for each in subject.inputs]
    for output in subject.outputs:
        driver.channel(output.channel)
    try:
        driver.open()
        if inputs:
            driver.initialize(inputs[0], None)
            driver.read(inputs[0])
    except Exception as error:
        raise DriverError(f"driver {name}{in_brackets(subject.device)}: {text_of(error)}") from error
    finally:
        driver.close()


def _driven(subject: Subject, minutes: float, before: State) -> Certificate:
    """Return the certificate; print the expected duration first, then a line of progress. Rules that write to inputs
    are left out if nothing may be driven. If a signal ends it, the remaining state is printed."""
    began = time.monotonic()
    only = None if subject.outputs else [rule.id for rule in all_rules() if rule.id != "directions"]
    try:
        with OneLine(err) as line:

            def progress(rule: str, share: float) -> None:
                line.show(time.monotonic() - began, rule, share)

            return conform(
                subject,
                only=only,
                minutes=minutes,
                before=before,
                plan=lambda plan: say(str(plan)),
                progress=progress if err.is_terminal else None,
            )
    except KeyboardInterrupt:
        end = "every output is at its default" if subject.outputs else "no output was driven"
        say(f"stopped; {end}")
        raise
