/* umo_outputs.c: interlocks, expiry, rates, and values that become raw integers, as in umo.cycle.command_stage,
 * umo.cycle.inhibition and umo.cycle.conversion. */
#include <string.h>

#include "umo.h"

/* Time in s since a tick. */
umo_real umo_since(const umo_core *c, umo_tick tick)
{
#ifdef UMO_FLOAT
    return (umo_real)(c->number - tick) * c->plan->period; /* exact after days, too */
#else
    return c->now - (umo_real)tick * c->plan->period; /* the difference of two times, as in Python */
#endif
}

static umo_object *object_at(umo_core *c, int16_t place)
{
    return &c->objects[c->plan->output_objects[place]];
}

static int32_t raw_of(const umo_object *o, umo_real value)
{
    const UMO_FLASH umo_traits *of = o->traits;
    if (value == of->rest)
        return of->rest_raw;
    if (of->to_input)
        value = umo_curve_at(of->to_input, value);
    umo_real raw = umo_round_even(umo_to_steps(value, of->resolution, o->zero_offset));
    raw = raw > of->least ? raw : of->least;
    return (int32_t)(raw < of->greatest ? raw : of->greatest);
}

static void accepted(umo_object *o)
{
    o->value = o->output->sent;
    o->raw = o->output->sent_raw;
    o->time = o->core->number;
    o->quality = UMO_GOOD;
}

/* PartPeriods._hasten */
static void hasten(umo_output *output)
{
#ifdef UMO_GROUPS
    output->urgent = true;
#else
    (void)output;
#endif
}

/* The default of an actuator, at once: without a rate. */
void umo_rest(umo_object *o)
{
    umo_output *output = o->output;
    output->pending = output->sent = o->traits->rest;
    output->sent_raw = o->traits->rest_raw;
    output->stepped = o->core->number;
    output->written = UMO_NEVER;
    hasten(output);
    accepted(o);
    if (o->core->raws_out)
        o->core->raws_out[output->place] = output->sent_raw;
}

/* Interlocks --------------------------------------------------------------------------------------------- */

/* Inhibition.ask: true if it begins to inhibit. A condition that cannot be evaluated counts as true. Those asked after
 * it see what it inhibits. */
static bool ask(umo_core *c, int16_t i)
{
    umo_interlock *interlock = &c->interlocks[i];
    const UMO_FLASH umo_interlock_traits *of = &c->plan->interlock_traits[i];
    bool before = interlock->inhibits, holds = true;
    int16_t fault_object = c->fault_object;
    if (of->condition((umo_machine *)(void *)c, &holds)) {
        holds = true;
        c->fault_object = fault_object;
    }
    interlock->held = holds;
    interlock->latched = interlock->latched || (holds && of->latches && c->number > 0);
    interlock->inhibits = holds || interlock->latched;
    if (interlock->inhibits != before)
        umo_restrict(c);
    return !before && holds;
}

/* Claims._restrict. Equipment in fault refuses, and raises nothing. */
void umo_restrict(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->outputs; i++)
        c->outputs[i].inhibited = c->outputs[i].stopping = false;
    for (int16_t i = 0; i < c->plan->interlocks; i++) {
        const UMO_FLASH umo_interlock_traits *of = &c->plan->interlock_traits[i];
        for (int16_t k = 0; c->interlocks[i].inhibits && k < of->count; k++) {
            umo_output *output = &c->outputs[of->outputs[k]];
            output->inhibited = true;
            output->stopping = output->stopping || of->stops;
        }
    }
    for (int16_t i = 0; c->inhibits && i < c->plan->outputs; i++)
        if (c->inhibits[i / 8] >> i % 8 & 1)
            c->outputs[i].inhibited = true;
    for (int16_t i = 0; c->plan->equipment && i < c->plan->outputs; i++)
        if (umo_in_fault(c, object_at(c, i)->traits->equipment)) {
            c->outputs[i].inhibited = true;
            c->outputs[i].stopping = false;
        }
}

static void interlocked(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->interlocks; i++) {
        const UMO_FLASH umo_interlock_traits *of = &c->plan->interlock_traits[i];
        bool begins = ask(c, i);
        for (int16_t k = 0; begins && k < of->count; k++)
            c->outputs[of->outputs[k]].due = true;
    }
}

/* Guards._expired */
static void expire(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->outputs; i++) {
        umo_output *output = &c->outputs[i];
        const umo_object *o = object_at(c, i);
        umo_real expires = o->traits->expires;
        if (output->due || expires < 0 || output->written == UMO_NEVER)
            continue;
        if (umo_since(c, output->written) < expires - (umo_real)1e-9)
            continue;
        output->written = UMO_NEVER;
        output->pending = o->traits->rest; /* at its rate, with the outputs of this period */
        hasten(output);
        output->due = (o->traits->flags & UMO_ASYNCHRONOUS) != 0;
    }
}

/* Guards.evaluate: after the sensors were read. */
void umo_evaluate(umo_core *c)
{
    interlocked(c);
    expire(c);
    for (int16_t i = 0; i < c->plan->outputs; i++) {
        umo_output *output = &c->outputs[c->plan->stop_order[i]];
        if (output->due)
            umo_rest(object_at(c, c->plan->stop_order[i]));
        output->due = false;
    }
}

/* Inhibition.acknowledge, of all: what still holds stays. */
void umo_acknowledge(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->interlocks; i++)
        if (!c->interlocks[i].held)
            c->interlocks[i].latched = c->interlocks[i].inhibits = false;
    umo_restrict(c);
}

/* Outputs ------------------------------------------------------------------------------------------------ */

/* The time that a rate counts: that of the period, of others than the machine's own since the last step. */
static umo_real step_time(const umo_object *o)
{
#ifdef UMO_GROUPS
    if (o->core->sending != UMO_WHOLE)
        return umo_since(o->core, o->output->stepped);
#endif
    return o->core->dt;
}

/* conversion._next: what is pending, as near to it as the rate allows from the value last accepted. */
static umo_real next(umo_object *o)
{
    umo_output *output = o->output;
    umo_core *c = o->core;
    umo_real rate = o->traits->slew_rate;
    if (!(rate < (umo_real)INFINITY))
        return output->pending;
    if (c->number <= output->stepped)
        return output->sent;
    umo_real left = output->pending - o->value, way = rate * step_time(o);
    output->stepped = c->number;
    return umo_fabs(left) <= way * (umo_real)(1 + 1e-9) ? output->pending : o->value + umo_copysign(way, left);
}

/* Image.update, as far as the transfer: fills raws_out. */
void umo_give(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->outputs; i++) {
        umo_object *o = object_at(c, i);
        umo_output *output = o->output;
        umo_real value = umo_moves(o) ? next(o) : output->sent;
        if (memcmp(&value, &output->sent, sizeof value) != 0) {
            output->sent = value;
            output->sent_raw = raw_of(o, value);
        }
        c->raws_out[i] = output->sent_raw;
    }
    c->given = true;
}

/* An asynchronous actuator: its value is sent with the outputs of this period, and read as accepted. */
void umo_send(umo_object *o)
{
    umo_output *output = o->output;
    output->sent = output->pending;
    output->sent_raw = raw_of(o, output->sent);
    accepted(o);
}

/* WithPeriod.is_sent_again: the tick from which max_age counts. */
static umo_tick since(umo_object *o)
{
    umo_output *output = o->output;
    if (!(o->traits->flags & UMO_ASYNCHRONOUS))
        return o->time;
    if (output->unconfirmed == UMO_NEVER)
        output->unconfirmed = o->core->number;
    return output->unconfirmed;
}

/* ImageOutputs.fail_output: with on_error="retry" the value is sent again for max_age. */
static umo_fault fail(umo_object *o)
{
    umo_real max_age = o->traits->max_age;
    if (max_age >= 0 && umo_since(o->core, since(o)) <= max_age) {
        o->quality = UMO_STALE;
        return UMO_OK;
    }
    o->quality = UMO_BAD;
    return umo_contains(o, UMO_UNWRITTEN) ? UMO_OK : umo_failed(o, UMO_UNWRITTEN);
}

/* Image.update after the transfer: those that failed (NULL: none) keep what they had. */
umo_fault umo_sent(umo_core *c, const uint8_t *failed_out)
{
    umo_fault found = UMO_OK;
    c->changed = false;
    for (int16_t i = 0; i < c->plan->outputs; i++) {
        umo_object *o = object_at(c, i);
        umo_fault fault = UMO_OK;
        if (c->given && !umo_moves(o))
            continue;
        if (failed_out && failed_out[i])
            fault = fail(o);
        else if (c->given) {
            accepted(o);
            o->output->unconfirmed = UMO_NEVER;
        }
        found = found ? found : fault;
    }
    c->given = false;
    umo_enter_faults(c);
    return found;
}

/* The defaults, whatever the machine was doing. Write them one by one in the order of plan->stop_order. */
void umo_stop(umo_core *c, int32_t *raws_out)
{
    c->raws_out = raws_out;
    c->given = false;
#ifdef UMO_GROUPS
    c->sending = UMO_SENT;
#endif
    for (int16_t i = 0; i < c->plan->outputs; i++)
        umo_rest(object_at(c, c->plan->stop_order[i]));
}

/* Start -------------------------------------------------------------------------------------------------- */

/* As after umo.cycle.connect has initialised every object. The pointers of the core are set. */
void umo_start(umo_core *c)
{
    const UMO_FLASH umo_plan *plan = c->plan;
    c->raws_out = NULL;
    c->number = 0;
    c->ticks = 1;
    c->now = 0;
    c->dt = plan->period;
    c->fault_object = -1;
    c->given = c->changed = false;
    for (int16_t i = 0; i < plan->equipment; i++)
        c->equipment[i].fault = c->equipment[i].raised = UMO_OK;
    for (int16_t i = 0; i < plan->objects; i++) {
        umo_object *o = &c->objects[i];
        memset(o, 0, sizeof *o);
        o->core = c;
        o->traits = &plan->traits[i];
        o->value = (umo_real)NAN;
        o->zero_offset = o->traits->zero_offset;
        o->time = UMO_NEVER;
        o->quality = UMO_BAD;
        o->base = o->traits->flags & UMO_INCREMENTAL ? UMO_UNREFERENCED : UMO_GOOD;
    }
    for (int16_t i = 0; i < plan->conditionings; i++) {
        c->objects[plan->conditioned[i]].conditioning = &c->conditionings[i];
        umo_begin_conditioning(&c->conditionings[i]);
    }
    for (int16_t i = 0; i < plan->interlocks; i++)
        c->interlocks[i].held = c->interlocks[i].latched = c->interlocks[i].inhibits = false;
    for (int16_t i = 0; i < plan->outputs; i++) {
        umo_object *o = object_at(c, i);
        memset(&c->outputs[i], 0, sizeof c->outputs[i]);
        o->output = &c->outputs[i];
        o->output->place = i;
        o->output->unconfirmed = UMO_NEVER;
        umo_rest(o);
    }
#ifdef UMO_GROUPS
    umo_start_groups(c);
#endif
}
