/* link_board.c: the board of a controller whose periods a test gives, one call each. The loop of main_link.c runs on a
 * stack of its own, and io_wait leaves it; so it is the generated program, and not a copy of its loop. */
#define _GNU_SOURCE
#include <string.h>
#include <ucontext.h>

#include "io.h"
#include "umo_link.h"

enum { ROOM = 8 * LINK_LONGEST, STACK = 1 << 17 };
extern char __bss_start[] __attribute__((visibility("hidden")));
extern char _end[] __attribute__((visibility("hidden")));
extern umo_link machine_link;
int controller_main(void);
void orders_power_up(void);
void orders_period(int32_t given, const int32_t *raws, const uint8_t *line, int32_t count);

static ucontext_t test, controller;
static char stack[STACK];
static int32_t ticks, inputs[MACHINE_INPUTS + 1], left;
static const uint8_t *next;
int32_t orders_outputs[MACHINE_OUTPUTS + 1], orders_sent;
uint8_t orders_line[ROOM];

static void run(void)
{
    (void)controller_main();
}

/* The memory of the program is as after a reset, and it runs up to its first wait. */
void orders_power_up(void)
{
    memset(__bss_start, 0, (size_t)(_end - __bss_start));
    (void)getcontext(&controller);
    controller.uc_stack.ss_sp = stack;
    controller.uc_stack.ss_size = sizeof stack;
    makecontext(&controller, run, 0);
    (void)swapcontext(&test, &controller);
}

/* One period, `given` ticks after the last one, with these inputs, in which these bytes have come. What the controller
 * says is in orders_line, orders_sent bytes of it. */
void orders_period(int32_t given, const int32_t *raws, const uint8_t *line, int32_t count)
{
    ticks = given;
    memcpy(inputs, raws, MACHINE_INPUTS * sizeof *inputs);
    next = line;
    left = count;
    orders_sent = 0;
    (void)swapcontext(&test, &controller);
}

bool io_begin(void)
{
    return true;
}

void io_watchdog(void)
{
}

int32_t io_wait(void)
{
    (void)swapcontext(&controller, &test);
    return ticks;
}

void link_begin(void)
{
}

int link_get(void)
{
    return left > 0 ? (left--, *next++) : -1;
}

void link_put(uint8_t byte)
{
    if (orders_sent < ROOM)
        orders_line[orders_sent++] = byte;
}

void link_end(void)
{
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    (void)failed_in;
    memcpy(raws_in, inputs, MACHINE_INPUTS * sizeof *inputs);
}

bool io_write(int16_t place, int32_t raw)
{
    orders_outputs[place] = raw;
    return true;
}

void io_fault(umo_fault fault, int16_t object)
{
    (void)fault;
    (void)object;
}

/* What the controller is, for who judges it -------------------------------------------------------------------- */

int32_t orders_mode(void);
int32_t orders_session(void);
int32_t orders_heard(void);
int32_t orders_silent(void);
int32_t orders_fault(int16_t equipment);
const void *orders_field(uint16_t number);

int32_t orders_mode(void)
{
    return machine_link.mode;
}

int32_t orders_session(void)
{
    return machine_link.session;
}

int32_t orders_heard(void)
{
    return machine_link.heard;
}

int32_t orders_silent(void)
{
    return (int32_t)machine_link.silent;
}

int32_t orders_fault(int16_t equipment)
{
    return machine_link.machine->core.equipment[equipment].fault;
}

const void *orders_field(uint16_t number)
{
    return (const uint8_t *)machine_link.machine + link_places[link_first[number]].offset;
}
