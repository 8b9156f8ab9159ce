"""The data of a part on a controller: its objects, its code in C, its fields, and the hash that both ends compare."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from zlib import crc32

from umo.cycle.clock import Clock
from umo.cycle.directory import axes_in
from umo.cycle.equipment import equipment_in
from umo.cycle.image import Image
from umo.cycle.machine import ConnectedMachine
from umo.cycle.machine_view import connect_compounds
from umo.cycle.stopping import StopFlag
from umo.drivers.contract import Driver
from umo.drivers.wrapping import bare
from umo.duration import duration
from umo.generate.controller_folder import NotTranslated, check, faults_of
from umo.generate.controller_model import ControllerModel, NotGenerated, model_of
from umo.generate.emit.machine_source import header_of, source_of
from umo.generate.known_setters import root_of, settings_of
from umo.generate.lower.lowered_rings import DequeFields
from umo.generate.split.field_bytes import FieldBytes
from umo.generate.split.link_frames import CRC_BYTES
from umo.generate.translation import CodeFault, ControllerTarget, Translation
from umo.generate.translator import translate
from umo.objects import Compound, walk
from umo.wiring.rates import NO_RATES
from umo.wiring.wired import ProcessSettings, Wired

LONGEST_HEAD = 64
"""Largest number of bytes of a frame, not counting those that depend on the part."""
MOST_BYTES = 2**16 - 1 - CRC_BYTES
"""Largest number of bytes of a body, because a controller counts them in 16 bits."""


@dataclass(frozen=True)
class PartPlan:
    """The data of a part that both ends of the link have."""

    path: str
    model: ControllerModel
    translation: Translation
    target: ControllerTarget
    fields: Sequence[FieldBytes]
    host_timeout: float
    """Time in s without the host after which the controller brakes its axes, and brings its outputs to their
    defaults."""
    braking_timeout: float
    """Longest time in s for braking."""

    @property
    def real_size(self) -> int:
        return 8 if self.target.real == "double" else 4

    @property
    def timeout_ticks(self) -> int:
        """The timeout in periods of the controller: at least one."""
        return max(int(self.host_timeout / self.model.period + 1e-9), 1)

    @property
    def braking_ticks(self) -> int:
        """The braking timeout in periods of the controller."""
        return int(self.braking_timeout / self.model.period + 1e-9)

    @property
    def longest(self) -> int:
        """Number of bytes of the longest body of a frame. It contains all data, so that related data are accepted
        together."""
        inputs, outputs = self.model.inputs, len(self.model.outputs)
        items = sum(3 + each.size for each in self.fields)
        items += outputs * (3 + self.real_size) + inputs * (4 + self.real_size) + 3 * (len(self.model.equipment) + 2)
        answer = 5 * inputs + (5 + self.real_size) * outputs + 2 * len(self.model.equipment)
        return LONGEST_HEAD + outputs + max(items, answer + sum(each.size for each in self.fields))

    @cached_property
    def faults(self) -> dict[int, CodeFault]:
        return {each.number: each for each in faults_of(self.translation)}

    def fault_text(self, number: int, slot: int = -1) -> str:
        """Return the meaning of a fault of the controller. `slot`: the slot of the object that has failed. It is below
        0 if no object has failed."""
        fault = self.faults.get(number)
        if fault is None:
            return "the controller's watchdog has ended its last run" if number < 0 else f"fault {number}"
        path = f"{self.model.objects[slot].path}: " if slot >= 0 else ""
        where = f" ({fault.file}:{fault.line})" if fault.line else ""
        return f"{path}{fault.kind}: {fault.text}{where}"

    @cached_property
    def hash(self) -> int:
        """The hash of all data on which both ends must agree. The initial values of fields are not included, because
        the host sends them."""
        any_target = replace(self.target, name="any", exact_libm=False)
        without_init = replace(self.translation, init="")
        code = [header_of(self.model, self.translation, any_target), source_of(self.model, without_init, any_target)]
        return crc32("\n".join([*code, self._tables(), str(self.timeout_ticks), str(self.braking_ticks)]).encode())

    def _tables(self) -> str:
        """Return the table of the fields in C."""
        members = [each.members() for each in self.fields]
        first = [0]
        for each in members:
            first.append(first[-1] + len(each))
        places = "".join(
            f"    {{offsetof(umo_machine, {member}), sizeof(((umo_machine *)0)->{member})}},\n"
            for each in members
            for member in each
        )
        changes = ", ".join(str(int(each.changes)) for each in self.fields) or "0"
        return (
            f"const UMO_FLASH umo_link_place link_places[] = {{\n{places or '    {0, 0},'}}};\n"
            f"const UMO_FLASH uint16_t link_first[] = {{{', '.join(map(str, first))}}};\n"
            f"const UMO_FLASH uint8_t link_changes[] = {{{changes}}};\n"
        )

    def files(self) -> dict[str, str]:
        """Return the files of the controller in addition to the files of its machine."""
        header = (
            f"/* machine_link.h: what host and controller agree on of {self.path}. Made by umo new controller. */\n"
            '#ifndef MACHINE_LINK_H\n#define MACHINE_LINK_H\n\n#include "machine.h"\n\n'
            f"#define LINK_HASH {self.hash}u\n"
            f"#define LINK_HOST_TIMEOUT {self.timeout_ticks}u /* periods of MACHINE_PERIOD */\n"
            f"#define LINK_BRAKING_TIMEOUT {self.braking_ticks}ul /* more of them */\n"
            "#define LINK_BITS(count) ((count) / 8 + 1)\n"
            f"enum {{ LINK_FIELDS = {len(self.fields)}, LINK_LONGEST = {self.longest} }};\n"
            f"enum {{ LINK_CALLS = {len(self.translation.host_calls)} }}; /* what the host may be asked to plan */\n\n"
            "typedef struct {\n    uint16_t offset;\n    uint8_t size;\n} umo_link_place;\n"
            "extern const UMO_FLASH umo_link_place link_places[]; /* the numbers of the fields */\n"
            "extern const UMO_FLASH uint16_t link_first[];        /* the first number of each field, and the end */\n"
            "extern const UMO_FLASH uint8_t link_changes[];       /* whether machine_step changes the field */\n"
            "\n#endif\n"
        )
        text = "/* machine_link.c: the fields of the link (docs/split-protocol.md). Made by umo new controller. */\n"
        return {"machine_link.h": header, "machine_link.c": f'{text}#include "machine_link.h"\n\n{self._tables()}'}


@contextmanager
def part_laid_out(part: Compound, wired: Wired, driver: Driver, period: float) -> Iterator[ControllerModel]:
    """Return the model of a part alone, on this controller with this period. The calibrations of the part are set to
    those of the wiring. The machine is not connected."""
    wires = [each for each in wired.wires if bare(each.driver) is driver or each.item is wired.timer]
    alone = replace(wired, wires=wires, period=period, rates=NO_RATES, process=ProcessSettings())
    image = Image(alone, Clock(period), len(equipment_in(part)), len(axes_in(part)))
    machine = ConnectedMachine(part, image, StopFlag())
    connect_compounds(machine)
    try:
        model = model_of(machine, alone)
        model.name = part._path
        model.problems += _other_rates(part, wired, period)
        yield model
    finally:
        machine.disconnect()


def _other_rates(part: Compound, wired: Wired, period: float) -> Iterator[NotGenerated]:
    """Yield the obstacles that parts inside this part have other rates than the controller, which has only one rate."""
    inside = {id(node) for node in (part, *walk(part))}
    for rate in wired.rates:
        own = rate.every * (wired.period or 0.0)
        if id(rate.part) in inside and abs(own - period) > 1e-9 * period:
            reason = f"its rate is {duration(own)}, but the period of its controller is {duration(period)}"
            nearest = f'leave out `every`, or write cycle = "{duration(own)}" for the controller'
            yield NotGenerated(rate.part._path, reason, nearest)


def plan_of(
    part: Compound,
    wired: Wired,
    driver: Driver,
    period: float,
    target: ControllerTarget,
    host_timeout: float,
    braking_timeout: float,
) -> PartPlan:
    """Return the plan of a part. Raises NotTranslated with all obstacles."""
    with part_laid_out(part, wired, driver, period) as model:
        translation = translate(part, model.conditions, model.steps, target)
        translation.problems += settings_of(translation.known, root_of(part))
        rings = [each.path for each in translation.structs if isinstance(each.owner, DequeFields)]
        model.problems += [
            NotGenerated(each, "it is a deque, which is not transferred to the host", "a list") for each in rings
        ]
        check(model, translation)
        owners = {(each.path, each.struct, each.name): each.owner for each in translation.layout}
        fields = [
            FieldBytes(live, name, of, owners[live.path, live.member, name] == "STATE", target.real)
            for live in translation.structs
            for name, of in live.fields.items()
        ]
        plan = PartPlan(part._path, model, translation, target, fields, host_timeout, braking_timeout)
    if plan.longest > MOST_BYTES:
        reason = f"a frame would have {plan.longest} bytes, but a controller accepts at most {MOST_BYTES}"
        raise NotTranslated(model.name, [str(NotGenerated(part._path, reason, "split it into several parts"))])
    return plan


def share_of(count: int) -> int:
    """Return the number of bytes for this number of bits, like LINK_BITS in C."""
    return count // 8 + 1


def bits_of(count: int) -> int:
    """Return the number of bytes for this number of bits in an answer."""
    return ceil(count / 8)
