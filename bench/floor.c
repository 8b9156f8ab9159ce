/* Row (c), the floor: plain loops over arrays, one for each kind, no objects and no calls. Range check, scaling, pending
   and commanded as in row (b); the circuit is an array of registers for the inputs and one for the outputs. */
#include <math.h>
#include <stdlib.h>

#define BENCH __attribute__((visibility("default")))

struct plant {
    int digital_in, binary_in, digital_out, binary_out;
    long *registers_in, *registers_out; /* digital first, then binary */
    double *read_resolution, *read_offset, *read_low, *read_high, *value;
    unsigned char *outside;
    long *level;
    double *resolution, *offset, *low, *high, *command, *pending, *commanded;
    long *level_command, *level_pending, *level_commanded;
};

static const double READ[5][4] = {{4.64357, -147871.0, 55000.0, 129000.0},
                                  {0.000529483, 227.4438, -270.0, 270.0},
                                  {1.0, 0.0, 0.0, 1000.0},
                                  {0.0, 0.0, 0.0, 0.0}, /* the binary sensor */
                                  {1.0, 0.0, 0.0, 99999.9}};

static double *numbers(int count) { return calloc(count + 1, sizeof(double)); }
static long *integers(int count) { return calloc(count + 1, sizeof(long)); }

BENCH struct plant *floor_new(int sensors, int actuators)
{
    struct plant *p = calloc(1, sizeof(struct plant));
    p->binary_in = (sensors + 1) / 5;
    p->digital_in = sensors - p->binary_in;
    p->digital_out = (actuators + 7) / 8;
    p->binary_out = actuators - p->digital_out;
    p->registers_in = integers(sensors);
    p->registers_out = integers(actuators);
    p->read_resolution = numbers(p->digital_in);
    p->read_offset = numbers(p->digital_in);
    p->read_low = numbers(p->digital_in);
    p->read_high = numbers(p->digital_in);
    p->value = numbers(p->digital_in);
    p->outside = calloc(p->digital_in + 1, 1);
    p->level = integers(p->binary_in);
    p->resolution = numbers(p->digital_out);
    p->offset = numbers(p->digital_out);
    p->low = numbers(p->digital_out);
    p->high = numbers(p->digital_out);
    p->command = numbers(p->digital_out);
    p->pending = numbers(p->digital_out);
    p->commanded = numbers(p->digital_out);
    p->level_command = integers(p->binary_out);
    p->level_pending = integers(p->binary_out);
    p->level_commanded = integers(p->binary_out);
    for (int i = 0, digital = 0; i < sensors; i++) {
        if (i % 5 == 3)
            continue;
        p->read_resolution[digital] = READ[i % 5][0];
        p->read_offset[digital] = READ[i % 5][1];
        p->read_low[digital] = READ[i % 5][2];
        p->read_high[digital++] = READ[i % 5][3];
    }
    for (int i = 0; i < p->digital_out; i++) {
        p->resolution[i] = 10.0 / 2047.0;
        p->low[i] = -10.0;
        p->high[i] = 10.0;
    }
    return p;
}

static void sample(struct plant *p)
{
    for (int i = 0; i < p->digital_in; i++) {
        double value = p->registers_in[i] * p->read_resolution[i] + p->read_offset[i];
        p->value[i] = value;
        p->outside[i] = !(p->read_low[i] <= value && value <= p->read_high[i]);
    }
    for (int i = 0; i < p->binary_in; i++)
        p->level[i] = p->registers_in[p->digital_in + i];
}

static void update(struct plant *p)
{
    for (int i = 0; i < p->digital_out; i++) {
        p->registers_out[i] = lrint((p->pending[i] - p->offset[i]) / p->resolution[i]);
        p->commanded[i] = p->pending[i];
    }
    for (int i = 0; i < p->binary_out; i++) {
        p->registers_out[p->digital_out + i] = p->level_pending[i];
        p->level_commanded[i] = p->level_pending[i];
    }
}

static void write_all(struct plant *p)
{
    for (int i = 0; i < p->digital_out; i++)
        if (p->low[i] <= p->command[i] && p->command[i] <= p->high[i])
            p->pending[i] = p->command[i];
    for (int i = 0; i < p->binary_out; i++)
        p->level_pending[i] = p->level_command[i];
}

BENCH void floor_prepare(struct plant *p, const double *commands)
{
    for (int i = 0; i < p->digital_out + p->binary_out; i++) {
        if (i % 8 == 0)
            p->command[i / 8] = commands[i];
        else
            p->level_command[i - i / 8 - 1] = (long)commands[i];
    }
}

BENCH void floor_load(struct plant *p, const long *raws)
{
    for (int i = 0, digital = 0, binary = 0; i < p->digital_in + p->binary_in; i++)
        p->registers_in[i % 5 == 3 ? p->digital_in + binary++ : digital++] = raws[i];
}

BENCH void floor_store(struct plant *p, long *raws)
{
    for (int i = 0; i < p->digital_out + p->binary_out; i++)
        raws[i] = p->registers_out[i % 8 == 0 ? i / 8 : p->digital_out + i - i / 8 - 1];
}

BENCH void floor_values(struct plant *p, double *values)
{
    for (int i = 0, digital = 0, binary = 0; i < p->digital_in + p->binary_in; i++)
        values[i] = i % 5 == 3 ? (double)p->level[binary++] : p->value[digital++];
}

/* The barrier keeps the compiler from taking the work out of the loop over the periods. */
#define BARRIER __asm__ volatile("" ::: "memory")

BENCH void floor_sample_update(struct plant *p, int periods)
{
    for (int i = 0; i < periods; i++) { sample(p); update(p); BARRIER; }
}

BENCH void floor_write(struct plant *p, int periods)
{
    for (int i = 0; i < periods; i++) { write_all(p); BARRIER; }
}

BENCH void floor_period(struct plant *p, int periods)
{
    for (int i = 0; i < periods; i++) { sample(p); write_all(p); update(p); BARRIER; }
}
