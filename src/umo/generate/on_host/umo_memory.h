/* umo_memory.h: where umo_access.c finds the values of the atomic objects beside Python: in Python's own memory
 * (umo.cycle.columns). What is not the plain case is done by Python: it writes the object, as control code does. */
#ifndef UMO_MEMORY_H
#define UMO_MEMORY_H

#include "umo_columns.h"

static inline int32_t slot(const umo_object *o)
{
    return (int32_t)(o - o->core->objects);
}

static inline umo_real memory_value(const umo_object *o)
{
    return columns_of(o->core)->values[slot(o)];
}

static inline int32_t memory_raw(const umo_object *o)
{
    return (int32_t)columns_of(o->core)->raws[slot(o)];
}

static inline uint8_t memory_quality(const umo_object *o)
{
    return columns_of(o->core)->quality[slot(o)];
}

/* An asynchronous sensor is read from the hardware, now. */
static inline umo_fault memory_read(umo_object *o, umo_real *out)
{
    if ((o->traits->flags & (UMO_ASYNCHRONOUS | UMO_OUTPUT)) == UMO_ASYNCHRONOUS)
        return columns_of(o->core)->read_now(slot(o), out);
    *out = memory_value(o);
    return UMO_OK;
}

static inline umo_fault memory_velocity(const umo_object *o, umo_real *out)
{
    return columns_of(o->core)->velocity(slot(o), out);
}

static inline umo_real memory_pending(const umo_object *o)
{
    return columns_of(o->core)->pending[slot(o)];
}

static inline bool memory_inhibited(const umo_object *o)
{
    uint8_t restriction = columns_of(o->core)->restrictions[slot(o)];
    return restriction != UMO_FREE && restriction != UMO_ASKED;
}

/* Whether Python is asked about a command. */
static inline bool memory_bars(const umo_object *o, umo_real value)
{
    (void)value;
    return columns_of(o->core)->restrictions[slot(o)] != UMO_FREE;
}

static umo_fault asked(umo_object *o, umo_real value, bool *taken)
{
    umo_fault fault = columns_of(o->core)->write(slot(o), value, taken);
    return fault ? umo_failed(o, fault) : UMO_OK;
}

/* As Writes_write of umo.cycle._columns, of what is not restricted. */
static inline void put(umo_columns *c, int32_t slot, umo_real value)
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

static inline umo_fault memory_command(umo_object *o, umo_real value, bool *taken)
{
    if (memory_bars(o, value))
        return asked(o, value, taken);
    put(columns_of(o->core), slot(o), value);
    *taken = true;
    return UMO_OK;
}

/* Python raises its own error; nothing was written. */
static inline umo_fault memory_refused(umo_object *o, umo_real value, umo_fault fault)
{
    bool taken;
    umo_fault told = asked(o, value, &taken);
    return told ? told : umo_failed(o, fault);
}

static inline umo_fault memory_refused_many(umo_machine *m, const int16_t *objects, int16_t n, const umo_real *values,
                                            const bool *where, bool *taken, umo_fault fault)
{
    const umo_core *c = (const umo_core *)(const void *)m; /* its first member */
    (void)fault;                                           /* what bars a command here may also admit it */
    return columns_of(c)->write_many(objects, n, values, where, taken);
}

static inline umo_real memory_group_dt(const umo_core *c, int16_t group)
{
    return columns_of(c)->groups[group][0];
}

static inline int32_t memory_group_ticks(const umo_core *c, int16_t group)
{
    return (int32_t)columns_of(c)->groups[group][1];
}

static inline umo_fault memory_host_call(
    umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count)
{
    const umo_core *c = (const umo_core *)(const void *)m; /* its first member */
    (void)object;
    return columns_of(c)->host_call(call, numbers, count);
}

#endif
