/* main_io.h: the machine of a loop, and its transfers to and from the board. */
#ifndef MAIN_IO_H
#define MAIN_IO_H

#include "io.h"

static umo_machine machine;
static int32_t raws_in[MACHINE_INPUTS + 1], raws_out[MACHINE_OUTPUTS + 1];
static uint8_t failed_in[MACHINE_INPUTS + 1], failed_out[MACHINE_OUTPUTS + 1];

static void read_inputs(void)
{
    for (int16_t place = 0; place < MACHINE_INPUTS; place++)
        failed_in[place] = 0;
    io_read(raws_in, failed_in);
}

/* Once more where a failure has put equipment in fault: its actuators go to their defaults. */
static umo_fault write_outputs(void)
{
    umo_fault fault;
    do {
        for (int16_t place = 0; place < MACHINE_OUTPUTS; place++)
            failed_out[place] = !io_write(place, raws_out[place]);
        fault = machine_sent(&machine, failed_out);
    } while (!fault && machine.core.changed);
    return fault;
}

static void write_defaults(void)
{
    machine_stop(&machine, raws_out);
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++)
        (void)io_write(machine_stop_order[i], raws_out[machine_stop_order[i]]);
}

#endif
