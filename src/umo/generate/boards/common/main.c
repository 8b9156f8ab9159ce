/* main.c: the loop of a generated controller. Outputs are at their defaults before it and after it: at power-up, at a
 * fault, and after the watchdog has ended a run that hung. Then they stay there until the power is switched off. */
#include "io.h"

#ifdef ARDUINO /* the sketch calls it */
int umo_main(void);
#define main umo_main
#endif

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

static umo_fault begin(void)
{
    read_inputs();
    umo_fault fault = machine_begin(&machine, raws_in, failed_in, raws_out);
    return fault ? fault : write_outputs();
}

static umo_fault period(void)
{
    int32_t ticks = io_wait();
    read_inputs();
    umo_fault fault = machine_step(&machine, ticks, raws_in, failed_in, raws_out);
    return fault ? fault : write_outputs();
}

int main(void)
{
    bool in_order = io_begin();
    machine_init(&machine);
    write_defaults();
    io_watchdog();
    umo_fault fault = in_order ? begin() : IO_WATCHDOG;
    while (!fault) {
        fault = period();
        io_watchdog();
    }
    write_defaults();
    io_fault(fault, machine.core.fault_object);
    for (;;) { /* again and again: a circuit may not have taken them */
        (void)io_wait();
        write_defaults();
        io_watchdog();
    }
}
