/* zone_plant.c: a zone of the furnace as its station has it: heater, fan, thermocouple; it is hot from a run before, and a thermocouple whose converter
 * gives no raw integers but those of 4 n + 1: another one is wrong. */
#include "machine.h"

#define CAPACITY 2000.0 /* J/K */
#define POWER 16000.0   /* W */
#define LOSS 8.0        /* W/K */
#define FAN_LOSS 4.0
#define AMBIENCE 25.0   /* degC */
#define COUNTS 20.5     /* 1/K: 41 uV/K, of 2 uV */

enum { THERMOCOUPLE = 0, HEATER = 0, FAN = 1 }; /* places */
void plant_read(int32_t *raws_in);
void plant_write(int16_t place, int32_t raw, int32_t before);
static double temperature = 90.0, duty;
static int32_t fan = 1;
static uint32_t noise = 1;

void plant_read(int32_t *raws_in)
{
    double losses = (LOSS + FAN_LOSS * fan) * (temperature - AMBIENCE);
    temperature += (POWER * duty - losses) * (MACHINE_PERIOD / CAPACITY);
    noise = noise * 1664525u + 1013904223u;
    raws_in[THERMOCOUPLE] = ((int32_t)(temperature * COUNTS) & ~3) + 1 + (int32_t)(noise >> 31) * 4;
}

void plant_write(int16_t place, int32_t raw, int32_t before)
{
    (void)before;
    if (place == HEATER)
        duty = raw / 1000.0;
    else if (place == FAN)
        fan = raw;
}
