/* umo.drivers._native: the transfers in C of the drivers of this folder, as umo_driver.h has them.
 *
 * Only functions of Python's stable interface are used, so that one file serves all versions from 3.11 on.
 */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>

#include "umo_driver.h"

#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <structmember.h>

#ifdef __linux__
#include <time.h>
#include <unistd.h>
#endif

/* The numbers of umo.drivers.timerfd.Ticker, which is a subclass: times in ns. */
typedef struct {
    PyObject_HEAD
    long long period, next, due, woke, busy_wait, look_after, bearable, looked, used, napped;
    double owed, share;
    int file;
    char ended;
    /* Where it is tried: addresses of functions in the place of the system's. */
    unsigned long long clock, sleep, nap, processor_time;
} Grid;

static void Grid_dealloc(Grid *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

#ifdef __linux__
static long long clock_of(clockid_t which)
{
    struct timespec now;
    clock_gettime(which, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static long long now_of(const Grid *grid)
{
    return grid->clock ? ((long long (*)(void))(uintptr_t)grid->clock)() : clock_of(CLOCK_MONOTONIC);
}

static long long used_by(const Grid *grid)
{
    return grid->processor_time ? ((long long (*)(void))(uintptr_t)grid->processor_time)()
                                : clock_of(CLOCK_THREAD_CPUTIME_ID);
}

/* Below 0: a signal has come, or the file is no timer. */
static int sleep_until_expiry(const Grid *grid)
{
    uint64_t expired;
    if (grid->sleep)
        return ((int (*)(void))(uintptr_t)grid->sleep)();
    return read(grid->file, &expired, sizeof expired) == sizeof expired ? 0 : -1;
}

static int nap(const Grid *grid, long long ns)
{
    if (grid->nap)
        return ((int (*)(long long))(uintptr_t)grid->nap)(ns);
    struct timespec asleep = {ns / 1000000000LL, ns % 1000000000LL};
    return nanosleep(&asleep, NULL);
}

/* As Ticker._is_tired. */
static int is_tired(Grid *grid, long long now)
{
    if (now - grid->looked >= grid->look_after) {
        long long used = used_by(grid);
        double owed = grid->owed + (double)(used - grid->used) - grid->share * (double)(now - grid->looked);
        grid->owed = owed > 0.0 ? owed : 0.0;
        grid->looked = now;
        grid->used = used;
        grid->napped = 0;
    }
    return grid->owed - (double)grid->napped > (double)grid->bearable;
}

enum { MOST_NAP = 50000000 }; /* ns, as MAX_NAP of timerfd.py */

static int interrupted(void)
{
    return errno == EINTR ? UMO_INTERRUPTED : UMO_BY_PYTHON;
}

/* As Ticker.wait, without what Python does meanwhile. Python ends a wait. */
static int32_t tick(void *context, int64_t *raws, int32_t count)
{
    Grid *grid = context;
    volatile char *ended = &grid->ended;
    if (count != 1 || *ended)
        return UMO_BY_PYTHON;
    long long due = grid->next, now = now_of(grid);
    if (now >= due) {
        long long passed = (now - due) / grid->period + 1;
        grid->next = due + passed * grid->period;
        grid->due = grid->next - grid->period;
        grid->woke = now;
        raws[0] = passed;
        return UMO_MOVED;
    }
    if (grid->busy_wait && is_tired(grid, now)) {
        long long begun = now;
        while (now < due && !*ended) {
            int woken = nap(grid, due - now < MOST_NAP ? due - now : MOST_NAP);
            now = now_of(grid);
            if (woken != 0 && now < due) {
                grid->napped += now - begun;
                return interrupted();
            }
        }
        grid->napped += due - begun;
    }
    while (now < due - grid->busy_wait) {
        if (*ended)
            return UMO_BY_PYTHON;
        if (sleep_until_expiry(grid) < 0)
            return interrupted();
        now = now_of(grid);
    }
    while (now < due)
        now = now_of(grid);
    grid->next = due + grid->period;
    grid->due = due;
    grid->woke = now;
    raws[0] = 0;
    return UMO_MOVED;
}
#else
static int32_t tick(void *Py_UNUSED(context), int64_t *Py_UNUSED(raws), int32_t Py_UNUSED(count))
{
    return UMO_BY_PYTHON;
}
#endif

/* address(): the context of `TICK`. */
static PyObject *Grid_address(Grid *self, PyObject *Py_UNUSED(none))
{
    return PyLong_FromVoidPtr(self);
}

#define NUMBER(name, of) {name, T_LONGLONG, offsetof(Grid, of), 0, NULL}
#define FUNCTION(name, of) {name, T_ULONGLONG, offsetof(Grid, of), 0, NULL}
static PyMemberDef grid_members[] = {
    NUMBER("_nanoseconds", period),
    NUMBER("_next", next),
    NUMBER("due", due),
    NUMBER("woke", woke),
    NUMBER("_busy_wait", busy_wait),
    NUMBER("_look_after", look_after),
    NUMBER("_bearable", bearable),
    NUMBER("_looked", looked),
    NUMBER("_used_then", used),
    NUMBER("_napped", napped),
    {"_owed", T_DOUBLE, offsetof(Grid, owed), 0, NULL},
    {"_awake_share", T_DOUBLE, offsetof(Grid, share), 0, NULL},
    {"_fd", T_INT, offsetof(Grid, file), 0, NULL},
    {"_ended", T_BOOL, offsetof(Grid, ended), 0, NULL},
    FUNCTION("c_clock", clock),
    FUNCTION("c_sleep", sleep),
    FUNCTION("c_nap", nap),
    FUNCTION("c_processor_time", processor_time),
    {NULL, 0, 0, 0, NULL},
};
static PyMethodDef grid_methods[] = {{"address", (PyCFunction)Grid_address, METH_NOARGS, NULL}, {NULL, NULL, 0, NULL}};
static PyType_Slot grid_slots[] = {
    {Py_tp_dealloc, Grid_dealloc}, {Py_tp_members, grid_members}, {Py_tp_methods, grid_methods}, {0, NULL},
};
static PyType_Spec grid_spec = {
    "umo.drivers._native.Grid", sizeof(Grid), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_BASETYPE, grid_slots,
};

/* Of channels that are cells in memory; the context is an array of their addresses. */
static int32_t gather(void *context, int64_t *raws, int32_t count)
{
    int64_t *const *cells = context;
    for (int32_t i = 0; i < count; i++)
        raws[i] = *cells[i];
    return UMO_MOVED;
}

static int32_t scatter(void *context, int64_t *raws, int32_t count)
{
    int64_t *const *cells = context;
    for (int32_t i = 0; i < count; i++)
        *cells[i] = raws[i];
    return UMO_MOVED;
}

static int add_function(PyObject *module, const char *name, umo_transfer *function)
{
    PyObject *address = PyLong_FromUnsignedLongLong((unsigned long long)(uintptr_t)function);
    int failed = address == NULL ? -1 : PyModule_AddObjectRef(module, name, address);
    Py_XDECREF(address);
    return failed;
}

static int fill(PyObject *module)
{
    PyObject *type = PyType_FromSpec(&grid_spec);
    int failed = type == NULL ? -1 : PyModule_AddType(module, (PyTypeObject *)type);
    Py_XDECREF(type);
    return failed || add_function(module, "TICK", tick) || add_function(module, "GATHER", gather) ||
                   add_function(module, "SCATTER", scatter)
               ? -1
               : 0;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, fill}, {0, NULL}};
static struct PyModuleDef native = {PyModuleDef_HEAD_INIT, .m_name = "umo.drivers._native", .m_slots = slots};

PyMODINIT_FUNC PyInit__native(void)
{
    return PyModuleDef_Init(&native);
}
