/* io_board.c: the circuits of the controller. Fill in each function; umo new controller does not write over it. */
#include "io.h"

bool io_begin(void)
{
    /* Outputs at their defaults first. */
    return true;
}

void io_watchdog(void)
{
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    (void)raws_in;
    for (int16_t place = 0; place < MACHINE_INPUTS; place++)
        failed_in[place] = 1; /* nothing is read yet */
}

bool io_write(int16_t place, int32_t raw)
{
    (void)place;
    (void)raw;
    return false; /* nothing is written yet */
}

void io_fault(umo_fault fault, int16_t object)
{
    (void)fault;
    (void)object;
}
