/* umo_driver.h: what a driver offers to have its transfers made in C (umo.drivers.optional.MovesInC). */
#ifndef UMO_DRIVER_H
#define UMO_DRIVER_H

#include <stdint.h>

enum {
    UMO_MOVED = 0,        /* all raw integers were moved */
    UMO_INTERRUPTED = -1, /* of a timer: a signal has come; it is called again once that was looked at */
    UMO_BY_PYTHON = 1     /* or any other number: not now, or it has failed. Python's function is called instead, which
                             makes the whole transfer, and raises what is to be said. */
};

/* What stands in `raws` before inputs are read (UNREAD of umo.drivers). What is left of it was not read. */
#define UMO_UNREAD (-0x7EAD7EAD7EAD7EADLL)

/* Moves the raw integers of `count` channels, in the order in which they were given: into `raws` for inputs, out of it
 * for outputs. `context` is the driver's own.
 *
 * It may be called again in the same period, by Python's function too: reading takes nothing away from the circuit, and
 * the same levels written twice are the same levels. It returns within the driver's timeout, and calls nothing of
 * Python's. A timer, which may wait for its tick, is called without Python's lock. */
typedef int32_t umo_transfer(void *context, int64_t *raws, int32_t count);

#endif
