/* recorded_board.c: a controller that has lost nothing with a plant behind it, and a record of its outputs: a line for
 * each period in which something changes, `PERIOD MODE SILENT OUTPUTS...`. */
#include "io.h"
#include "umo_link.h"

void record_put(char c);
void record_period(void); /* the one before is over */
void plant_read(int32_t *raws_in);                             /* once a period */
void plant_write(int16_t place, int32_t raw, int32_t before);
extern umo_link machine_link;
static int32_t outputs[MACHINE_OUTPUTS + 1], shown[MACHINE_OUTPUTS + 1];
static long period, silent;
static uint16_t heard, session;
static int mode = -1;

bool io_begin(void)
{
    return true;
}

void io_watchdog(void)
{
}

static void put_number(long value)
{
    char digits[12];
    int n = 0;
    do
        digits[n++] = (char)('0' + value % 10);
    while ((value /= 10) > 0);
    while (n > 0)
        record_put(digits[--n]);
    record_put(' ');
}

void record_period(void)
{
    bool changed = mode != machine_link.mode;
    bool same = heard == machine_link.heard && (session == machine_link.session || !machine_link.session);
    silent = same ? silent + 1 : 0;
    heard = machine_link.heard;
    session = machine_link.session;
    mode = machine_link.mode;
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++) {
        changed = changed || shown[i] != outputs[i];
        shown[i] = outputs[i];
    }
    if (!changed)
        return;
    put_number(period);
    put_number(mode);
    put_number(silent);
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++)
        put_number(outputs[i]);
    record_put('\n');
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    (void)failed_in;
    period++;
    record_period();
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
