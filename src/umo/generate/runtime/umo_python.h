/* umo_python.h: the arithmetic of Python, for translated code. */
#ifndef UMO_PYTHON_H
#define UMO_PYTHON_H

#include "umo.h"

typedef struct {
    bool has; /* false: None */
    umo_real value;
} umo_optional_real;

typedef struct {
    bool has;
    int32_t value;
} umo_optional_int;

typedef struct {
    bool has;
    bool value;
} umo_optional_bool;

typedef struct {
    bool has;
    uint8_t value;
} umo_optional_state;

#ifdef UMO_FLOAT
#define UMO_OF_LIBRARY(name) name##f
#else
#define UMO_OF_LIBRARY(name) name
#endif
#define umo_fmod UMO_OF_LIBRARY(fmod)
#define umo_sqrt UMO_OF_LIBRARY(sqrt)
#define umo_ceil UMO_OF_LIBRARY(ceil)
#define umo_trunc UMO_OF_LIBRARY(trunc)

/* A number that the compiler does not know: it would compute pow(x, 2.0), and functions of constants, by itself, and
 * other bits than the library. */
static inline umo_real umo_unknown(umo_real x)
{
    volatile umo_real kept = x;
    return kept;
}

#define umo_sin(x) UMO_OF_LIBRARY(sin)(umo_unknown(x))
#define umo_cos(x) UMO_OF_LIBRARY(cos)(umo_unknown(x))
#define umo_tan(x) UMO_OF_LIBRARY(tan)(umo_unknown(x))
#define umo_asin(x) UMO_OF_LIBRARY(asin)(umo_unknown(x))
#define umo_acos(x) UMO_OF_LIBRARY(acos)(umo_unknown(x))
#define umo_atan(x) UMO_OF_LIBRARY(atan)(umo_unknown(x))
#define umo_exp(x) UMO_OF_LIBRARY(exp)(umo_unknown(x))
#define umo_log(x) UMO_OF_LIBRARY(log)(umo_unknown(x))
#define umo_log10(x) UMO_OF_LIBRARY(log10)(umo_unknown(x))
#define umo_atan2(y, x) UMO_OF_LIBRARY(atan2)(umo_unknown(y), umo_unknown(x))
#define umo_pow(x, y) UMO_OF_LIBRARY(pow)(umo_unknown(x), umo_unknown(y))

/* max(a, b) and min(a, b): the first one of equal ones, and of those that cannot be compared. */
static inline umo_real umo_max(umo_real a, umo_real b)
{
    return b > a ? b : a;
}

static inline umo_real umo_min(umo_real a, umo_real b)
{
    return b < a ? b : a;
}

static inline int32_t umo_max_int(int32_t a, int32_t b)
{
    return b > a ? b : a;
}

static inline int32_t umo_min_int(int32_t a, int32_t b)
{
    return b < a ? b : a;
}

/* np.maximum and np.minimum: NaN if one is. */
static inline umo_real umo_np_max(umo_real a, umo_real b)
{
    return a > b || isnan(a) ? a : b;
}

static inline umo_real umo_np_min(umo_real a, umo_real b)
{
    return a < b || isnan(a) ? a : b;
}

/* np.clip between two numbers: a zero at a bound of zero keeps its sign. */
static inline umo_real umo_np_max_keeping(umo_real a, umo_real b)
{
    return a >= b || isnan(a) ? a : b;
}

static inline umo_real umo_np_min_keeping(umo_real a, umo_real b)
{
    return a <= b || isnan(a) ? a : b;
}

/* np.nan_to_num */
static inline umo_real umo_nan_to_num(umo_real x)
{
    if (isnan(x))
        return 0;
    return isfinite(x) ? x : umo_copysign(UMO_LARGEST, x);
}

umo_real umo_sum(const umo_real *x, int16_t n);

/* a // b and a % b of floats, b not 0 (float_floor_div and float_rem of CPython). */
static inline umo_real umo_mod(umo_real a, umo_real b)
{
    umo_real rest = umo_fmod(a, b);
    if (rest != 0) {
        if ((b < 0) != (rest < 0))
            rest += b;
    } else {
        rest = umo_copysign((umo_real)0, b);
    }
    return rest;
}

static inline umo_real umo_floor_div(umo_real a, umo_real b)
{
    umo_real rest = umo_fmod(a, b);
    umo_real quotient = (a - rest) / b;
    umo_real floored;
    if (rest != 0 && (b < 0) != (rest < 0))
        quotient -= 1;
    if (quotient != 0) {
        floored = umo_floor(quotient);
        if (quotient - floored > (umo_real)0.5)
            floored += 1;
    } else {
        floored = umo_copysign((umo_real)0, a / b);
    }
    return floored;
}

/* a // b of arrays; that by 0 is that of a / b. */
static inline umo_real umo_np_floor_div(umo_real a, umo_real b)
{
    return b == 0 ? a / b : umo_floor_div(a, b);
}

/* The same of whole numbers; b is not 0, and the quotient fits. */
static inline int32_t umo_mod_int(int32_t a, int32_t b)
{
    int32_t rest = b == -1 ? 0 : a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}

static inline int32_t umo_floor_div_int(int32_t a, int32_t b)
{
    int32_t quotient = a / b;
    return a % b != 0 && (a < 0) != (b < 0) ? quotient - 1 : quotient;
}

/* The same of arrays: by 0 it is 0. */
static inline int32_t umo_np_mod_int(int32_t a, int32_t b)
{
    return b == 0 ? 0 : umo_mod_int(a, b);
}

static inline int32_t umo_np_floor_div_int(int32_t a, int32_t b)
{
    return b == 0 ? 0 : umo_floor_div_int(a, b);
}

/* a >> b and a << b, b not negative. False: it does not fit. */
static inline int32_t umo_shift_right(int32_t a, int32_t b)
{
    if (b > 31)
        b = 31;
    return a >= 0 ? a >> b : ~(~a >> b);
}

static inline bool umo_shift_left(int32_t a, int32_t b, int32_t *out)
{
    int64_t shifted = a == 0 ? 0 : (int64_t)a * ((int64_t)1 << (b > 31 ? 31 : b));
    *out = (int32_t)shifted;
    return a == 0 || (b <= 31 && shifted >= INT32_MIN && shifted <= INT32_MAX);
}

/* Whether a float is a whole number of 32 bits after it was cut; NaN and infinity are not. */
static inline bool umo_fits_int(umo_real x)
{
    return x > (umo_real)-2147483649.0 && x < (umo_real)2147483648.0;
}

static inline bool umo_is_finite(umo_real x)
{
    return isfinite(x);
}

/* sum() of Python 3.12 and later: what rounding has lost is added at the end (Neumaier). */
static inline void umo_add(umo_real *total, umo_real *lost, umo_real x)
{
    umo_real sum = *total + x;
    *lost += umo_fabs(*total) >= umo_fabs(x) ? (*total - sum) + x : (x - sum) + *total;
    *total = sum;
}

static inline umo_real umo_added(umo_real total, umo_real lost)
{
    return lost != 0 && umo_is_finite(lost) ? total + lost : total;
}

static inline bool umo_is_nan(umo_real x)
{
    return isnan(x);
}

#include "umo_digits.h"

#endif
