/* umo_columns.h: the memory of Python that laws work on (umo.cycle.columns), and what they ask of Python. */
#ifndef UMO_COLUMNS_H
#define UMO_COLUMNS_H

#include "umo_python.h"

enum { UMO_FREE = 0, UMO_ASKED = 254 }; /* values of the column `restrictions` */
enum { UMO_NOW = 2, UMO_UNSEEN = 64, UMO_TOLD = 128 }; /* bits of the column `written` */

typedef struct {
    const double *values;
    const int64_t *raws;
    const uint8_t *quality, *restrictions;
    double *pending;
    uint8_t *written; /* NULL: who writes is not noted */
    const void **owners;
    const void *const *law; /* where Python has the law that acts */
    const double *const *groups; /* dt and ticks of parts that have a rate of their own */
    void (*changed)(int32_t slot, double value); /* another one than before writes this */
    umo_fault (*write)(int32_t slot, double value, bool *taken);
    umo_fault (*write_many)(const int16_t *slots, int16_t n, const double *values, const bool *where, bool *taken);
    umo_fault (*velocity)(int32_t slot, double *out);
    umo_fault (*read_now)(int32_t slot, double *out);
    umo_fault (*host_call)(uint16_t call, double *numbers, uint16_t count);
    umo_fault (*tell)(uint16_t number, const void *const *given); /* a text is made of these variables */
    int32_t file, line; /* where the runtime had its last fault: the number of the file; 0: nowhere yet */
} umo_columns;

static inline umo_columns *columns_of(const umo_core *c)
{
    return (umo_columns *)(void *)c->outputs; /* it has no umo_output of its own */
}

/* The fault of a call of the runtime, which this line of Python has made. */
static inline umo_fault umo_at(const umo_machine *m, int32_t file, int32_t line, umo_fault fault)
{
    const umo_core *c = (const umo_core *)(const void *)m; /* its first member */
    if (fault != UMO_OK) {
        columns_of(c)->file = file;
        columns_of(c)->line = line;
    }
    return fault;
}

static inline umo_fault umo_tell(const umo_machine *m, uint16_t number, const void *const *given)
{
    const umo_core *c = (const umo_core *)(const void *)m; /* its first member */
    return columns_of(c)->tell(number, given);
}

#endif
