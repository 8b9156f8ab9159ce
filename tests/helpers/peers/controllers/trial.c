/* trial.c: in the place of a controller's main.c: goes on after a fault, and begins each line out with its number. A line without
 * ticks acknowledges. */
#include "io.h"
#include "lines.h"

static umo_machine machine;
static int32_t raws_in[MACHINE_INPUTS + 1], raws_out[MACHINE_OUTPUTS + 1];
static uint8_t failed_in[MACHINE_INPUTS + 1];

static void answer(umo_fault fault)
{
#ifndef UMO_GROUPS
    line_mark(false);
#endif
    while (!fault) { /* parts with rates of their own act here */
        fault = machine_sent(&machine, NULL);
        if (!machine.core.changed)
            break;
    }
    line_mark(false);
    line_put((char)('0' + fault / 10));
    line_put((char)('0' + fault % 10));
    line_put(' ');
    for (int16_t place = 0; place < MACHINE_OUTPUTS; place++)
        (void)io_write(place, raws_out[place]);
}

int main(void)
{
    (void)io_begin();
    machine_init(&machine);
    io_read(raws_in, failed_in);
    answer(machine_begin(&machine, raws_in, failed_in, raws_out));
    for (;;) {
        int32_t ticks = io_wait();
        io_read(raws_in, failed_in);
        if (ticks)
            answer(machine_step(&machine, ticks, raws_in, failed_in, raws_out));
        else
            machine_acknowledge(&machine);
    }
}
