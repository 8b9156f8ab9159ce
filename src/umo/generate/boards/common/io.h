/* io.h: what machine.c needs of a board. Places are those of machine.h. */
#ifndef IO_H
#define IO_H

#include "machine.h"

/* Outputs at their defaults first, then inputs, the tick and the rest. False: the watchdog has ended the last run. */
bool io_begin(void);

/* Arms the watchdog, and feeds it: once a period, and never from an interrupt. */
void io_watchdog(void);

/* Waits for the next tick of MACHINE_PERIOD. Ticks since the last call: 1 in time, 3 where two were missed. Below 0: the
 * program is to end; only with a host, main_link.c, on a computer. */
int32_t io_wait(void);

/* Every input; failed_in[place] = 1 where one could not be read (it is 0 before). */
void io_read(int32_t *raws_in, uint8_t *failed_in);

/* One output. False: the circuit did not take it. */
bool io_write(int16_t place, int32_t raw);

/* The machine stands still with its outputs at their defaults, because of this fault; faults.json tells its meaning.
 * `object` is the slot in machine.h of the object that has failed, -1 where it is none. */
void io_fault(umo_fault fault, int16_t object);

/* The watchdog has ended the last run: the machine does not start by itself. */
#define IO_WATCHDOG (-1)

#endif
