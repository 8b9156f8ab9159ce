/* umo_columns.c: what laws ask of the atomic objects where they run beside Python: its own memory (umo.cycle.columns).
 * What is not the plain case is done by Python: it writes the object, as control code does. */
#include "umo_columns.h"

static umo_columns *columns_of(const umo_core *c)
{
    return (umo_columns *)(void *)c->outputs; /* it has no umo_output of its own */
}

static int32_t slot(const umo_object *o)
{
    return (int32_t)(o - o->core->objects);
}

umo_fault umo_failed(umo_object *o, umo_fault fault)
{
    o->core->fault_object = (int16_t)slot(o);
    return fault;
}

static bool is(const umo_object *o, uint8_t flag)
{
    return (o->traits->flags & flag) != 0;
}

/* Sensors ------------------------------------------------------------------------------------------------ */

umo_real umo_value(const umo_object *o)
{
    return columns_of(o->core)->values[slot(o)];
}

int32_t umo_raw(const umo_object *o)
{
    return (int32_t)columns_of(o->core)->raws[slot(o)];
}

uint8_t umo_quality(const umo_object *o)
{
    return columns_of(o->core)->quality[slot(o)];
}

/* An asynchronous sensor is read from the hardware, now. */
umo_fault umo_digital_read(umo_object *o, umo_real *out)
{
    if (is(o, UMO_ASYNCHRONOUS) && !is(o, UMO_OUTPUT))
        return columns_of(o->core)->read_now(slot(o), out);
    *out = umo_value(o);
    return UMO_OK;
}

static uint8_t state(const umo_object *o, umo_real level)
{
    uint8_t one = o->traits->one;
    return level != 0 ? one : (uint8_t)(1 - one);
}

umo_fault umo_binary_read(umo_object *o, uint8_t *out)
{
    umo_real level;
    umo_fault fault = umo_digital_read(o, &level);
    if (fault)
        return fault;
    if (!is(o, UMO_OUTPUT) && level != 0 && level != 1)
        return umo_failed(o, UMO_NEVER_READ);
    *out = state(o, level);
    return UMO_OK;
}

static umo_fault check(umo_object *o, uint32_t accept_mask)
{
    uint32_t accepted = accept_mask | 1u << UMO_GOOD | 1u << UMO_STALE;
    return accepted >> umo_quality(o) & 1u ? UMO_OK : umo_failed(o, UMO_BAD_INPUT);
}

umo_fault umo_value_of(umo_object *o, uint32_t accept_mask, umo_real *out)
{
    umo_fault fault = umo_digital_read(o, out);
    return fault ? fault : check(o, accept_mask);
}

umo_fault umo_state_of(umo_object *o, uint32_t accept_mask, uint8_t *out)
{
    umo_fault fault = umo_binary_read(o, out);
    return fault ? fault : check(o, accept_mask);
}

umo_fault umo_velocity(umo_object *o, umo_real *out)
{
    return columns_of(o->core)->velocity(slot(o), out);
}

/* Actuators ---------------------------------------------------------------------------------------------- */

static umo_fault asked(umo_object *o, umo_real value, bool *taken)
{
    umo_fault fault = columns_of(o->core)->write(slot(o), value, taken);
    return fault ? umo_failed(o, fault) : UMO_OK;
}

/* As Writes_write of umo.cycle._columns, of what is not restricted. */
static void put(umo_columns *c, int32_t slot, umo_real value)
{
    if (c->written && c->owners[slot] != *c->law) {
        if (c->pending[slot] == value)
            c->written[slot] |= UMO_UNSEEN;
        else if (c->written[slot] < UMO_TOLD)
            c->changed(slot, value);
        c->owners[slot] = *c->law;
    }
    if (c->written)
        c->written[slot] |= UMO_NOW;
    c->pending[slot] = value;
}

umo_fault umo_digital_write(umo_object *o, umo_real value, bool *taken)
{
    umo_columns *c = columns_of(o->core);
    const umo_traits *of = o->traits;
    bool inside = of->minimum <= value && value <= of->maximum;
    *taken = inside;
    if (c->restrictions[slot(o)] || !(inside || (is(o, UMO_CLAMPS) && isfinite(value))))
        return asked(o, value, taken);
    put(c, slot(o), inside ? value : value < of->minimum ? of->minimum : of->maximum);
    return UMO_OK;
}

umo_fault umo_binary_write(umo_object *o, uint8_t number, bool *taken)
{
    umo_columns *c = columns_of(o->core);
    umo_real level = number == o->traits->one ? 1 : 0;
    *taken = true;
    if (c->restrictions[slot(o)])
        return asked(o, level, taken);
    put(c, slot(o), level);
    return UMO_OK;
}

umo_real umo_pending(const umo_object *o)
{
    return columns_of(o->core)->pending[slot(o)];
}

uint8_t umo_pending_state(const umo_object *o)
{
    return state(o, umo_pending(o));
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
    uint8_t restriction = columns_of(o->core)->restrictions[slot(o)];
    return restriction != UMO_FREE && restriction != UMO_ASKED;
}

/* Vectors ------------------------------------------------------------------------------------------------ */

umo_fault umo_values_of(
    umo_machine *m, const int16_t *objects, int16_t n, uint32_t accept_mask, const bool *where, umo_real *out)
{
    umo_core *c = (umo_core *)(void *)m;
    for (int16_t i = 0; i < n; i++)
        out[i] = umo_value(&c->objects[objects[i]]);
    for (int16_t i = 0; i < n; i++) {
        umo_fault fault = !where || where[i] ? check(&c->objects[objects[i]], accept_mask) : UMO_OK;
        if (fault)
            return fault;
    }
    return UMO_OK;
}

/* Vector.write. Python does it where one is restricted or refused. */
umo_fault umo_write_many(
    umo_machine *m, const int16_t *objects, int16_t n, const umo_real *values, const bool *where, bool *taken)
{
    umo_core *core = (umo_core *)(void *)m;
    umo_columns *c = columns_of(core);
    *taken = true;
    for (int16_t i = 0; i < n; i++) {
        const umo_traits *of = core->objects[objects[i]].traits;
        bool chosen = !where || where[i], binary = (of->flags & UMO_BINARY) != 0;
        bool inside = binary ? values[i] == 0 || values[i] == 1
                             : !chosen || (of->minimum <= values[i] && values[i] <= of->maximum);
        bool clamped = (of->flags & UMO_CLAMPS) != 0 && isfinite(values[i]);
        if ((chosen && c->restrictions[objects[i]]) || !(inside || clamped))
            return c->write_many(objects, n, values, where, taken);
        *taken = *taken && inside;
    }
    for (int16_t i = 0; i < n; i++) {
        const umo_traits *of = core->objects[objects[i]].traits;
        if (where && !where[i])
            continue;
        umo_real value = values[i];
        if (!(of->flags & UMO_BINARY))
            value = value < of->minimum ? of->minimum : value > of->maximum ? of->maximum : value;
        put(c, objects[i], value);
    }
    return UMO_OK;
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
    (void)object;
    return columns_of(core_of(m))->host_call(call, numbers, count);
}
