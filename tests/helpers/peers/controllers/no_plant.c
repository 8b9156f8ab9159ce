/* no_plant.c: sensors that read 0, and actuators that move nothing. */
#include "machine.h"

void plant_read(int32_t *raws_in);
void plant_write(int16_t place, int32_t raw, int32_t before);

void plant_read(int32_t *raws_in)
{
    (void)raws_in;
}

void plant_write(int16_t place, int32_t raw, int32_t before)
{
    (void)place;
    (void)raw;
    (void)before;
}
