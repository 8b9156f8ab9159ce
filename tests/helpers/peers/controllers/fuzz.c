/* fuzz.c: a generated controller with random inputs, ticks and failures, for the sanitizers.
 *
 *   fuzz PERIODS SEED
 */
#include <stdio.h>
#include <stdlib.h>

#include "machine.h"

static uint64_t state;

static uint32_t any(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)(state >> 16);
}

int main(int argc, char **argv)
{
    static umo_machine m;
    static int32_t in[MACHINE_INPUTS + 1], out[MACHINE_OUTPUTS + 1];
    static uint8_t failed_in[MACHINE_INPUTS + 1], failed_out[MACHINE_OUTPUTS + 1];
    long faults = 0, periods = argc > 1 ? atol(argv[1]) : 1000;
    state = 88172645463325252u + (uint64_t)(argc > 2 ? atol(argv[2]) : 0);
    machine_init(&m);
    (void)machine_begin(&m, in, failed_in, out);
    for (long n = 0; n < periods; n++) {
        for (int i = 0; i < MACHINE_INPUTS; i++) {
            uint32_t kind = any() % 8;
            in[i] = kind == 0 ? (int32_t)any() : kind == 1 ? (int32_t)(any() % 2) : in[i] + (int32_t)(any() % 9) % 100 - 4;
            if (in[i] > 100000 || in[i] < -100000)
                in[i] = kind == 0 ? in[i] : 0;
            failed_in[i] = any() % 50 == 0;
        }
        for (int i = 0; i < MACHINE_OUTPUTS; i++)
            failed_out[i] = any() % 50 == 0;
        faults += machine_step(&m, (int32_t)(any() % 20 == 0 ? any() % 1000 : 1), in, failed_in, out) != UMO_OK;
        umo_fault fault;
        do {
            fault = machine_sent(&m, failed_out);
            faults += fault != UMO_OK;
        } while (!fault && m.core.changed);
        if (any() % 1000 == 0)
            machine_acknowledge(&m);
        if (any() % 200 == 0)
            faults += MACHINE_EQUIPMENT && machine_clear(&m, -1);
        if (any() % 5000 == 0)
            machine_stop(&m, out);
    }
    printf("%ld faults\n", faults);
    return 0;
}
