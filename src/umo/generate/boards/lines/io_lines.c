/* io_lines.c: inputs and outputs as lines of text, to try the controller without hardware.
 *
 * A line in is a period: `TICKS RAW RAW ...`, an input that could not be read is `x`. The line out is `RAW RAW ...`,
 * every output; `fault N OBJECT` and the defaults at the end. The ticks of the first line do not count. With
 * UMO_MEASURE the line goes on with `; CYCLES`, the time of machine_step. */
#include "io.h"
#include "lines.h"

static int32_t raws[MACHINE_OUTPUTS + 1];
static int32_t ticks;
static bool begun, waiting, stopped;

/* A number; false at the end of the line. `x` is no number: `missing`. */
static bool number(int32_t *value, bool *missing)
{
    int c = line_get();
    while (c == ' ')
        c = line_get();
    if (c == '\n' || c < 0)
        return false;
    *missing = c == 'x';
    bool negative = c == '-';
    uint32_t found = 0;
    for (c = negative || *missing ? line_get() : c; c >= '0' && c <= '9'; c = line_get())
        found = found * 10 + (uint32_t)(c - '0');
    *value = (int32_t)(negative ? 0 - found : found);
    if (c == '\n' || c < 0)
        line_unget(c);
    return true;
}

static void put_text(const char *text)
{
    while (*text)
        line_put(*text++);
}

static void put_number(int32_t value)
{
    char digits[12];
    int n = 0;
    uint32_t left = value < 0 ? 0 - (uint32_t)value : (uint32_t)value;
    do
        digits[n++] = (char)('0' + left % 10);
    while ((left /= 10) > 0);
    if (value < 0)
        line_put('-');
    while (n > 0)
        line_put(digits[--n]);
}

static void put_raws(void)
{
    for (int16_t place = 0; place < MACHINE_OUTPUTS; place++) {
        put_number(raws[place]);
        line_put(' ');
    }
#ifdef UMO_MEASURE
    put_text("; ");
    put_number(line_spent());
#endif
    line_put('\n');
    line_flush();
}

bool io_begin(void)
{
    line_begin();
    return true;
}

void io_watchdog(void)
{
}

/* The next line in; the answer to the last one first. */
int32_t io_wait(void)
{
    bool missing;
    if (waiting)
        put_raws();
    waiting = false;
    if (stopped || !number(&ticks, &missing))
        line_end();
    return ticks;
}

void io_read(int32_t *raws_in, uint8_t *failed_in)
{
    bool missing = false;
    int32_t rest;
    if (!begun)
        (void)io_wait(); /* the first line */
    begun = true;
    for (int16_t place = 0; place < MACHINE_INPUTS; place++)
        failed_in[place] = !number(&raws_in[place], &missing) || missing;
    while (number(&rest, &missing))
        continue;
    waiting = true;
    line_mark(true);
}

bool io_write(int16_t place, int32_t raw)
{
    line_mark(false);
    raws[place] = raw;
    return true;
}

void io_fault(umo_fault fault, int16_t object)
{
    put_text("fault ");
    put_number(fault);
    line_put(' ');
    put_number(object);
    line_put('\n');
    put_raws();
    stopped = true;
    waiting = false;
}
