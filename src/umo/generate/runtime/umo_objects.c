/* umo_objects.c: what a controller does with its own objects besides what umo_access.c reads and writes: commands,
 * checked as by umo.cycle.command_stage, the times of values, and homing. */
#include "umo_memory.h"

/* CommandStage.accept: whether a value within the range is taken. */
umo_fault umo_command(umo_object *o, umo_real value, bool *taken)
{
    umo_output *output = o->output;
    *taken = false;
    if (memory_bars(o, value))
        return umo_failed(o, UMO_INTERLOCKED);
    if (output->inhibited && value != o->traits->rest)
        return UMO_OK;
    output->written = o->core->number;
    output->pending = value;
    *taken = true;
    if (o->traits->flags & UMO_ASYNCHRONOUS)
        umo_send(o);
    return UMO_OK;
}

/* Time of the value in s; NaN before the first one. */
umo_real umo_time(const umo_object *o)
{
    return o->time == UMO_NEVER ? (umo_real)NAN : (umo_real)o->time * o->core->plan->period;
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
