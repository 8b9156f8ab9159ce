/* umo_sums.c: sums as numpy's. */
#include "umo_python.h"

/* numpy's pairwise sum. */
static umo_real pairwise(const umo_real *x, int16_t n)
{
    if (n < 8) {
        umo_real sum = 0;
        for (int16_t i = 0; i < n; i++)
            sum += x[i];
        return sum;
    }
    umo_real part[8];
    int16_t i;
    for (int16_t k = 0; k < 8; k++)
        part[k] = x[k];
    for (i = 8; i < n - n % 8; i = (int16_t)(i + 8))
        for (int16_t k = 0; k < 8; k++)
            part[k] += x[i + k];
    umo_real sum = ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
    for (; i < n; i++)
        sum += x[i];
    return sum;
}

umo_real umo_sum(const umo_real *x, int16_t n)
{
    const umo_real first = 0; /* as numpy's: the sum of -0.0 alone is 0.0 */
    return first + pairwise(x, n);
}
