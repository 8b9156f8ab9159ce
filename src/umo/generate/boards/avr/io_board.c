/* io_board.c: the circuits of your board. Fill in each function; umo new controller does not write over it. */
#include "io.h"

bool io_begin(void)
{
    /* Outputs at their defaults first. Then inputs, a timer of MACHINE_PERIOD, and why the last run has ended. */
    return true;
}

void io_watchdog(void)
{
    /* Arm the watchdog (a few periods) at the first call, feed it at each. A reset brings the pins to what io_begin
     * gives them; where that may take too long, pull-down resistors do. */
}

int32_t io_wait(void)
{
    /* Sleep (sleep_mode) until the timer has ticked; the ticks since the last call. */
    return 1;
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
    /* A lamp, or a line on a serial port. */
    (void)fault;
    (void)object;
}
