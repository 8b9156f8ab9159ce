/* umo_access.c: what translated code asks of the atomic objects, as umo.objects.sensors, umo.objects.actuators,
 * umo.objects.vector and umo.control.inputs do. One source for controllers and for laws that are compiled beside Python:
 * umo_memory.h says where the values are, and what a command needs besides the range of its actuator. */
#include "umo_memory.h"

umo_fault umo_failed(umo_object *o, umo_fault fault)
{
    o->core->fault_object = (int16_t)(o - o->core->objects);
    return fault;
}

static bool is(const umo_object *o, uint8_t flag)
{
    return (o->traits->flags & flag) != 0;
}

static umo_object *object(umo_machine *m, int16_t number)
{
    umo_core *c = (umo_core *)(void *)m; /* its first member */
    return &c->objects[number];
}

/* Sensors ------------------------------------------------------------------------------------------------ */

umo_real umo_value(const umo_object *o)
{
    return memory_value(o);
}

int32_t umo_raw(const umo_object *o)
{
    return memory_raw(o);
}

uint8_t umo_quality(const umo_object *o)
{
    return memory_quality(o);
}

umo_fault umo_digital_read(umo_object *o, umo_real *out)
{
    return memory_read(o, out);
}

static uint8_t state(const umo_object *o, umo_real level)
{
    uint8_t one = o->traits->one;
    return level != 0 ? one : (uint8_t)(1 - one);
}

umo_fault umo_binary_read(umo_object *o, uint8_t *out)
{
    umo_real level;
    umo_fault fault = memory_read(o, &level);
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
    return accepted >> memory_quality(o) & 1u ? UMO_OK : umo_failed(o, UMO_BAD_INPUT);
}

umo_fault umo_value_of(umo_object *o, uint32_t accept_mask, umo_real *out)
{
    umo_fault fault = memory_read(o, out);
    return fault ? fault : check(o, accept_mask);
}

umo_fault umo_state_of(umo_object *o, uint32_t accept_mask, uint8_t *out)
{
    umo_fault fault = umo_binary_read(o, out);
    return fault ? fault : check(o, accept_mask);
}

umo_fault umo_velocity(umo_object *o, umo_real *out)
{
    if (memory_quality(o) == UMO_BAD)
        return umo_failed(o, UMO_BAD_INPUT);
    return memory_velocity(o, out);
}

/* value_of of a Vector: all values, and the quality of those that `where` chooses; NULL: of all. */
umo_fault umo_values_of(
    umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n, uint32_t accept_mask, const bool *where, umo_real *out)
{
    for (int16_t i = 0; i < n; i++)
        out[i] = memory_value(object(m, objects[i]));
    for (int16_t i = 0; i < n; i++) {
        umo_fault fault = !where || where[i] ? check(object(m, objects[i]), accept_mask) : UMO_OK;
        if (fault)
            return fault;
    }
    return UMO_OK;
}

/* Actuators ---------------------------------------------------------------------------------------------- */

static umo_real clamped(const umo_object *o, umo_real value)
{
    umo_real minimum = o->traits->minimum, maximum = o->traits->maximum;
    if (is(o, UMO_BINARY))
        return value;
    return value < minimum ? minimum : value > maximum ? maximum : value;
}

/* Whether a value may be given to an actuator: it is within its range, or clamped to it. */
static umo_fault judge(const umo_object *o, umo_real value, bool *inside)
{
    const UMO_FLASH umo_traits *of = o->traits;
    *inside = of->minimum <= value && value <= of->maximum;
    if (*inside)
        return UMO_OK;
    if (!isfinite(value))
        return UMO_NOT_FINITE;
    return is(o, UMO_CLAMPS) ? UMO_OK : UMO_OUTSIDE;
}

umo_fault umo_digital_write(umo_object *o, umo_real value, bool *taken)
{
    bool inside;
    umo_fault fault = judge(o, value, &inside);
    *taken = false;
    if (fault)
        return memory_refused(o, value, fault);
    if (inside)
        return memory_command(o, value, taken);
    fault = memory_command(o, clamped(o, value), taken);
    *taken = false;
    return fault;
}

umo_fault umo_binary_write(umo_object *o, uint8_t number, bool *taken)
{
    *taken = false;
    if (number > 1)
        return umo_failed(o, UMO_NO_STATE);
    return memory_command(o, number == o->traits->one ? 1 : 0, taken);
}

/* As judge, of an element of a Vector. Binary actuators take 0 and 1, also where the element is not chosen; any other
 * number is right there. */
static umo_fault judge_element(const umo_object *o, umo_real value, bool chosen, bool *inside)
{
    *inside = true;
    if (is(o, UMO_BINARY))
        return value == 0 || value == 1 ? UMO_OK : UMO_NO_STATE;
    return chosen ? judge(o, value, inside) : UMO_OK;
}

/* Vector.write: all, or none if one is refused. */
umo_fault umo_write_many(
    umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n, const umo_real *values, const bool *where, bool *taken)
{
    bool all = true;
    *taken = false;
    for (int16_t i = 0; i < n; i++) {
        bool inside;
        umo_object *o = object(m, objects[i]);
        umo_fault fault = judge_element(o, values[i], !where || where[i], &inside);
        if (fault)
            return memory_refused_many(m, objects, n, values, where, taken, umo_failed(o, fault));
        all = all && inside;
    }
    for (int16_t i = 0; i < n; i++) { /* CommandStage.admits: before anything is written */
        umo_object *o = object(m, objects[i]);
        if ((!where || where[i]) && memory_bars(o, clamped(o, values[i])))
            return memory_refused_many(m, objects, n, values, where, taken, umo_failed(o, UMO_INTERLOCKED));
    }
    for (int16_t i = 0; i < n; i++) {
        bool one = true;
        umo_object *o = object(m, objects[i]);
        if (!where || where[i])
            (void)memory_command(o, clamped(o, values[i]), &one);
        all = all && one;
    }
    *taken = all;
    return UMO_OK;
}

umo_real umo_pending(const umo_object *o)
{
    return memory_pending(o);
}

uint8_t umo_pending_state(const umo_object *o)
{
    return state(o, memory_pending(o));
}

bool umo_inhibited(const umo_object *o)
{
    return memory_inhibited(o);
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

#ifdef UMO_GROUPS
umo_real umo_group_dt(const umo_machine *m, int16_t group)
{
    return memory_group_dt(core_of(m), group);
}

int32_t umo_group_ticks(const umo_machine *m, int16_t group)
{
    return memory_group_ticks(core_of(m), group);
}
#endif

umo_fault umo_host_call(umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count)
{
    return memory_host_call(m, call, object, numbers, count);
}
