/* main_link.c: the loop of a controller whose application is on a host. Outputs are at their defaults before the host
 * starts it, after a fault, and when the host is gone and the axes stand: the loop goes on, and answers. */
#include "main_io.h"
#include "umo_link.h"

#ifdef ARDUINO /* the sketch calls it */
int umo_main(void);
#define main umo_main
#endif

umo_link machine_link; /* a board may show its mode */

static void step(int32_t ticks)
{
    umo_fault fault = machine_step(&machine, ticks, raws_in, failed_in, raws_out);
    if (!fault)
        fault = write_outputs();
    if (!fault)
        return;
    machine_link.fault = fault;
    machine_link.fault_object = machine.core.fault_object;
    machine_link.mode = LINK_FAULTED;
    io_fault(fault, machine_link.fault_object);
}

int main(void)
{
    bool in_order = io_begin();
    link_begin();
    machine_init(&machine);
    umo_link_begin(&machine_link, &machine, raws_in, failed_in, raws_out);
    write_defaults();
    io_watchdog();
    if (!in_order) {
        machine_link.mode = LINK_FAULTED;
        machine_link.fault = IO_WATCHDOG;
    }
    for (;;) {
        int32_t ticks = io_wait();
        if (ticks < 0)
            break;
        read_inputs();
        umo_link_receive(&machine_link);
        bool runs = umo_link_count(&machine_link, ticks);
        if (runs)
            step(ticks);
        if (!runs || machine_link.mode == LINK_FAULTED)
            write_defaults();
        umo_link_answer(&machine_link);
        io_watchdog();
    }
    write_defaults();
    return 0;
}
