/* lockstep.c: a controller with a host, period by period: its board and its line are arrays of the one who calls. */
#include <string.h>

#include "main_io.h"
#include "umo_link.h"

enum { ROOM = 1 << 16 };
static umo_link machine_link;
static uint8_t to_controller[ROOM], to_host[ROOM], deaf[MACHINE_OUTPUTS + 1];
static int32_t given, taken, answered, written;
static int32_t board_in[MACHINE_INPUTS + 1], board_out[MACHINE_OUTPUTS + 1];
static uint8_t board_failed[MACHINE_INPUTS + 1];

bool io_begin(void)
{
    return true;
}

void io_watchdog(void)
{
}

int32_t io_wait(void)
{
    return 1;
}

void io_fault(umo_fault fault, int16_t object)
{
    (void)fault;
    (void)object;
}

void io_read(int32_t *raws, uint8_t *failed)
{
    memcpy(raws, board_in, sizeof board_in);
    memcpy(failed, board_failed, sizeof board_failed);
}

/* The circuit refuses in the first transfer of a period only. */
bool io_write(int16_t place, int32_t raw)
{
    if (written++ < MACHINE_OUTPUTS && deaf[place])
        return false;
    board_out[place] = raw;
    return true;
}

void link_begin(void)
{
}

int link_get(void)
{
    return taken < given ? to_controller[taken++] : -1;
}

void link_put(uint8_t byte)
{
    if (answered < ROOM)
        to_host[answered++] = byte;
}

void link_end(void)
{
}

umo_machine *lockstep_machine(void)
{
    return &machine;
}

void lockstep_begin(void)
{
    machine_init(&machine);
    umo_link_begin(&machine_link, &machine, raws_in, failed_in, raws_out);
    write_defaults();
}

void lockstep_give(const uint8_t *bytes, int32_t count)
{
    memcpy(&to_controller[given], bytes, (size_t)count);
    given += count;
}

int32_t lockstep_take(uint8_t *bytes)
{
    int32_t count = answered;
    memcpy(bytes, to_host, (size_t)count);
    answered = 0;
    return count;
}

/* One period of main_link.c; its fault, and below 0 the mode in which the laws are not called. */
int32_t lockstep_period(int32_t ticks, const int32_t *raws, const uint8_t *failed, const uint8_t *refuse, int32_t *out)
{
    umo_fault fault = UMO_OK;
    written = 0;
    memcpy(board_in, raws, sizeof(int32_t) * MACHINE_INPUTS);
    memcpy(board_failed, failed, MACHINE_INPUTS);
    memcpy(deaf, refuse, MACHINE_OUTPUTS);
    read_inputs();
    umo_link_receive(&machine_link);
    given = taken = 0;
    bool runs = umo_link_count(&machine_link, ticks);
    if (runs) {
        fault = machine_step(&machine, ticks, raws_in, failed_in, raws_out);
        fault = fault ? fault : write_outputs();
    }
    umo_link_answer(&machine_link);
    memcpy(out, board_out, sizeof(int32_t) * MACHINE_OUTPUTS);
    return runs ? fault : -1 - machine_link.mode;
}
