/* umo_memory.h: where umo_access.c finds the values of the atomic objects: in this controller's own memory. A command
 * is checked by umo_command. */
#ifndef UMO_MEMORY_H
#define UMO_MEMORY_H

#include "umo.h"

static inline umo_real memory_value(const umo_object *o)
{
    return o->value;
}

static inline int32_t memory_raw(const umo_object *o)
{
    return o->raw;
}

static inline uint8_t memory_quality(const umo_object *o)
{
    return o->quality;
}

static inline umo_fault memory_read(umo_object *o, umo_real *out)
{
    *out = o->value;
    return UMO_OK;
}

static inline umo_fault memory_velocity(const umo_object *o, umo_real *out)
{
    *out = o->conditioning ? o->conditioning->velocity : 0;
    return UMO_OK;
}

static inline umo_real memory_pending(const umo_object *o)
{
    return o->output->pending;
}

static inline bool memory_inhibited(const umo_object *o)
{
    return o->output->inhibited;
}

/* Whether an interlock with effect="stop" forbids this value, which raises an error. */
static inline bool memory_bars(const umo_object *o, umo_real value)
{
    return o->output->stopping && value != o->traits->rest;
}

static inline umo_fault memory_command(umo_object *o, umo_real value, bool *taken)
{
    return umo_command(o, value, taken);
}

/* A value that may not be given to its actuator; nothing was written. */
static inline umo_fault memory_refused(umo_object *o, umo_real value, umo_fault fault)
{
    (void)value;
    return umo_failed(o, fault);
}

static inline umo_fault memory_refused_many(umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n,
                                            const umo_real *values, const bool *where, bool *taken, umo_fault fault)
{
    (void)m, (void)objects, (void)n, (void)values, (void)where, (void)taken;
    return fault;
}

#ifdef UMO_GROUPS
static inline umo_real memory_group_dt(const umo_core *c, int16_t group)
{
    return c->groups[group].dt;
}

static inline int32_t memory_group_ticks(const umo_core *c, int16_t group)
{
    return c->groups[group].ticks;
}
#endif

static inline umo_fault memory_host_call(
    umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count)
{
    const umo_core *c = (const umo_core *)(const void *)m; /* its first member */
    return c->host_call ? c->host_call(m, call, object, numbers, count) : UMO_NO_HOST;
}

#endif
