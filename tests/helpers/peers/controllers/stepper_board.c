/* stepper_board.c: a stepper motor and its encoder behind a controller that has lost nothing, and a record of its
 * outputs: a line for each period in which something changes, `PERIOD MODE SILENT OUTPUTS...`. */
#include <stdio.h>

#include "io.h"
#include "umo_link.h"

void link_host_begin(void);
extern umo_link machine_link;
static int32_t outputs[MACHINE_OUTPUTS + 1], shown[MACHINE_OUTPUTS + 1];
static int32_t position;
static long period, silent;
static uint16_t heard, session;
static int mode = -1;

bool io_begin(void)
{
    link_host_begin();
    return true;
}

void io_watchdog(void)
{
}

/* The period before is over. */
static void record(void)
{
    bool changed = mode != machine_link.mode;
    silent = heard == machine_link.heard && session == machine_link.session ? silent + 1 : 0;
    heard = machine_link.heard;
    session = machine_link.session;
    mode = machine_link.mode;
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++) {
        changed = changed || shown[i] != outputs[i];
        shown[i] = outputs[i];
    }
    if (!changed)
        return;
    printf("%ld %d %ld", period, mode, silent);
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++)
        printf(" %ld", (long)outputs[i]);
    printf("\n");
    (void)fflush(stdout);
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    (void)failed_in;
    period++;
    record();
    raws_in[IN_theta_encoder] = position;
}

bool io_write(int16_t place, int32_t raw)
{
    if (place == OUT_theta_step && raw && !outputs[OUT_theta_step])
        position += outputs[OUT_theta_direction] ? COUNTS_PER_STEP : -COUNTS_PER_STEP;
    outputs[place] = raw;
    return true;
}

void io_fault(umo_fault fault, int16_t object)
{
    fprintf(stderr, "fault %d of %d\n", fault, object);
}
