/* umo.h: what stands on a controller for the atomic objects of umo and for its cycle.
 *
 * C99, no heap, no recursion, no hardware. `umo_real` is a double, or a float where UMO_FLOAT is defined. Compile with
 * -ffp-contract=off: a * b + c is two operations, as in Python. The Python that each part stands for is named in the
 * .c files; with doubles the numbers are equal to the bit.
 *
 * Every function that can fail returns a fault, 0 for none: a number of `enum umo_faults`, or of machine_faults.h. */
#ifndef UMO_H
#define UMO_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "umo_target.h" /* whether UMO_FLOAT and UMO_GROUPS are defined */

#if defined(__FAST_MATH__) || (FLT_EVAL_METHOD != 0 && !defined(UMO_FLOAT))
#error "each operation must be rounded to a double"
#endif

#ifdef UMO_FLOAT
typedef float umo_real;
#define umo_fabs fabsf
#define umo_floor floorf
#define umo_copysign copysignf
#define umo_expm1 expm1f
#define UMO_LARGEST FLT_MAX
#else
typedef double umo_real;
#define umo_fabs fabs
#define umo_floor floor
#define umo_copysign copysign
#define umo_expm1 expm1
#define UMO_LARGEST DBL_MAX
#endif

#if defined(__AVR__) && !defined(__cplusplus)
#define UMO_FLASH __flash /* constants stay in the program memory; C++ cannot read them */
#else
#define UMO_FLASH
#endif

#include "umo_scaling.h"
#include "umo_curves.h"

/* Half to even, as Python's round and C's rint. */
static inline umo_real umo_round_even(umo_real x)
{
    umo_real low = umo_floor(x), over = x - low;
    bool odd = low - 2 * umo_floor(low / 2) != 0;
    return over > (umo_real)0.5 || (over == (umo_real)0.5 && odd) ? low + 1 : low;
}

typedef int16_t umo_fault;

/* The faults of the runtime. Those of translated code begin at UMO_FIRST_FAULT. */
enum umo_faults {
    UMO_OK = 0,
    UMO_UNREAD,      /* DriverError: a sensor could not be read, and nothing holds its value */
    UMO_UNWRITTEN,   /* DriverError: an actuator did not take its value */
    UMO_BAD_TICKS,   /* DriverError: the number of ticks is outside the range of the timer */
    UMO_OUTSIDE,     /* RangeError: a value outside the range of an actuator with limits="raise" */
    UMO_NOT_FINITE,  /* RangeError: NaN or infinite */
    UMO_BAD_INPUT,   /* BadInput: the quality of a sensor is not accepted */
    UMO_NEVER_READ,  /* BadInput: a binary sensor that was never read has no state */
    UMO_INTERLOCKED, /* Interlocked: an interlock with effect="stop" forbids the write */
    UMO_NO_STATE,    /* StateError: no number of a state */
    UMO_NO_HOST,     /* TaskFailed: what only the host can do was asked for, and there is none */
    UMO_FIRST_FAULT = 32
};

/* The numbers of umo.Quality. */
enum umo_qualities { UMO_GOOD, UMO_OUT_OF_RANGE, UMO_UNREFERENCED, UMO_STALE, UMO_BAD };

typedef struct umo_machine umo_machine; /* generated: contains all */
typedef struct umo_object umo_object;
typedef struct umo_core umo_core;
typedef int64_t umo_tick; /* ticks since the start */
#define UMO_NEVER (-1)

enum umo_flags {
    UMO_OUTPUT = 1,        /* an actuator */
    UMO_BINARY = 2,
    UMO_ASYNCHRONOUS = 4,
    UMO_CLAMPS = 8,        /* an actuator with limits="clamp" */
    UMO_MARKS = 16,        /* a sensor with on_error="mark" */
    UMO_INCREMENTAL = 32
};

/* What does not change of an object. A time of -1 or a rate of infinity: there is none. */
typedef struct {
    uint8_t flags;
    uint8_t one;                  /* binary: the number of the state of level 1 */
    uint8_t rollover_bits;        /* 0: the counter does not roll over */
    int16_t invalid_count;
    int16_t equipment;            /* the innermost equipment around it; -1: none */
#ifdef UMO_GROUPS
    int16_t group;                /* the parts to which it belongs; UMO_WHOLE: it is moved in each period */
#endif
    umo_real resolution, zero_offset;
    umo_real minimum, maximum;
    umo_real low, high;           /* sensor: bounds within which a value is GOOD */
    umo_real least, greatest;     /* actuator: the least and the greatest raw integer */
    umo_real max_age;             /* s; the last value is held, or sent again, for this time */
    umo_real rest;                /* actuator: its default */
    int32_t rest_raw;
    umo_real slew_rate, expires;
    umo_real filter, velocity, debounce; /* sensor: time constants in s */
    const UMO_FLASH umo_curve *to_value, *to_input;
    const UMO_FLASH int32_t *invalid_raws;
} umo_traits;

/* What only an actuator has. */
typedef struct {
    umo_real pending, sent;
    umo_tick stepped;  /* the last step of its rate */
    umo_tick written;  /* the last write that was admitted; UMO_NEVER after it has expired */
    umo_tick unconfirmed; /* of an asynchronous one: the first attempt that was not accepted; UMO_NEVER: it was */
    int32_t sent_raw;
    int16_t place;     /* its index in raws_out */
    bool inhibited, stopping; /* by an interlock; by one with effect="stop" */
    bool due;          /* it begins to be inhibited, or its command has expired */
#ifdef UMO_GROUPS
    bool urgent;       /* its default, or what follows it, does not wait for the period of its group */
#endif
} umo_output;

/* What only a sensor with rollover, filter, velocity or debounce has. */
typedef struct {
    int64_t count;
    umo_tick time, since;
    umo_real reading, last, value, velocity;
    bool counted, has_reading, has_level;
} umo_conditioning;

struct umo_object {
    umo_core *core;
    const UMO_FLASH umo_traits *traits;
    umo_output *output;             /* NULL: a sensor */
    umo_conditioning *conditioning; /* NULL: none */
    umo_real value;                 /* of a sensor as last kept, of an actuator as last accepted */
    umo_real zero_offset;           /* homing may change it */
    umo_tick time;                  /* of the value */
    int32_t raw;
    uint8_t quality, base;
    bool failed;                    /* a sensor: it could not be read since it was initialised */
#ifdef UMO_GROUPS
    bool moves;                     /* in the transfer that is under way */
#endif
};

typedef umo_fault (*umo_condition)(umo_machine *m, bool *holds);

/* An interlock: its condition, and the actuators that it inhibits, by their places in raws_out. */
typedef struct {
    umo_condition condition;
    const UMO_FLASH int16_t *outputs;
    int16_t count;
    bool latches, stops;
} umo_interlock_traits;

typedef struct {
    bool held, latched, inhibits;
} umo_interlock;

/* Equipment: a part that fails alone. `outer` is the equipment around it, -1: none. `enter` is called when its fault
 * begins; NULL: nothing. */
typedef struct {
    int16_t outer;
    void (*enter)(umo_machine *m);
} umo_equipment_traits;

typedef struct {
    umo_fault fault, raised;             /* 0: none. `raised` becomes its fault within this period */
    int16_t fault_object, raised_object; /* the object of it; -1: none */
    bool begins;                         /* its fault began the last time that one did */
} umo_equipment;

#ifdef UMO_GROUPS /* their number: parts that have a rate of their own, the fastest first */

enum { UMO_WHOLE = -1, UMO_OWED = UMO_GROUPS, UMO_SENT };
#define umo_moves(o) ((o)->moves)

typedef struct {
    int32_t every, phase; /* periods of the machine in one of its own; the number of the first one */
    umo_real period;
    umo_fault (*laws)(umo_machine *m);
} umo_group_traits;

typedef struct {
    umo_tick due, last; /* the period in which it acts next, and in which it has acted last */
    umo_real dt;
    int32_t ticks;
    bool acts;          /* in this period */
} umo_group;

#else
#define umo_moves(o) true
#endif

/* What does not change of a machine. */
typedef struct {
    umo_real period;
    int16_t inputs;  /* the objects from 0 on, which raws_in is for */
    int16_t objects, outputs, interlocks;
    int16_t timer;   /* its object; -1: none */
    const UMO_FLASH umo_traits *traits;
    const UMO_FLASH int16_t *output_objects; /* the object of each place of raws_out */
    const UMO_FLASH int16_t *stop_order;     /* places of raws_out */
    const UMO_FLASH int16_t *conditioned;    /* the objects that have a umo_conditioning, in the order of these */
    int16_t conditionings;
    const UMO_FLASH umo_interlock_traits *interlock_traits;
    int16_t equipment; /* the number of these, the outer before the inner */
    const UMO_FLASH umo_equipment_traits *equipment_traits;
#ifdef UMO_GROUPS
    const UMO_FLASH umo_group_traits *group_traits;
#endif
} umo_plan;

struct umo_core {
    const UMO_FLASH umo_plan *plan;
    umo_object *objects;
    umo_output *outputs;
    umo_conditioning *conditionings;
    umo_interlock *interlocks;
    umo_equipment *equipment;
    const uint8_t *inhibits; /* a bit for each place of raws_out that the host inhibits; NULL: there is no host */
    int32_t *raws_out;
    umo_tick number;   /* ticks since the start */
    int32_t ticks;     /* that the last step consumed */
    umo_real now, dt;  /* s */
    int16_t fault_object; /* the object of the last fault of the runtime; -1: none */
    bool changed;      /* a fault of equipment has changed raws_out since machine_step: it is to be sent again */
    bool given;        /* raws_out has been filled, and is taken for accepted with the next step */
    umo_fault (*host_call)(umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count);
#ifdef UMO_GROUPS
    umo_group *groups;
    const int32_t *raws_in;   /* of this period */
    const uint8_t *failed_in;
    int16_t sending;          /* the group whose outputs are being sent, UMO_WHOLE, UMO_OWED; UMO_SENT: all were */
    umo_fault unsent;         /* the first fault of sending in this period */
    bool sampled;             /* a period has begun, and no groups have followed yet */
#endif
};

/* Called by translated code ------------------------------------------------------------------------------ */

umo_fault umo_digital_read(umo_object *o, umo_real *out);
umo_fault umo_binary_read(umo_object *o, uint8_t *out);
umo_fault umo_digital_write(umo_object *o, umo_real value, bool *taken);
umo_fault umo_binary_write(umo_object *o, uint8_t state, bool *taken);
umo_real umo_value(const umo_object *o);
int32_t umo_raw(const umo_object *o);
uint8_t umo_quality(const umo_object *o);
umo_real umo_time(const umo_object *o);
umo_fault umo_value_of(umo_object *o, uint32_t accept_mask, umo_real *out);
umo_fault umo_state_of(umo_object *o, uint32_t accept_mask, uint8_t *out);
umo_fault umo_velocity(umo_object *o, umo_real *out);
umo_real umo_pending(const umo_object *o);
uint8_t umo_pending_state(const umo_object *o);
umo_real umo_minimum(const umo_object *o);
umo_real umo_maximum(const umo_object *o);
umo_real umo_resolution(const umo_object *o);
umo_real umo_default(const umo_object *o);
uint8_t umo_default_state(const umo_object *o);
umo_real umo_slew_rate(const umo_object *o); /* infinite: there is none */
bool umo_has_slew_rate(const umo_object *o);
bool umo_inhibited(const umo_object *o);
umo_fault umo_object_reset(umo_object *o);
void umo_referenced(umo_object *o, bool known);
umo_fault umo_set_reading(umo_object *o, umo_real value);
umo_fault umo_values_of(
    umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n, uint32_t accept_mask, const bool *where, umo_real *out);
umo_fault umo_write_many(
    umo_machine *m, const UMO_FLASH int16_t *objects, int16_t n, const umo_real *values, const bool *where, bool *taken);
umo_real umo_now(const umo_machine *m);
umo_real umo_dt(const umo_machine *m);
umo_real umo_period(const umo_machine *m);
int32_t umo_ticks(const umo_machine *m);
#ifdef UMO_GROUPS
umo_real umo_group_dt(const umo_machine *m, int16_t group);
int32_t umo_group_ticks(const umo_machine *m, int16_t group);
#endif
umo_fault umo_host_call(umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count);

/* Called by machine.c ------------------------------------------------------------------------------------ */

void umo_start(umo_core *c);
umo_fault umo_begin_period(umo_core *c, int32_t ticks, int32_t *raws_out);
umo_fault umo_sample(umo_core *c, const int32_t *raws_in, const uint8_t *failed_in);
void umo_evaluate(umo_core *c);
void umo_give(umo_core *c);
umo_fault umo_sent(umo_core *c, const uint8_t *failed_out);
void umo_stop(umo_core *c, int32_t *raws_out);
void umo_acknowledge(umo_core *c);
bool umo_in_fault(const umo_core *c, int16_t number);
void umo_raise_in(umo_core *c, int16_t number, umo_fault fault, int16_t object);
void umo_enter_faults(umo_core *c);
bool umo_clear(umo_core *c, int16_t number);
#ifdef UMO_GROUPS
void umo_start_groups(umo_core *c);
void umo_choose_whole(umo_core *c);
void umo_take_again(umo_core *c, int16_t input);
umo_fault umo_sent_in_turn(umo_core *c, const uint8_t *failed_out);
#endif

/* Called for the host ------------------------------------------------------------------------------------ */

void umo_shift(umo_object *o, umo_real zero_offset);

/* Inside the runtime ------------------------------------------------------------------------------------- */

umo_fault umo_command(umo_object *o, umo_real value, bool *taken);
umo_real umo_curve_at(const UMO_FLASH umo_curve *curve, umo_real x);
umo_real umo_since(const umo_core *c, umo_tick tick);
umo_fault umo_failed(umo_object *o, umo_fault fault);
uint8_t umo_judge(const umo_object *o, umo_real value);
void umo_rest(umo_object *o);
void umo_send(umo_object *o);
void umo_restrict(umo_core *c);
bool umo_contains(umo_object *o, umo_fault fault);
void umo_forget_raised(umo_core *c);
int64_t umo_count_of(umo_object *o, int32_t raw);
umo_real umo_conditioned(umo_object *o, umo_real value, bool inside);
void umo_begin_conditioning(umo_conditioning *of);

#endif
