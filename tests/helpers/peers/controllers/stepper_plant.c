/* stepper_plant.c: a stepper motor and its encoder, which lose nothing. */
#include "machine.h"

enum { COUNTS_PER_STEP = 425 };
void plant_read(int32_t *raws_in);
void plant_write(int16_t place, int32_t raw, int32_t before);
static int32_t position;
static int32_t forwards = 1;

void plant_read(int32_t *raws_in)
{
    raws_in[IN_theta_encoder] = position;
}

void plant_write(int16_t place, int32_t raw, int32_t before)
{
    if (place == OUT_theta_direction)
        forwards = raw;
    else if (place == OUT_theta_step && raw && !before)
        position += forwards ? COUNTS_PER_STEP : -COUNTS_PER_STEP;
}
