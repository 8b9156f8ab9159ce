/* The period of a machine in C, phase by phase in the order of `PHASES` (period.py): umo.generate.period_in_c makes it.
 *
 * Each phase has looks at what it rests on. Where one of them says that something is not as usual, or the phase itself
 * finds that, Python carries the phase out: the function of period.py that would have done so anyway. The loop then
 * ends with the period, and Python sees what has become of it.
 */
#include "extension.h"

#include "../drivers/umo_driver.h"

#include <string.h>
#include <structmember.h>
#include <time.h>

/* A look: whether the attribute of an object is a certain one, is not, or is empty (or 0 or False); or whether the object
 * itself, a list or set that stays the same, has nothing in it: which takes a fifth of the time. */
enum { IS, IS_NOT, EMPTY, NOTHING_IN };

typedef struct {
    PyObject *owner, *name, *value;
    int kind;
} Look;

enum { TICK, SAMPLE, GUARD, COMMANDS, SEQUENCES, LAWS, SETTLE, SEND, SHOW, PHASES };
enum { READ_TIMER, TICKED, SAMPLE_NOW, EVALUATE, ADVANCE, ACT, GO_ON, SETTLE_NOW, UPDATE, FINISH, NOT_READ, SAMPLE_REST,
       UPDATE_REST, CALLS };
enum { NOW, DT, TICKS, NUMBER, MISSED, MISSED_IN_ALL, OPEN, BEGAN, COMMANDING, BEFORE_LAWS, LAWS_OF_GROUP, NAMES };
static const char *const names[NAMES] = {"now",           "dt",   "ticks", "number",     "missed",
                                         "missed_in_all", "open", "began", "commanding", "before_laws", "laws"};

enum { IN_PYTHON = -1 }; /* in the place of the number of looks: a phase that C does not have */
enum { ENDED = 2 }; /* the result of a step with which its phase, or the wait for a tick, has ended */

typedef struct {
    Block *block;
    umo_transfer *move;
    void *context;
    PyObject *watch; /* None, or watch(ns): is told of each transfer, once its phase is done */
    PyObject *call, *channels, *buffer; /* `call`: None, or call(channels, buffer) in the place of `move` */
    int64_t took;
} Moved;

typedef struct {
    PyObject_HEAD
    PyObject *held; /* the arguments: what is pointed to */
    PyObject *clock, *period, *turn, *group, *laws; /* `laws`: a tuple of those that the list of the group has */
    PyObject *calls[CALLS], *names[NAMES];
    Look *looks[PHASES];
    Py_ssize_t look_counts[PHASES];
    Moved *inputs, *outputs;
    Py_ssize_t input_count, output_count, law_count, condition_count;
    Law **acting, **conditions;
    umo_transfer *tick;
    void *tick_context;
    PyObject *read_tick, *tick_channel; /* `read_tick`: None, or read_tick(tick_channel) in the place of `tick` */
    PyObject *watch; /* None, or watch(ns): is told of each wait for a tick */
    int64_t least, most; /* ticks that may be missed */
    double length;       /* of a period in s */
    int64_t *raw; /* of the timer, as the next three */
    double *value, *time;
    uint8_t *quality;
    Py_buffer written; /* bits of what was written, of all actuators */
    uint8_t *written_before;
    double now, dt;
    int64_t began; /* ns */
    int32_t ticks;
    int is_told; /* whether Python knows of the period that has begun */
    int by_python; /* whether Python has carried out a phase of this period */
    char stale;    /* whether something that was bound is another one now */
} Period;

static int Period_traverse(Period *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->held);
    return 0;
}

static int Period_clear(Period *self)
{
    Py_CLEAR(self->held);
    return 0;
}

static void Period_dealloc(Period *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    (void)Period_clear(self);
    for (int i = 0; i < NAMES; i++)
        Py_XDECREF(self->names[i]);
    for (int i = 0; i < PHASES; i++)
        PyMem_Free(self->looks[i]);
    PyMem_Free(self->inputs);
    PyMem_Free(self->outputs);
    PyMem_Free(self->acting);
    PyMem_Free(self->conditions);
    PyMem_Free(self->written_before);
    PyBuffer_Release(&self->written);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

/* Making it ------------------------------------------------------------------------------------------ */

static int refused(const char *what)
{
    PyErr_Format(PyExc_TypeError, "no period in C: %s", what);
    return -1;
}

static int take_looks(Period *self, int phase, PyObject *given)
{
    if (given == Py_None) {
        self->look_counts[phase] = IN_PYTHON;
        return 0;
    }
    Py_ssize_t count = PyTuple_Size(given);
    Look *looks = self->looks[phase] = PyMem_Calloc((size_t)count + 1, sizeof(Look));
    if (count < 0 || looks == NULL)
        return -1;
    for (Py_ssize_t i = 0; i < count; i++)
        if (!PyArg_ParseTuple(PyTuple_GetItem(given, i), "OUiO", &looks[i].owner, &looks[i].name, &looks[i].kind,
                              &looks[i].value))
            return -1;
    self->look_counts[phase] = count;
    return 0;
}

static Moved *take_moved(PyObject *given, int (*is_sound)(PyObject *), Py_ssize_t *count)
{
    *count = PyTuple_Size(given);
    Moved *all = PyMem_Calloc((size_t)*count + 1, sizeof(Moved));
    for (Py_ssize_t i = 0; all != NULL && i < *count; i++) {
        PyObject *block, *watch, *call, *channels, *buffer;
        unsigned long long move, context;
        if (!PyArg_ParseTuple(PyTuple_GetItem(given, i), "OKKOOOO", &block, &move, &context, &watch, &call, &channels,
                              &buffer) ||
            !is_sound(block)) {
            PyMem_Free(all);
            refused("a block");
            return NULL;
        }
        all[i] = (Moved){(Block *)block, (umo_transfer *)(uintptr_t)move, (void *)(uintptr_t)context, watch, call,
                         channels,       buffer,                          0};
    }
    return all;
}

static Law **take_laws(PyObject *given, Py_ssize_t *count)
{
    *count = PyTuple_Size(given);
    Law **all = PyMem_Calloc((size_t)*count + 1, sizeof(Law *));
    for (Py_ssize_t i = 0; all != NULL && i < *count; i++) {
        all[i] = (Law *)PyTuple_GetItem(given, i);
        if (!is_law((PyObject *)all[i])) {
            PyMem_Free(all);
            refused("a law");
            return NULL;
        }
    }
    return all;
}

static int take(Period *self, PyObject *args)
{
    PyObject *looks, *calls, *inputs, *outputs, *conditions, *acting, *written;
    unsigned long long tick, context, raw, value, time, quality;
    long long least, most;
    if (!PyArg_ParseTuple(args, "OOOO(KKLLKKKKOOO)dO!O!O!O!O!O!O!O", &self->clock, &self->period, &self->turn,
                          &self->group, &tick, &context, &least, &most, &raw, &value, &time, &quality, &self->watch,
                          &self->read_tick, &self->tick_channel, &self->length, &PyTuple_Type, &looks, &PyTuple_Type, &calls, &PyTuple_Type, &inputs, &PyTuple_Type, &outputs, &PyTuple_Type,
                          &conditions, &PyTuple_Type, &self->laws, &PyTuple_Type, &acting, &written))
        return -1;
    if (PyTuple_Size(looks) != PHASES || PyTuple_Size(calls) != CALLS || PyTuple_Size(self->laws) != PyTuple_Size(acting))
        return refused("its phases");
    self->tick = (umo_transfer *)(uintptr_t)tick;
    self->tick_context = (void *)(uintptr_t)context;
    self->least = least;
    self->most = most;
    self->raw = (int64_t *)(uintptr_t)raw;
    self->value = (double *)(uintptr_t)value;
    self->time = (double *)(uintptr_t)time;
    self->quality = (uint8_t *)(uintptr_t)quality;
    for (int i = 0; i < CALLS; i++)
        self->calls[i] = PyTuple_GetItem(calls, i);
    for (int i = 0; i < PHASES; i++)
        if (take_looks(self, i, PyTuple_GetItem(looks, i)) < 0)
            return -1;
    for (int i = 0; i < NAMES; i++)
        if ((self->names[i] = PyUnicode_InternFromString(names[i])) == NULL)
            return -1;
    if ((self->inputs = take_moved(inputs, is_inputs, &self->input_count)) == NULL ||
        (self->outputs = take_moved(outputs, is_outputs, &self->output_count)) == NULL ||
        (self->conditions = take_laws(conditions, &self->condition_count)) == NULL ||
        (self->acting = take_laws(acting, &self->law_count)) == NULL ||
        PyObject_GetBuffer(written, &self->written, PyBUF_WRITABLE) < 0)
        return -1;
    self->written_before = PyMem_Malloc((size_t)self->written.len + 1);
    return self->written_before == NULL ? -1 : turn_to(self->turn, Py_None) < 0 ? refused("its turn") : 0;
}

static PyObject *Period_new(PyTypeObject *type, PyObject *args, PyObject *Py_UNUSED(named))
{
    Period *self = (Period *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->held = Py_NewRef(args);
    if (take(self, args) < 0) {
        if (!PyErr_Occurred())
            PyErr_NoMemory();
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* What all phases use: 1: done or as usual, 0: Python is to do it, -1: an error ----------------------- */

static int is_empty(PyObject *object)
{
    int full = PyObject_IsTrue(object);
    return full < 0 ? -1 : !full;
}

static int is_usual(Period *self, const Look *look)
{
    if (look->kind == NOTHING_IN)
        return is_empty(look->owner);
    PyObject *found = PyObject_GetAttr(look->owner, look->name);
    if (found == NULL)
        return -1;
    int usual = look->kind == EMPTY ? is_empty(found) : (found == look->value) == (look->kind == IS);
    self->stale |= usual == 0 && look->kind == IS;
    Py_DECREF(found);
    return usual;
}

static int all_usual(Period *self, int phase)
{
    int usual = self->look_counts[phase] != IN_PYTHON;
    for (Py_ssize_t i = 0; usual > 0 && i < self->look_counts[phase]; i++)
        usual = is_usual(self, &self->looks[phase][i]);
    return usual;
}

static int set(PyObject *owner, PyObject *name, PyObject *value)
{
    int failed = value == NULL ? -1 : PyObject_SetAttr(owner, name, value);
    Py_XDECREF(value);
    return failed;
}

/* As Period.on_tick: before Python is called, or an error is raised. */
static int tell_python(Period *self)
{
    if (self->is_told)
        return 0;
    self->is_told = 1;
    return set(self->period, self->names[BEGAN], PyLong_FromLongLong(self->began)) ||
                   set(self->period, self->names[OPEN], Py_NewRef(Py_True))
               ? -1
               : 0;
}

/* Python carries out a phase. */
static int by_python(Period *self, int call, PyObject *argument)
{
    self->by_python = 1;
    if (tell_python(self) < 0)
        return -1;
    PyObject *done = argument == NULL ? PyObject_CallNoArgs(self->calls[call])
                                      : PyObject_CallFunctionObjArgs(self->calls[call], argument, NULL);
    Py_XDECREF(done);
    return done == NULL ? -1 : 1;
}

/* What was raised, for Python to judge; None: nothing was. */
static PyObject *raised(void)
{
    PyObject *type, *error, *trace;
    PyErr_Fetch(&type, &error, &trace);
    if (type == NULL)
        return Py_NewRef(Py_None);
    PyErr_NormalizeException(&type, &error, &trace);
    if (trace != NULL)
        (void)PyException_SetTraceback(error, trace);
    Py_XDECREF(type);
    Py_XDECREF(trace);
    return error;
}

static int whole(PyObject *owner, PyObject *name, int64_t *number)
{
    PyObject *found = PyObject_GetAttr(owner, name);
    *number = found == NULL ? -1 : PyLong_AsLongLong(found);
    Py_XDECREF(found);
    return *number == -1 && PyErr_Occurred() ? -1 : 0;
}

static int real(PyObject *owner, PyObject *name, double *number)
{
    PyObject *found = PyObject_GetAttr(owner, name);
    *number = found == NULL ? -1.0 : PyFloat_AsDouble(found);
    Py_XDECREF(found);
    return *number == -1.0 && PyErr_Occurred() ? -1 : 0;
}

static int64_t monotonic_ns(void)
{
#ifdef _WIN32
    return 0; /* no period is made there */
#else
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000LL + now.tv_nsec;
#endif
}

/* 0 where nobody is told how long something takes. */
static int64_t time_for(PyObject *watch)
{
    return watch == Py_None ? 0 : monotonic_ns();
}

static int tell_watch(PyObject *watch, int64_t took)
{
    PyObject *done = watch == Py_None ? Py_NewRef(Py_None) : PyObject_CallFunction(watch, "L", (long long)took);
    Py_XDECREF(done);
    return done == NULL ? -1 : 1;
}

/* TICK ------------------------------------------------------------------------------------------------ */

/* As Clock.advance. */
static int advance(Period *self, int64_t missed)
{
    PyObject **name = self->names;
    int64_t number, before;
    self->began = monotonic_ns();
    self->is_told = 0;
    if (whole(self->clock, name[NUMBER], &number))
        return -1;
    if (missed && (whole(self->clock, name[MISSED_IN_ALL], &before) ||
                   set(self->clock, name[MISSED_IN_ALL], PyLong_FromLongLong(before + missed))))
        return -1;
    self->ticks = missed > 1 ? (int32_t)missed : 1;
    number += self->ticks;
    self->now = (double)number * self->length;
    self->dt = self->ticks * self->length;
    if (set(self->clock, name[MISSED], PyLong_FromLongLong(missed)) ||
        set(self->clock, name[TICKS], PyLong_FromLong(self->ticks)) ||
        set(self->clock, name[NUMBER], PyLong_FromLongLong(number)) ||
        set(self->clock, name[NOW], PyFloat_FromDouble(self->now)) ||
        set(self->clock, name[DT], PyFloat_FromDouble(self->dt)))
        return -1;
    *self->raw = missed;
    *self->value = (double)missed;
    *self->time = self->now;
    return 1;
}

/* The clock, where Python has advanced it. */
static int times_of_clock(Period *self)
{
    int64_t ticks;
    if (real(self->clock, self->names[NOW], &self->now) || real(self->clock, self->names[DT], &self->dt) ||
        whole(self->clock, self->names[TICKS], &ticks) || whole(self->period, self->names[BEGAN], &self->began))
        return -1;
    self->ticks = (int32_t)ticks;
    return 1;
}

/* UMO_INTERRUPTED: an error. */
static int32_t wait_for_tick(Period *self, int64_t *missed)
{
    int32_t status;
    int64_t began = time_for(self->watch);
    do {
        if (PyErr_CheckSignals() < 0)
            return UMO_INTERRUPTED;
        Py_BEGIN_ALLOW_THREADS
        status = self->tick(self->tick_context, missed, 1);
        Py_END_ALLOW_THREADS
    } while (status == UMO_INTERRUPTED);
    return status == UMO_MOVED && tell_watch(self->watch, time_for(self->watch) - began) < 0 ? UMO_INTERRUPTED : status;
}

/* What Python has read of the timer: the clock goes on, or a stop has ended the wait. */
static int was_read(Period *self, PyObject *found)
{
    double missed = found == NULL ? -1.0 : PyFloat_AsDouble(found);
    Py_XDECREF(found);
    if (missed == -1.0 && PyErr_Occurred())
        return -1;
    return missed < 0.0 ? ENDED : times_of_clock(self);
}

/* The driver reads the timer, in Python. ENDED: what it has raised was judged, and `done` is the result of that. */
static int read_tick(Period *self, int64_t *missed, int *done)
{
    PyObject *found = PyObject_CallFunctionObjArgs(self->read_tick, self->tick_channel, NULL);
    PyObject *number = found == NULL ? NULL : PyNumber_Index(found);
    *missed = number == NULL ? -1 : PyLong_AsLongLong(number);
    Py_XDECREF(found);
    Py_XDECREF(number);
    if (!PyErr_Occurred())
        return 1;
    PyObject *error = raised();
    self->by_python = 1;
    *done = was_read(self, PyObject_CallFunctionObjArgs(self->calls[NOT_READ], error, NULL));
    Py_DECREF(error);
    return ENDED;
}

static int tick(Period *self)
{
    int usual = all_usual(self, TICK), result = 1;
    if (usual <= 0)
        return usual;
    int64_t missed = 0;
    if (self->read_tick != Py_None) {
        if (read_tick(self, &missed, &result) == ENDED)
            return result;
    } else {
        int32_t status = wait_for_tick(self, &missed);
        if (status != UMO_MOVED)
            return status == UMO_INTERRUPTED ? -1 : 0;
    }
    if (missed >= self->least && missed <= self->most && *self->quality == 0)
        return advance(self, missed);
    PyObject *found = PyLong_FromLongLong(missed); /* the tick has come: it is to be judged */
    int done = found == NULL ? -1 : by_python(self, TICKED, found);
    Py_XDECREF(found);
    return done < 0 ? done : times_of_clock(self);
}

static int tick_by_python(Period *self)
{
    self->by_python = 1;
    return was_read(self, PyObject_CallNoArgs(self->calls[READ_TIMER]));
}

/* SAMPLE and GUARD ------------------------------------------------------------------------------------ */

static int move(Moved *moved)
{
    if (moved->call != Py_None) {
        PyObject *none = PyObject_CallFunctionObjArgs(moved->call, moved->channels, moved->buffer, NULL);
        Py_XDECREF(none);
        return none == NULL ? -1 : 1;
    }
    Py_ssize_t count;
    int64_t *raws = moved_of(moved->block, &count), began = time_for(moved->watch);
    int done = moved->move(moved->context, raws, (int32_t)count) == UMO_MOVED;
    moved->took = time_for(moved->watch) - began;
    return done;
}

/* A phase is done: none of these is moved by Python once more. */
static int were_moved(const Moved *all, Py_ssize_t count)
{
    int done = 1;
    for (Py_ssize_t i = 0; done > 0 && i < count; i++)
        done = tell_watch(all[i].watch, all[i].took);
    return done;
}

/* The transfers before this one are done: Python goes on with it, or with what it has raised. */
static int go_on_at(Period *self, int call, const Moved *all, Py_ssize_t place)
{
    PyObject *error = raised(), *done = NULL;
    self->by_python = 1;
    if (tell_python(self) == 0 && were_moved(all, place) > 0)
        done = PyObject_CallFunction(self->calls[call], "nO", place, error);
    Py_DECREF(error);
    Py_XDECREF(done);
    return done == NULL ? -1 : ENDED;
}

static int sample(Period *self)
{
    int usual = all_usual(self, SAMPLE);
    for (Py_ssize_t i = 0; usual > 0 && i < self->input_count; i++) {
        Py_ssize_t count;
        int64_t *raws = moved_of(self->inputs[i].block, &count);
        for (Py_ssize_t n = 0; n < count; n++)
            raws[n] = UMO_UNREAD;
        if (move(&self->inputs[i]) <= 0)
            return go_on_at(self, SAMPLE_REST, self->inputs, i);
    }
    for (Py_ssize_t i = 0; usual > 0 && i < self->input_count; i++)
        if (inputs_convert(self->inputs[i].block, self->now) <= 0)
            return go_on_at(self, SAMPLE_REST, self->inputs, self->input_count);
    return usual > 0 ? were_moved(self->inputs, self->input_count) : usual;
}

/* That no interlock begins or ends. */
static int guard(Period *self)
{
    int usual = all_usual(self, GUARD);
    for (Py_ssize_t i = 0; usual > 0 && i < self->condition_count; i++)
        usual = law_is_false(self->conditions[i], self->now, self->dt, self->ticks);
    return usual;
}

static int sample_and_guard(Period *self)
{
    int done = sample(self);
    if (done == 0)
        done = by_python(self, SAMPLE_NOW, NULL);
    done = done < 0 ? done : guard(self);
    return done == 0 ? by_python(self, EVALUATE, NULL) : done;
}

/* COMMANDS to SETTLE ---------------------------------------------------------------------------------- */

/* What a list of the period has. */
static int call_each(Period *self, int name)
{
    PyObject *calls = PyObject_GetAttr(self->period, self->names[name]);
    int result = calls == NULL || !PyList_Check(calls) ? -1 : 1;
    for (Py_ssize_t i = 0; result > 0 && i < PyList_Size(calls); i++) {
        PyObject *call = Py_NewRef(PyList_GetItem(calls, i)), *done = PyObject_CallNoArgs(call);
        Py_DECREF(call);
        Py_XDECREF(done);
        result = done == NULL ? -1 : 1;
    }
    Py_XDECREF(calls);
    return result;
}

/* Whether the next law is the one that was bound, and still in C. */
static int is_in_c(Period *self, PyObject *list, Py_ssize_t at)
{
    int same = PyList_Size(list) == self->law_count && PyList_GetItem(list, at) == PyTuple_GetItem(self->laws, at) &&
               !law_has_ended(self->acting[at]);
    self->stale |= !same;
    return same;
}

/* The laws of this list; those from the first one on that is not in C, or has a fault, by Python. */
static int act_each(Period *self, PyObject *list)
{
    Py_ssize_t at = 0;
    int16_t fault = 0;
    for (; fault == 0 && at < self->law_count && is_in_c(self, list, at); at += fault == 0) {
        (void)turn_to(self->turn, PyTuple_GetItem(self->laws, at));
        fault = law_fault(self->acting[at], self->now, self->dt, self->ticks);
    }
    (void)turn_to(self->turn, Py_None);
    if (at == self->law_count && PyList_Size(list) == at)
        return 1;
    for (Py_ssize_t i = 0; i < at; i++)
        law_was_called(self->acting[i], 0);
    if (fault != 0)
        law_was_called(self->acting[at], fault);
    return by_python(self, GO_ON, list);
}

static int act(Period *self)
{
    int usual = all_usual(self, LAWS);
    if (usual <= 0)
        return usual < 0 ? usual : by_python(self, ACT, NULL);
    PyObject *list = PyObject_GetAttr(self->group, self->names[LAWS_OF_GROUP]);
    int done = list == NULL || !PyList_Check(list) ? -1 : act_each(self, list);
    Py_XDECREF(list);
    usual = done < 0 ? done : all_usual(self, SETTLE);
    return usual == 0 ? by_python(self, SETTLE_NOW, NULL) : usual;
}

static int control(Period *self)
{
    int done = all_usual(self, COMMANDS);
    if (done == 0) {
        self->by_python = 1;
        done = tell_python(self) < 0 ? -1 : call_each(self, COMMANDING);
    }
    done = done < 0 ? -1 : all_usual(self, SEQUENCES);
    if (done == 0)
        done = by_python(self, ADVANCE, self->clock);
    return done < 0 || call_each(self, BEFORE_LAWS) < 0 ? -1 : act(self);
}

/* SEND and SHOW --------------------------------------------------------------------------------------- */

static int send_blocks(Period *self)
{
    for (Py_ssize_t i = 0; i < self->output_count; i++) {
        Block *block = self->outputs[i].block;
        memcpy(self->written_before, self->written.buf, (size_t)self->written.len);
        outputs_give(block, self->now, self->dt);
        int done = move(&self->outputs[i]);
        if (done == 0) /* Python gives it once more */
            memcpy(self->written.buf, self->written_before, (size_t)self->written.len);
        if (done <= 0)
            return go_on_at(self, UPDATE_REST, self->outputs, i);
        outputs_commit(block, self->now);
    }
    return were_moved(self->outputs, self->output_count);
}

static int update(Period *self)
{
    int usual = all_usual(self, SEND);
    if (usual > 0)
        usual = send_blocks(self);
    if (usual <= 0)
        return usual < 0 ? usual : by_python(self, UPDATE, NULL);
    if (usual == ENDED)
        return 1;
    usual = all_usual(self, SHOW);
    if (usual <= 0)
        return usual < 0 ? usual : by_python(self, FINISH, NULL);
    return self->is_told && set(self->period, self->names[OPEN], Py_NewRef(Py_False)) ? -1 : 1;
}

/* Periods --------------------------------------------------------------------------------------------- */

/* One period. 0: a stop has ended the wait for its tick; or, where others came before, its tick is Python's. */
static int one_period(Period *self, int is_first)
{
    self->is_told = 1; /* of the one before */
    int done = tick(self);
    if (done == 0 && is_first)
        done = tick_by_python(self);
    if (done == ENDED)
        return 0;
    return done <= 0 || (done = sample_and_guard(self)) <= 0 || (done = control(self)) <= 0 ? done : update(self);
}

static int note(Period *self, int64_t *row)
{
    row[1] = self->began;
    row[2] = monotonic_ns();
    return whole(self->clock, self->names[MISSED], &row[0]);
}

/* A period has an error: it is open, as in Python. */
static PyObject *failed(Period *self)
{
    PyObject *type, *value, *trace;
    PyErr_Fetch(&type, &value, &trace);
    if (tell_python(self) < 0)
        PyErr_Clear();
    PyErr_Restore(type, value, trace);
    return NULL;
}

/* run(most, rows): periods until Python has carried out a phase of one, at most so many; how many. 0: a stop has ended
 * the wait. `rows`: None, or memory for the ticks that each one has missed, and the times in ns at which it
 * began and ended. */
static PyObject *Period_run(Period *self, PyObject *args)
{
    Py_ssize_t most, count = 0;
    PyObject *given;
    Py_buffer rows = {0};
    if (!PyArg_ParseTuple(args, "nO", &most, &given))
        return NULL;
    if (given != Py_None && PyObject_GetBuffer(given, &rows, PyBUF_WRITABLE) < 0)
        return NULL;
    int64_t *row = rows.buf;
    int done = row != NULL && rows.len < most * (Py_ssize_t)(3 * sizeof *row) ? refused("too few rows") : 1;
    self->by_python = 0;
    self->is_told = 1;
    while (done > 0 && count < most && !self->by_python) {
        done = one_period(self, count == 0);
        if (done > 0 && row != NULL && note(self, &row[3 * count]) < 0)
            done = -1;
        count += done > 0;
    }
    PyBuffer_Release(&rows);
    return done < 0 ? failed(self) : PyLong_FromSsize_t(count);
}

static PyMemberDef period_members[] = {{"stale", T_BOOL, offsetof(Period, stale), READONLY, NULL}, {NULL, 0, 0, 0, NULL}};
static PyMethodDef period_methods[] = {{"run", (PyCFunction)Period_run, METH_VARARGS, NULL}, {NULL, NULL, 0, NULL}};
static PyType_Slot period_slots[] = {
    {Py_tp_new, Period_new}, {Py_tp_dealloc, Period_dealloc}, {Py_tp_traverse, Period_traverse},
    {Py_tp_clear, Period_clear}, {Py_tp_members, period_members}, {Py_tp_methods, period_methods}, {0, NULL},
};
static PyType_Spec specs[] = {
    {"umo.cycle._columns.Period", sizeof(Period), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, period_slots},
};

int add_period_type(PyObject *module)
{
    return add_types(module, specs, sizeof specs / sizeof *specs);
}
