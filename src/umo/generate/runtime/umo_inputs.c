/* umo_inputs.c: raw integers become values with a quality, as in umo.cycle.readings, umo.cycle.conditioning and
 * umo.objects.interpolation. */
#include "umo.h"

/* ImageInputs._is_inside */
static bool inside(const umo_object *o, umo_real value)
{
    return o->traits->low <= value && value <= o->traits->high;
}

/* ImageInputs._judge */
uint8_t umo_judge(const umo_object *o, umo_real value)
{
    return o->base != UMO_GOOD || inside(o, value) ? o->base : (uint8_t)UMO_OUT_OF_RANGE;
}

/* ImageInputs._is_refused: whether a raw integer is no reading. */
static bool refused(const umo_object *o, int32_t raw)
{
    if (o->traits->flags & UMO_BINARY)
        return raw != 0 && raw != 1;
    for (int16_t i = 0; i < o->traits->invalid_count; i++)
        if (o->traits->invalid_raws[i] == raw)
            return true;
    return false;
}

/* ImageInputs.fail_input: the last value is held for max_age, then the sensor is marked, or the period ends. */
static umo_fault fail(umo_object *o)
{
    if (o->traits->max_age >= 0 && o->time != UMO_NEVER && umo_since(o->core, o->time) <= o->traits->max_age) {
        if (o->quality == UMO_GOOD)
            o->quality = UMO_STALE;
        return UMO_OK;
    }
    o->quality = UMO_BAD;
    if (o->traits->flags & UMO_MARKS)
        return UMO_OK;
    o->failed = true;
    return UMO_UNREAD;
}

/* ImageInputs.accept */
static umo_fault accept(umo_object *o, int32_t raw)
{
    o->raw = raw;
    if (refused(o, raw))
        return fail(o);
    umo_real value = umo_to_value((umo_real)umo_count_of(o, raw), o->traits->resolution, o->zero_offset);
    if (o->traits->to_value)
        value = umo_curve_at(o->traits->to_value, value);
    bool is_inside = inside(o, value);
    if (o->conditioning)
        value = umo_conditioned(o, value, is_inside);
    o->value = value;
    o->time = o->core->number;
    o->quality = o->base != UMO_GOOD || is_inside ? o->base : (uint8_t)UMO_OUT_OF_RANGE;
    return UMO_OK;
}

/* Clock.advance: 0 missed periods after one tick, else the ticks that had passed. */
static umo_fault advance(umo_core *c, int32_t ticks)
{
    int32_t missed = ticks > 1 ? ticks : 0;
    int16_t timer = c->plan->timer;
    if (ticks < 1 || (timer >= 0 && (umo_real)missed > c->plan->traits[timer].greatest)) {
        c->fault_object = timer;
        return UMO_BAD_TICKS;
    }
    c->ticks = ticks;
    c->number += ticks;
    c->now = (umo_real)c->number * c->plan->period;
    c->dt = (umo_real)ticks * c->plan->period;
    return timer >= 0 ? accept(&c->objects[timer], missed) : UMO_OK;
}

umo_fault umo_begin_period(umo_core *c, int32_t ticks, int32_t *raws_out)
{
    c->raws_out = raws_out;
    c->fault_object = -1;
    umo_forget_raised(c); /* of a period that the machine itself has ended */
    umo_fault fault = umo_sent(c, NULL);
    return fault ? fault : advance(c, ticks);
}

static umo_fault take(umo_core *c, int16_t input, const int32_t *raws_in, const uint8_t *failed_in)
{
    umo_object *o = &c->objects[input];
    return failed_in && failed_in[input] ? fail(o) : accept(o, raws_in[input]);
}

#ifdef UMO_GROUPS
void umo_take_again(umo_core *c, int16_t input)
{
    if (c->raws_in)
        (void)take(c, input, c->raws_in, c->failed_in);
}
#endif

/* Image.sample: a failure does not stop the others; the first fault that no equipment contains is told. */
umo_fault umo_sample(umo_core *c, const int32_t *raws_in, const uint8_t *failed_in)
{
    umo_fault found = UMO_OK;
#ifdef UMO_GROUPS
    c->raws_in = raws_in;
    c->failed_in = failed_in;
#endif
    for (int16_t i = 0; i < c->plan->inputs; i++) {
        umo_object *o = &c->objects[i];
        if (!umo_moves(o))
            continue;
        umo_fault fault = take(c, i, raws_in, failed_in);
        if (fault && !umo_contains(o, fault) && !found)
            found = umo_failed(o, fault);
    }
    umo_enter_faults(c);
    return found;
}

/* Conditioning ------------------------------------------------------------------------------------------- */

static void leave(umo_conditioning *of)
{
    of->time = UMO_NEVER;
    of->has_reading = false;
    of->velocity = of->last = of->value = 0;
}

void umo_begin_conditioning(umo_conditioning *of)
{
    of->counted = of->has_level = false;
    of->since = UMO_NEVER;
    leave(of);
}

/* DigitalConditioner.count_of: by the shortest way. */
int64_t umo_count_of(umo_object *o, int32_t raw)
{
    umo_conditioning *of = o->conditioning;
    uint8_t bits = o->traits->rollover_bits;
    if (!bits)
        return raw;
    int64_t half = (int64_t)1 << (bits - 1), whole = 2 * half;
    if (of->counted) {
        int64_t way = (raw - of->count + half) % whole;
        of->count += (way < 0 ? way + whole : way) - half;
    } else {
        of->count = raw;
    }
    of->counted = true;
    return of->count;
}

#ifdef __AVR__ /* its library has none: the first terms of the series, and where they are too few exp(x) - 1 */
static umo_real expm1_of_avr(umo_real x)
{
    if (fabsf(x) > 0.1f)
        return expf(x) - 1;
    return x * (1 + x / 2 * (1 + x / 3 * (1 + x / 4 * (1 + x / 5))));
}
#undef umo_expm1
#define umo_expm1 expm1_of_avr
#endif

/* The share of a step that a low pass passes on in dt. */
static umo_real share(umo_real dt, umo_real time_constant)
{
    return time_constant != 0 ? -umo_expm1(-dt / time_constant) : 1;
}

/* DigitalConditioner.value_of */
static umo_real digital(umo_object *o, umo_real value)
{
    umo_conditioning *of = o->conditioning;
    const umo_core *c = o->core;
    umo_real filter = o->traits->filter, velocity = o->traits->velocity;
    of->reading = value;
    of->has_reading = true;
    if (of->time == UMO_NEVER) {
        of->time = c->number;
        return of->last = of->value = value;
    }
    umo_real dt = umo_since(c, of->time);
    if (dt <= 0) {
        if (filter < 0)
            of->value = value;
        return of->value;
    }
    if (velocity >= 0)
        of->velocity += share(dt, velocity) * ((value - of->last) / dt - of->velocity);
    if (filter < 0)
        of->value = value;
    else
        of->value += share(dt, filter) * (value - of->value);
    of->time = c->number;
    of->last = value;
    return of->value;
}

/* BinaryConditioner.value_of */
static umo_real binary(umo_object *o, umo_real level)
{
    umo_conditioning *of = o->conditioning;
    if (!of->has_level) {
        of->has_level = true;
        of->value = level;
    } else if (level == of->value) {
        of->since = UMO_NEVER;
    } else if (of->since == UMO_NEVER) {
        of->since = o->core->number;
    }
    if (of->since != UMO_NEVER && umo_since(o->core, of->since) >= o->traits->debounce - (umo_real)1e-9) {
        of->value = level;
        of->since = UMO_NEVER;
    }
    return of->value;
}

umo_real umo_conditioned(umo_object *o, umo_real value, bool is_inside)
{
    if (o->traits->flags & UMO_BINARY)
        return binary(o, value);
    if (is_inside)
        return digital(o, value);
    leave(o->conditioning);
    return value;
}

/* Linearization ------------------------------------------------------------------------------------------ */

umo_real umo_curve_at(const UMO_FLASH umo_curve *curve, umo_real x)
{
    return umo_on_curve(curve, x);
}
