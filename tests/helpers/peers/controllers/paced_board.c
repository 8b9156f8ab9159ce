/* paced_board.c: a controller whose periods are lines of text: `TICKS FRAME`, the frame in hexadecimal digits, or none.
 * The line out is `MODE POSITION VELOCITY ACCELERATION OUTPUTS... ANSWER`: the setpoint of PROFILE, and what the
 * controller has sent. A plant is behind it. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io.h"
#include "umo_link.h"

void plant_read(int32_t *raws_in);
void plant_write(int16_t place, int32_t raw, int32_t before);
extern umo_link machine_link;
static int32_t outputs[MACHINE_OUTPUTS + 1];
static char line_in[4 * LINK_LONGEST + 64], answer[4 * LINK_LONGEST + 64];
static const char *frame = "";
static size_t answered;
static bool begun;

bool io_begin(void)
{
    return true;
}

void io_watchdog(void)
{
}

static void tell(void)
{
    const machine_Setpoint *s = &machine_link.machine->PROFILE.setpoint;
    printf("%d %.17g %.17g %.17g", machine_link.mode, s->position, s->velocity, s->acceleration);
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++)
        printf(" %" PRId32, outputs[i]);
    printf(" %s\n", answered ? answer : "-");
    (void)fflush(stdout);
    answered = 0;
}

int32_t io_wait(void)
{
    char *end;
    if (begun)
        tell();
    begun = true;
    if (!fgets(line_in, sizeof line_in, stdin))
        exit(0);
    long ticks = strtol(line_in, &end, 10);
    frame = end + strspn(end, " ");
    return (int32_t)ticks;
}

void link_begin(void)
{
}

int link_get(void)
{
    unsigned byte;
    if (sscanf(frame, "%2x", &byte) != 1)
        return -1;
    frame += 2;
    return (int)byte;
}

void link_put(uint8_t byte)
{
    answered += (size_t)snprintf(&answer[answered], sizeof answer - answered, "%02x", byte);
}

void link_end(void)
{
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    (void)failed_in;
    plant_read(raws_in);
}

bool io_write(int16_t place, int32_t raw)
{
    plant_write(place, raw, outputs[place]);
    outputs[place] = raw;
    return true;
}

void io_fault(umo_fault fault, int16_t object)
{
    (void)fault;
    (void)object;
}
