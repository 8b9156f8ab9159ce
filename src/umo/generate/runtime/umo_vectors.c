/* umo_vectors.c: many objects at once, as umo.objects.vector and value_of of umo.control do. */
#include "umo_python.h"

static umo_object *object(umo_machine *m, int16_t number)
{
    umo_core *c = (umo_core *)(void *)m; /* its first member */
    return &c->objects[number];
}

/* value_of of a Vector: all values, and the quality of those that `where` chooses; NULL: of all. */
umo_fault umo_values_of(
    umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n, uint32_t accept_mask, const bool *where, umo_real *out)
{
    for (int16_t i = 0; i < n; i++)
        out[i] = object(m, objects[i])->value;
    for (int16_t i = 0; i < n; i++) {
        umo_real ignored;
        umo_fault fault = !where || where[i] ? umo_value_of(object(m, objects[i]), accept_mask, &ignored) : UMO_OK;
        if (fault)
            return fault;
    }
    return UMO_OK;
}

/* Whether a value is within the range of its actuator, or clamped to it; binary ones take 0 and 1. */
static umo_fault check(umo_object *o, umo_real value, bool chosen, bool *inside)
{
    const UMO_FLASH umo_traits *of = o->traits;
    if (of->flags & UMO_BINARY)
        return value == 0 || value == 1 ? UMO_OK : UMO_NO_STATE;
    if (!chosen || (of->minimum <= value && value <= of->maximum))
        return UMO_OK;
    *inside = false;
    if (!isfinite(value))
        return umo_failed(o, UMO_NOT_FINITE);
    return of->flags & UMO_CLAMPS ? UMO_OK : umo_failed(o, UMO_OUTSIDE);
}

static umo_real clamped(const umo_object *o, umo_real value)
{
    if (value < o->traits->minimum)
        return o->traits->minimum;
    return value > o->traits->maximum ? o->traits->maximum : value;
}

/* Vector.write: all, or none if one is refused. */
umo_fault umo_write_many(
    umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n, const umo_real *values, const bool *where, bool *taken)
{
    bool all = true;
    *taken = false;
    for (int16_t i = 0; i < n; i++) {
        umo_fault fault = check(object(m, objects[i]), values[i], !where || where[i], &all);
        if (fault)
            return fault;
    }
    for (int16_t i = 0; i < n; i++) { /* Command.admits: before anything is written */
        umo_object *o = object(m, objects[i]);
        if ((!where || where[i]) && o->output->stopping && clamped(o, values[i]) != o->traits->rest)
            return umo_failed(o, UMO_INTERLOCKED);
    }
    for (int16_t i = 0; i < n; i++) {
        bool one = true;
        umo_object *o = object(m, objects[i]);
        if (!where || where[i])
            (void)umo_command(o, clamped(o, values[i]), &one);
        all = all && one;
    }
    *taken = all;
    return UMO_OK;
}
