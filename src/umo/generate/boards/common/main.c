/* main.c: the loop of a generated controller. Outputs are at their defaults before it and after it: at power-up, at a
 * fault, and after the watchdog has ended a run that hung. Then they stay there until the power is switched off. */
#include "main_io.h"

#ifdef ARDUINO /* the sketch calls it */
int umo_main(void);
#define main umo_main
#endif

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
