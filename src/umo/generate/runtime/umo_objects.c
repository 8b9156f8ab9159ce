/* umo_objects.c: reading and writing one object, as umo.objects.sensors, umo.objects.actuators and umo.control.inputs
 * do; the check of a write as umo.cycle.command_stage. */
#include "umo.h"

umo_fault umo_failed(umo_object *o, umo_fault fault)
{
    o->core->fault_object = (int16_t)(o - o->core->objects);
    return fault;
}

static bool is(const umo_object *o, uint8_t flag)
{
    return (o->traits->flags & flag) != 0;
}

/* Sensors ------------------------------------------------------------------------------------------------ */

umo_fault umo_digital_read(umo_object *o, umo_real *out)
{
    *out = o->value;
    return UMO_OK;
}

static uint8_t state(const umo_object *o, umo_real level)
{
    uint8_t one = o->traits->one;
    return level != 0 ? one : (uint8_t)(1 - one);
}

umo_fault umo_binary_read(umo_object *o, uint8_t *out)
{
    if (o->value != 0 && o->value != 1)
        return umo_failed(o, UMO_NEVER_READ);
    *out = state(o, o->value);
    return UMO_OK;
}

umo_real umo_value(const umo_object *o)
{
    return o->value;
}

int32_t umo_raw(const umo_object *o)
{
    return o->raw;
}

uint8_t umo_quality(const umo_object *o)
{
    return o->quality;
}

/* Time of the value in s; NaN before the first one. */
umo_real umo_time(const umo_object *o)
{
    return o->time == UMO_NEVER ? (umo_real)NAN : (umo_real)o->time * o->core->plan->period;
}

static umo_fault check(umo_object *o, uint32_t accept_mask)
{
    uint32_t accepted = accept_mask | 1u << UMO_GOOD | 1u << UMO_STALE;
    return accepted >> o->quality & 1u ? UMO_OK : umo_failed(o, UMO_BAD_INPUT);
}

umo_fault umo_value_of(umo_object *o, uint32_t accept_mask, umo_real *out)
{
    *out = o->value;
    return check(o, accept_mask);
}

umo_fault umo_state_of(umo_object *o, uint32_t accept_mask, uint8_t *out)
{
    umo_fault fault = umo_binary_read(o, out);
    return fault ? fault : check(o, accept_mask);
}

umo_fault umo_velocity(umo_object *o, umo_real *out)
{
    if (o->quality == UMO_BAD)
        return umo_failed(o, UMO_BAD_INPUT);
    *out = o->conditioning ? o->conditioning->velocity : 0;
    return UMO_OK;
}

/* Actuators ---------------------------------------------------------------------------------------------- */

/* CommandStage.accept: whether a value within the range is taken. */
umo_fault umo_command(umo_object *o, umo_real value, bool *taken)
{
    umo_output *output = o->output;
    *taken = false;
    if (value != o->traits->rest) {
        if (output->stopping)
            return umo_failed(o, UMO_INTERLOCKED);
        if (output->inhibited)
            return UMO_OK;
    }
    output->written = o->core->number;
    output->pending = value;
    *taken = true;
    if (is(o, UMO_ASYNCHRONOUS))
        umo_send(o);
    return UMO_OK;
}

umo_fault umo_digital_write(umo_object *o, umo_real value, bool *taken)
{
    umo_real minimum = o->traits->minimum, maximum = o->traits->maximum;
    if (minimum <= value && value <= maximum)
        return umo_command(o, value, taken);
    *taken = false;
    if (!isfinite(value))
        return umo_failed(o, UMO_NOT_FINITE);
    if (!is(o, UMO_CLAMPS))
        return umo_failed(o, UMO_OUTSIDE);
    umo_fault fault = umo_command(o, value < minimum ? minimum : maximum, taken);
    *taken = false;
    return fault;
}

umo_fault umo_binary_write(umo_object *o, uint8_t number, bool *taken)
{
    *taken = false;
    if (number > 1)
        return umo_failed(o, UMO_NO_STATE);
    return umo_command(o, number == o->traits->one ? 1 : 0, taken);
}

umo_real umo_pending(const umo_object *o)
{
    return o->output->pending;
}

uint8_t umo_pending_state(const umo_object *o)
{
    return state(o, o->output->pending);
}

umo_real umo_minimum(const umo_object *o)
{
    return o->traits->minimum;
}

umo_real umo_maximum(const umo_object *o)
{
    return o->traits->maximum;
}

umo_real umo_resolution(const umo_object *o)
{
    return o->traits->resolution;
}

umo_real umo_default(const umo_object *o)
{
    return o->traits->rest;
}

uint8_t umo_default_state(const umo_object *o)
{
    return state(o, o->traits->rest);
}

umo_real umo_slew_rate(const umo_object *o)
{
    return o->traits->slew_rate;
}

bool umo_has_slew_rate(const umo_object *o)
{
    return o->traits->slew_rate < (umo_real)INFINITY;
}

bool umo_inhibited(const umo_object *o)
{
    return o->output->inhibited;
}

umo_fault umo_object_reset(umo_object *o)
{
    if (o->output)
        umo_rest(o);
    return UMO_OK;
}

/* Homing ------------------------------------------------------------------------------------------------- */

#define MAX_OFFSET_RAW (umo_real)4611686018427387904.0 /* the largest zero offset in raw integers */

/* ImageInputs.set_referenced */
void umo_referenced(umo_object *o, bool known)
{
    o->base = known ? UMO_GOOD : UMO_UNREFERENCED;
    bool held = o->traits->max_age >= 0 && o->time < o->core->number;
    if (o->quality != UMO_BAD && !(held && known))
        o->quality = umo_judge(o, o->value);
    else if (o->quality == UMO_UNREFERENCED)
        o->quality = UMO_STALE;
}

/* ImageInputs.set_reading: the zero offset becomes such that the last reading is this value. */
umo_fault umo_set_reading(umo_object *o, umo_real value)
{
    umo_real resolution = o->traits->resolution, reading = o->value;
    umo_conditioning *of = o->conditioning;
    if (!isfinite(value))
        return umo_failed(o, UMO_NOT_FINITE);
    if (o->quality == UMO_BAD)
        return umo_failed(o, UMO_BAD_INPUT);
    if (of && of->has_reading)
        reading = of->reading;
    umo_real raw = umo_round_even(umo_to_steps(reading, resolution, o->zero_offset));
    umo_real zero_offset = value - umo_to_value(raw, resolution, 0);
    if (!(umo_fabs(zero_offset) < MAX_OFFSET_RAW * umo_fabs(resolution)))
        return umo_failed(o, UMO_OUTSIDE);
    umo_shift(o, zero_offset);
    if (!of)
        o->value = umo_to_value(raw, resolution, o->zero_offset);
    return UMO_OK;
}

/* The zero offset becomes this one; the last value moves with it. */
void umo_shift(umo_object *o, umo_real zero_offset)
{
    umo_conditioning *of = o->conditioning;
    umo_real distance = zero_offset - o->zero_offset;
    o->zero_offset = zero_offset;
    o->value += distance;
    if (!of)
        return;
    of->last += distance;
    of->value += distance;
    of->reading += distance;
}

/* The machine -------------------------------------------------------------------------------------------- */

static const umo_core *core_of(const umo_machine *m)
{
    return (const umo_core *)(const void *)m; /* its first member */
}

umo_real umo_now(const umo_machine *m)
{
    return core_of(m)->now;
}

umo_real umo_dt(const umo_machine *m)
{
    return core_of(m)->dt;
}

umo_real umo_period(const umo_machine *m)
{
    return core_of(m)->plan->period;
}

int32_t umo_ticks(const umo_machine *m)
{
    return core_of(m)->ticks;
}

umo_fault umo_host_call(umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count)
{
    const umo_core *c = core_of(m);
    return c->host_call ? c->host_call(m, call, object, numbers, count) : UMO_NO_HOST;
}
