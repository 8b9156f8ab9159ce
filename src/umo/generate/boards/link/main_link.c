/* main_link.c: the loop of a controller whose application is on a host. Outputs are at their defaults before the host
 * starts it, after a fault, and when the host is gone and the axes stand: the loop goes on, and answers. */
#include "io.h"
#include "umo_link.h"

#ifdef ARDUINO /* the sketch calls it */
int umo_main(void);
#define main umo_main
#endif

static umo_machine machine;
umo_link machine_link; /* a board may show its mode */
static int32_t raws_in[MACHINE_INPUTS + 1], raws_out[MACHINE_OUTPUTS + 1];
static uint8_t failed_in[MACHINE_INPUTS + 1], failed_out[MACHINE_OUTPUTS + 1];

static void read_inputs(void)
{
    for (int16_t place = 0; place < MACHINE_INPUTS; place++)
        failed_in[place] = 0;
    io_read(raws_in, failed_in);
}

static void write_defaults(void)
{
    machine_stop(&machine, raws_out);
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++)
        (void)io_write(machine_stop_order[i], raws_out[machine_stop_order[i]]);
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
}
