"""The files machine.h and machine.c of a generated controller."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from umo.generate.controller_model import ControllerModel, ControllerObject
from umo.generate.emit.c_text import array, comment, real, truth
from umo.generate.emit.object_tables import tables_of
from umo.generate.names import identifiers
from umo.generate.translation import ControllerTarget, Translation

HEADER = """\
/* machine.h: the controller of {name}, made by umo new controller for the target {target}. Do not edit it: change the
 * declaration, and generate again.
 *
 * Numbers are {real}s. In each period call machine_step, write raws_out to the hardware, and call machine_sent. At any
 * fault, and at the end, call machine_stop, and write raws_out to the hardware in the order of machine_stop_order. */
#ifndef MACHINE_H
#define MACHINE_H

#include "umo_python.h"

#define MACHINE_NAME "{name}"
#define MACHINE_PERIOD {period} /* s */
enum {{ MACHINE_INPUTS = {inputs}, MACHINE_OUTPUTS = {outputs}, MACHINE_OBJECTS = {objects} }};
enum {{ MACHINE_EQUIPMENT = {equipment} }}; /* parts that fail alone */

/* Places in raws_in and failed_in. */
enum machine_inputs {{
{input_names}}};

/* Places in raws_out and failed_out. */
enum machine_outputs {{
{output_names}}};

extern const int16_t machine_stop_order[];
{equipment_names}
{structs}
struct umo_machine {{
    umo_core core; /* the first member */
    umo_object objects[{objects_1}];
    umo_output outputs[{outputs_1}];
    umo_conditioning conditionings[{conditionings_1}];
    umo_interlock interlocks[{interlocks_1}];
    umo_equipment equipment[{equipment_1}];
{group_members}{members}}};

/* At power-up: every actuator is at its default. */
void machine_init(umo_machine *m);

/* Once, after machine_init: the sensors are read for the first time, and interlocks take effect. */
umo_fault machine_begin(umo_machine *m, const int32_t *raws_in, const uint8_t *failed_in, int32_t *raws_out);

/* Carries out one period, `ticks` ticks after the last one (1: in time). `failed_in` marks the inputs that could not be
 * read; NULL: all were read. Fills raws_out; after a fault only the outputs that were reset have new values in it. */
umo_fault machine_step(
    umo_machine *m, int32_t ticks, const int32_t *raws_in, const uint8_t *failed_in, int32_t *raws_out);

/* Call it after raws_out was written to the hardware. `failed_out` marks the outputs that were not accepted; NULL: all
 * were. If m->core.changed is true afterwards, {changed}
 * changed raws_out: write raws_out and call this function again. */
umo_fault machine_sent(umo_machine *m, const uint8_t *failed_out);

/* Every actuator goes to its default. */
void machine_stop(umo_machine *m, int32_t *raws_out);

/* Releases the actuators of those latched interlocks whose conditions are false. */
void machine_acknowledge(umo_machine *m);

/* Ends the faults of this equipment, and of the equipment around it and in it; -1: of all equipment. While a sensor of
 * this equipment cannot be read, no fault ends, and the result is false. m->core.equipment[number].fault is the fault;
 * 0: there is none. */
bool machine_clear(umo_machine *m, int16_t number);

/* From the next machine_step on every axis decelerates to standstill. machine_moves: whether an axis moves. */
umo_fault machine_brake(umo_machine *m);
bool machine_moves(umo_machine *m);

/* The struct of a law or a part, by its number; NULL: there is none. */
void *machine_struct(umo_machine *m, int16_t number);

#endif
"""
CHANGED_BY_GROUPS = "a fault of equipment, or a part with a separate rate, has"
STEPS = """\
void machine_init(umo_machine *m)
{{
    m->core.plan = &plan;
    m->core.objects = m->objects;
    m->core.outputs = m->outputs;
    m->core.conditionings = m->conditionings;
    m->core.interlocks = m->interlocks;
    m->core.equipment = m->equipment;
{groups}    m->core.inhibits = NULL;
    m->core.host_call = NULL;
    umo_start(&m->core);
    init_objects(m);
}}

umo_fault machine_begin(umo_machine *m, const int32_t *raws_in, const uint8_t *failed_in, int32_t *raws_out)
{{
    machine_stop(m, raws_out);
    umo_fault fault = umo_sample(&m->core, raws_in, failed_in);
    umo_evaluate(&m->core);
    return fault;
}}

umo_fault machine_step(
    umo_machine *m, int32_t ticks, const int32_t *raws_in, const uint8_t *failed_in, int32_t *raws_out)
{{
    umo_fault fault = umo_begin_period(&m->core, ticks, raws_out);
    if (fault)
        return fault;
{choose}    fault = umo_sample(&m->core, raws_in, failed_in);
    umo_evaluate(&m->core); /* also if sensors failed */
    if (fault)
        return fault;
{laws}    umo_enter_faults(&m->core);
    umo_give(&m->core);
    return UMO_OK;
}}

umo_fault machine_sent(umo_machine *m, const uint8_t *failed_out)
{{
    return {sent}(&m->core, failed_out);
}}

void machine_stop(umo_machine *m, int32_t *raws_out)
{{
    umo_stop(&m->core, raws_out);
}}

void machine_acknowledge(umo_machine *m)
{{
    umo_acknowledge(&m->core);
}}

bool machine_clear(umo_machine *m, int16_t number)
{{
    return umo_clear(&m->core, number);
}}
"""
BRAKING = """
umo_fault machine_brake(umo_machine *m)
{{
    umo_fault fault = UMO_OK;
    (void)m;
{brakes}    return fault;
}}

bool machine_moves(umo_machine *m)
{{
    bool moves = false;
    (void)m;
    (void)moves;
{moves}    return false;
}}
"""


def header_of(model: ControllerModel, translation: Translation, target: ControllerTarget) -> str:
    """Return the text of machine.h."""
    conditioned = [one for one in model.objects if one.conditioned]
    inputs, outputs = model.objects[: model.inputs], [model.objects[slot] for slot in model.outputs]
    return HEADER.format(
        name=model.name,
        target=target.name,
        real=target.real,
        period=real(model.period, target),
        inputs=model.inputs,
        outputs=len(model.outputs),
        objects=len(model.objects),
        input_names=_names("IN", inputs),
        output_names=_names("OUT", outputs),
        changed=CHANGED_BY_GROUPS if model.groups else "a fault of equipment has",
        group_members="    umo_group groups[UMO_GROUPS];\n" if model.groups else "",
        structs=translation.header,
        members=translation.members,
        objects_1=len(model.objects),
        outputs_1=max(1, len(outputs)),
        conditionings_1=max(1, len(conditioned)),
        interlocks_1=max(1, len(model.interlocks)),
        equipment=len(model.equipment),
        equipment_1=max(1, len(model.equipment)),
        equipment_names=_equipment_names(model),
    )


def _names(prefix: str, objects: Sequence[ControllerObject]) -> str:
    """Return the members of an enum in C: each object with its channel, its units and the meaning of its raw
    integers."""
    lines = []
    for number, (one, name) in enumerate(zip(objects, identifiers(each.path for each in objects), strict=True)):
        resolution, zero_offset = one.scale
        scale = one.units if one.binary else f"raw * {resolution:g} + {zero_offset:g} {one.units}"
        lines.append(
            f"    {prefix}_{name} = {number}, /* {comment(one.path)}: {comment(scale)}; {comment(one.channel)} */\n"
        )
    return "".join(lines) or f"    {prefix}_NONE\n"


def _equipment_names(model: ControllerModel) -> str:
    if not model.equipment:
        return ""
    names = identifiers(each.path for each in model.equipment)
    lines = [f"    EQUIPMENT_{name} = {number},\n" for number, name in enumerate(names)]
    return f"\n/* Parts that fail alone: places in equipment. */\nenum machine_equipment {{\n{''.join(lines)}}};\n"


def source_of(model: ControllerModel, translation: Translation, target: ControllerTarget) -> str:
    """Return the text of machine.c."""
    parts = [
        f"/* machine.c: the controller of {model.name}. Made by umo new controller; do not edit it. */\n",
        '#include "machine.h"\n#include "machine_faults.h"\n\n',
        translation.source,
        "\n",
        tables_of(model, target),
        *_interlocks(model, translation),
        *_equipment(model, translation),
        *_groups(model, translation, target),
        *_plan(model, target),
        f"{translation.init}\n{translation.access}\n",
        _steps(model, translation),
        _braking(model, translation),
    ]
    return "".join(parts)


def _steps(model: ControllerModel, translation: Translation) -> str:
    """Return the functions that the program calls. Parts with rates of their own act after the outputs of the whole
    machine were sent."""
    any_group = bool(model.groups)
    return STEPS.format(
        groups="    m->core.groups = m->groups;\n" if any_group else "",
        choose="    umo_choose_whole(&m->core);\n" if any_group else "",
        laws=_laws(model, translation, -1),
        sent="umo_sent_in_turn" if any_group else "umo_sent",
    )


def _laws(model: ControllerModel, translation: Translation, group: int) -> str:
    laws = (law for law in model.laws if law.group == group)
    return "".join(_law(translation.entry[law.control].call(), law.equipment) for law in laws)


def _groups(model: ControllerModel, translation: Translation, target: ControllerTarget) -> Iterator[str]:
    """Yield the C of the parts with separate rates: when they act, and their laws."""
    if not model.groups:
        return
    lines = []
    for number, each in enumerate(model.groups):
        laws = _laws(model, translation, number)
        yield f"static umo_fault group_laws_{number}(umo_machine *m)\n"
        yield f"{{\n    umo_fault fault = UMO_OK;\n    (void)m;\n    (void)fault;\n{laws}    return UMO_OK;\n}}\n"
        period = real(each.period, target)
        lines.append(f"    {{{each.every}, {each.phase}, {period}, group_laws_{number}}}, /* {comment(each.path)} */\n")
    yield f"static const UMO_FLASH umo_group_traits group_traits[] = {{\n{''.join(lines)}}};\n\n"


def _braking(model: ControllerModel, translation: Translation) -> str:
    """Return the function that brings the axes to standstill. An axis that does not report whether it moves counts as
    standing."""
    brakes, moves = [], []
    for axis in model.axes:
        brakes.append(f"    if (!fault)\n        fault = {translation.entry[axis._brake].call()};\n")
        asked = translation.entry[axis._moves].call("&moves")
        moves.append(f"    if ({asked} == UMO_OK && moves)\n        return true;\n")
    return BRAKING.format(brakes="".join(brakes), moves="".join(moves))


def _law(call: str, equipment: int) -> str:
    if equipment < 0:
        return f"    fault = {call};\n    if (fault)\n        return fault;\n"
    return (
        f"    if (!umo_in_fault(&m->core, {equipment}) && (fault = {call}) != UMO_OK)\n"
        f"        umo_raise_in(&m->core, {equipment}, fault, m->core.fault_object);\n"
    )


def _interlocks(model: ControllerModel, translation: Translation) -> Iterator[str]:
    """Yield the C of the interlocks: their conditions as functions of one type, and the outputs that they inhibit."""
    for number, each in enumerate(model.interlocks):
        yield f"/* {comment(each.reason)} */\n"
        yield f"static umo_fault interlock_condition_{number}(umo_machine *m, bool *holds)\n"
        yield f"{{\n    return {translation.entry[each.condition].call('holds')};\n}}\n"
        yield array("int16_t", f"interlock_{number}", [str(place) for place in each.outputs])
    if not model.interlocks:
        return
    yield "static const UMO_FLASH umo_interlock_traits interlock_traits[] = {\n"
    for number, each in enumerate(model.interlocks):
        yield f"    {{interlock_condition_{number}, interlock_{number}, {len(each.outputs)}, "
        yield f"{truth(each.latched)}, {truth(each.stops)}}},\n"
    yield "};\n\n"


def _equipment(model: ControllerModel, translation: Translation) -> Iterator[str]:
    """Yield the C of the equipment: for each one the equipment that contains it, and the functions called when its
    fault begins."""
    if not model.equipment:
        return
    lines = []
    for number, each in enumerate(model.equipment):
        enter = "NULL"
        if each.entered:
            enter = f"enter_{number}"
            calls = "".join(f"    (void){translation.entry[one].call()};\n" for one in each.entered)
            yield f"static void {enter}(umo_machine *m)\n{{\n{calls}}}\n"
        lines.append(f"    {{{each.outer}, {enter}}}, /* {comment(each.path)} */\n")
    yield f"static const UMO_FLASH umo_equipment_traits equipment_traits[] = {{\n{''.join(lines)}}};\n\n"


def _plan(model: ControllerModel, target: ControllerTarget) -> Iterator[str]:
    conditioned = [one.slot for one in model.objects if one.conditioned]
    order = [str(place) for place in model.stop_order]
    yield f"const int16_t machine_stop_order[] = {{{', '.join(order) or '0'}}};\n"
    yield array("int16_t", "stop_order", order)
    yield array("int16_t", "output_objects", [str(slot) for slot in model.outputs])
    yield array("int16_t", "conditioned", [str(slot) for slot in conditioned])
    yield "static const UMO_FLASH umo_plan plan = {\n"
    fields = {
        "period": real(model.period, target),
        "inputs": "MACHINE_INPUTS",
        "objects": "MACHINE_OBJECTS",
        "outputs": "MACHINE_OUTPUTS",
        "interlocks": str(len(model.interlocks)),
        "timer": str(model.timer),
        "traits": "traits",
        "output_objects": "output_objects",
        "stop_order": "stop_order",
        "conditioned": "conditioned",
        "conditionings": str(len(conditioned)),
        "interlock_traits": "interlock_traits" if model.interlocks else "NULL",
        "equipment": str(len(model.equipment)),
        "equipment_traits": "equipment_traits" if model.equipment else "NULL",
        **({"group_traits": "group_traits"} if model.groups else {}),
    }
    yield from (f"    .{name} = {value},\n" for name, value in fields.items())
    yield "};\n\n"
