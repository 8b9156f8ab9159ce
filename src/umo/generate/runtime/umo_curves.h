/* umo_curves.h: the one place in C where a linearization is evaluated, of umo's own columns (cycle/columns.c) and of
 * controllers. As objects/interpolation.py: the same operations in the same order. Whoever includes it has `umo_real`,
 * `umo_floor` and UMO_FLASH, and is compiled with -ffp-contract=off. */
#ifndef UMO_CURVES_H
#define UMO_CURVES_H

#include <stdbool.h>
#include <stdint.h>

/* A linearization: linear between points, or cubics in equal cells. */
typedef struct {
    bool cubic;
    int32_t count;           /* points, or cells */
    umo_real first, per_x;   /* of cubics: the first point; cells for one unit of x */
    const UMO_FLASH umo_real *table; /* xs, ys, slopes; or five columns of count + 2 cells */
} umo_curve;

/* Segments.one */
static inline umo_real umo_on_segments(const UMO_FLASH umo_curve *curve, umo_real x)
{
    int32_t count = curve->count, i = 0, end = count - 2;
    const UMO_FLASH umo_real *xs = curve->table, *ys = xs + count, *slopes = ys + count;
    while (i < end) { /* bisect_right in the inner points */
        int32_t middle = (i + end) / 2;
        if (x < xs[middle + 1])
            end = middle;
        else
            i = middle + 1;
    }
    return ys[i] + slopes[i] * (x - xs[i]);
}

/* Cubics.one */
static inline umo_real umo_on_cubics(const UMO_FLASH umo_curve *curve, umo_real x)
{
    umo_real cells = (umo_real)curve->count, place = (x - curve->first) * curve->per_x;
    place = place > -1 ? place : -1;
    place = place < cells ? place : cells;
    int32_t row = (int32_t)(umo_floor(place) + 1), rows = curve->count + 2;
    const UMO_FLASH umo_real *at = curve->table + row;
    umo_real away = x - at[0];
    return ((at[4 * rows] * away + at[3 * rows]) * away + at[2 * rows]) * away + at[rows];
}

static inline umo_real umo_on_curve(const UMO_FLASH umo_curve *curve, umo_real x)
{
    return curve->cubic ? umo_on_cubics(curve, x) : umo_on_segments(curve, x);
}

#endif
