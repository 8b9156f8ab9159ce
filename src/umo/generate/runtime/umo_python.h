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
#define umo_fmod fmodf
#define umo_sqrt sqrtf
#define umo_ceil ceilf
#define umo_trunc truncf
#define umo_pow powf
#define umo_sin sinf
#define umo_cos cosf
#define umo_tan tanf
#define umo_exp expf
#define umo_log logf
#define umo_atan2 atan2f
#else
#define umo_fmod fmod
#define umo_sqrt sqrt
#define umo_ceil ceil
#define umo_trunc trunc
#define umo_pow pow
#define umo_sin sin
#define umo_cos cos
#define umo_tan tan
#define umo_exp exp
#define umo_log log
#define umo_atan2 atan2
#endif

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

#endif
