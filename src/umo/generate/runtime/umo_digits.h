/* umo_digits.h: round(x, digits) and math.hypot of CPython, exact where Python is. */
#ifndef UMO_DIGITS_H
#define UMO_DIGITS_H

#ifdef UMO_FLOAT

static inline umo_real umo_round_to(umo_real x, umo_real power)
{
    umo_real scaled = x * power;
    return isfinite(scaled) ? umo_copysign(umo_round_even(umo_fabs(scaled)) / power, x) : x;
}

static inline umo_real umo_hypot(const umo_real *x, int16_t n)
{
    umo_real length = 0;
    for (int16_t i = 0; i < n; i++)
        length = hypotf(length, x[i]);
    return length;
}

#else

/* What is lost where a * b is rounded (Dekker); neither is beyond 2**970, nor their product below 2**-960. */
static inline double umo_lost(double a, double b)
{
    double at = a * 134217729.0, bt = b * 134217729.0, product = a * b;
    double ah = at - (at - a), bh = bt - (bt - b);
    double al = a - ah, bl = b - bh;
    return ((ah * bh - product) + ah * bl + al * bh) + al * bl;
}

/* `power` is 10**digits, and exact. x * power is known exactly as the sum of two; from 2**54 on neighbours of x are
 * farther away than the digits. */
static inline double umo_round_to(double x, double power)
{
    double a = fabs(x), scaled = a * power, lost, whole, rest, off, next, gap;
    if (!(scaled < 18014398509481984.0))
        return x;
    if (scaled < 0.25)
        return copysign(0.0, x);
    lost = umo_lost(a, power);
    if (scaled < 4503599627370496.0) {
        whole = floor(scaled);
        rest = scaled - whole;
        if (rest > 0.5 || (rest == 0.5 && (lost > 0 || (lost == 0 && fmod(whole, 2.0) != 0))))
            whole += 1;
        return copysign(whole / power, x);
    }
    whole = floor(lost); /* scaled is whole; so much is added to it, and neighbours of x are perhaps nearer */
    rest = lost - whole;
    if (rest > 0.5 || (rest == 0.5 && fmod(scaled + whole, 2.0) != 0))
        whole += 1;
    off = whole - lost;
    next = nextafter(a, off > 0 ? INFINITY : 0.0);
    gap = fabs(next - a);
    return fabs(off) * 2 > gap * power ? copysign(next, x) : x;
}

static inline void umo_sum_up(double *sum, double *lost, double x)
{
    double before = *sum;
    *sum += x;
    *lost += (before - *sum) + x;
}

/* vector_norm of CPython 3.11 and later. */
static inline double umo_hypot(const double *x, int16_t n)
{
    double largest = 0, sum = 1, lost[3] = {0, 0, 0}, scale, high, low, t, h;
    bool any_nan = false;
    int exponent;
    for (int16_t i = 0; i < n; i++) {
        any_nan = any_nan || isnan(x[i]);
        largest = fabs(x[i]) > largest ? fabs(x[i]) : largest;
    }
    if (isinf(largest))
        return largest;
    if (any_nan)
        return (double)NAN;
    if (largest == 0.0 || n == 1)
        return largest;
    (void)frexp(largest, &exponent);
    if (exponent < -1023) {
        for (int16_t i = 0; i < n; i++) {
            t = fabs(x[i]) / largest;
            umo_sum_up(&sum, &lost[0], t * t);
        }
        return largest * sqrt(sum - 1.0 + lost[0]);
    }
    scale = ldexp(1.0, -exponent);
    for (int16_t i = 0; i < n; i++) {
        double one = fabs(x[i]) * scale;
        t = one * 134217729.0;
        high = t - (t - one);
        low = one - high;
        umo_sum_up(&sum, &lost[0], high * high);
        umo_sum_up(&sum, &lost[1], 2.0 * high * low);
        lost[2] += low * low;
    }
    h = sqrt(sum - 1.0 + (lost[0] + lost[1] + lost[2]));
    t = h * 134217729.0;
    high = t - (t - h);
    low = h - high;
    umo_sum_up(&sum, &lost[0], -high * high);
    umo_sum_up(&sum, &lost[1], -2.0 * high * low);
    umo_sum_up(&sum, &lost[2], -low * low);
    return (h + (sum - 1.0 + (lost[0] + lost[1] + lost[2])) / (2.0 * h)) / scale;
}

#endif
#endif
