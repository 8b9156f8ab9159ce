/* umo_scaling.h: the one place in C where raw integers and values are turned into each other, of umo's own columns
 * (cycle/columns.c) and of controllers. As objects/scaling.py: the same operations in the same order. Whoever includes
 * it has `umo_real`, and is compiled with -ffp-contract=off. */
#ifndef UMO_SCALING_H
#define UMO_SCALING_H

static inline umo_real umo_to_value(umo_real raw, umo_real resolution, umo_real zero_offset)
{
    return raw * resolution + zero_offset;
}

/* Not rounded yet: the nearest whole number, half to even, is the raw integer. */
static inline umo_real umo_to_steps(umo_real value, umo_real resolution, umo_real zero_offset)
{
    return (value - zero_offset) / resolution;
}

#endif
