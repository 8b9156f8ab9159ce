/* io_link.c: the serial line to the host. Fill in each function. */
#include "umo_link.h"

void link_begin(void)
{
    /* The port, its rate, and its interrupts. */
}

int link_get(void)
{
    /* The next byte that has come in, from a buffer that the interrupt of the line fills; it has room for what comes
     * in a period. */
    return -1;
}

void link_put(uint8_t byte)
{
    /* Into a buffer that the interrupt of the line, or io_wait, sends from; what does not fit is left out. */
    (void)byte;
}

void link_end(void)
{
    /* A frame is whole. */
}
