/* board_main.c: in the place of a controller's main.c: clears what is in fault, acknowledges, goes on after faults, and
 * begins each line out with the fault of each equipment. */
#include "io.h"
#include "lines.h"

enum { ACKNOWLEDGED = 9 }; /* periods */
static umo_machine machine;
static int32_t raws_in[MACHINE_INPUTS + 1], raws_out[MACHINE_OUTPUTS + 1];
static uint8_t failed_in[MACHINE_INPUTS + 1];

static void write_outputs(void)
{
    for (int16_t place = 0; place < MACHINE_OUTPUTS; place++)
        (void)io_write(place, raws_out[place]);
}

static void answer(umo_fault fault)
{
    do {
        write_outputs();
        fault = fault ? fault : machine_sent(&machine, NULL);
    } while (!fault && machine.core.changed);
    for (int16_t i = 0; i <= MACHINE_EQUIPMENT; i++) {
        umo_fault each = i < MACHINE_EQUIPMENT ? machine.core.equipment[i].fault : fault;
        for (int place = 1000; place > 0; place /= 10)
            line_put((char)('0' + each / place % 10));
        line_put(' ');
    }
}

int main(void)
{
    (void)io_begin();
    machine_init(&machine);
    io_read(raws_in, failed_in);
    answer(machine_begin(&machine, raws_in, failed_in, raws_out));
    for (int32_t period = 0;; period++) {
        int32_t ticks = io_wait();
        for (int16_t i = 0; i < MACHINE_EQUIPMENT; i++)
            if (machine.core.equipment[i].fault)
                (void)machine_clear(&machine, i);
        if (period % ACKNOWLEDGED == ACKNOWLEDGED - 1)
            machine_acknowledge(&machine);
        io_read(raws_in, failed_in);
        answer(machine_step(&machine, ticks, raws_in, failed_in, raws_out));
    }
}
