/* What control code writes to actuators, and who writes it (writes.py). */
#include "extension.h"

#include <stdint.h>
#include <string.h>
#include <structmember.h>

/* Who takes a step at this moment: a started sequence, else a law, else neither (None). */
typedef struct {
    PyObject_HEAD
    PyObject *task, *law;
} Turn;

static int Turn_traverse(Turn *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->task);
    Py_VISIT(self->law);
    return 0;
}

static int Turn_clear(Turn *self)
{
    Py_CLEAR(self->task);
    Py_CLEAR(self->law);
    return 0;
}

static void Turn_dealloc(Turn *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    (void)Turn_clear(self);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

static PyObject *Turn_new(PyTypeObject *type, PyObject *Py_UNUSED(args), PyObject *Py_UNUSED(named))
{
    Turn *self = (Turn *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->task = Py_NewRef(Py_None);
    self->law = Py_NewRef(Py_None);
    return (PyObject *)self;
}

int turn_to(PyObject *turn, PyObject *law)
{
    if (!is_made_by(turn, Turn_new))
        return -1;
    Turn *self = (Turn *)turn;
    PyObject *before = self->law;
    self->law = Py_NewRef(law);
    Py_XDECREF(before);
    return 0;
}

/* address(): of the reference to the law, for compiled laws. */
static PyObject *Turn_address(Turn *self, PyObject *Py_UNUSED(none))
{
    return PyLong_FromVoidPtr(&self->law);
}

static PyMemberDef turn_members[] = {
    {"task", T_OBJECT_EX, offsetof(Turn, task), 0, NULL},
    {"law", T_OBJECT_EX, offsetof(Turn, law), 0, NULL},
    {NULL, 0, 0, 0, NULL},
};
static PyMethodDef turn_methods[] = {{"address", (PyCFunction)Turn_address, METH_NOARGS, NULL}, {NULL, NULL, 0, NULL}};
static PyType_Slot turn_slots[] = {
    {Py_tp_new, Turn_new}, {Py_tp_dealloc, Turn_dealloc}, {Py_tp_traverse, Turn_traverse}, {Py_tp_clear, Turn_clear},
    {Py_tp_members, turn_members}, {Py_tp_methods, turn_methods}, {0, NULL},
};

/* Writes(restrictions, pending, written, owners, turn, command, changed): the way into the image. */
enum { RESTRICTIONS, PENDING, WRITTEN, OWNERS, COLUMNS };
enum { LAST = 1, NOW = 2, UNSEEN = 64, TOLD = 128 }; /* bits of `written`, as in columns.py */

typedef struct {
    PyObject_HEAD
    Py_buffer views[COLUMNS];
    Py_ssize_t count;
    Turn *turn;
    PyObject *command; /* command(slot, value): the command stage is asked */
    PyObject *changed; /* changed(slots, before, values): another one than before writes these values */
} Writes;

static int Writes_traverse(Writes *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->turn);
    Py_VISIT(self->command);
    Py_VISIT(self->changed);
    return 0;
}

static int Writes_clear(Writes *self)
{
    Py_CLEAR(self->turn);
    Py_CLEAR(self->command);
    Py_CLEAR(self->changed);
    return 0;
}

static void Writes_dealloc(Writes *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    (void)Writes_clear(self);
    for (int i = 0; i < COLUMNS; i++)
        PyBuffer_Release(&self->views[i]);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

static int take_views(Writes *self, PyObject *const *columns)
{
    static const Py_ssize_t width[COLUMNS] = {1, 8, 1, sizeof(void *)};
    for (int i = 0; i < COLUMNS; i++) {
        if (PyObject_GetBuffer(columns[i], &self->views[i], i == RESTRICTIONS ? PyBUF_SIMPLE : PyBUF_WRITABLE) < 0)
            return -1;
        if (self->views[i].len != width[i] * self->views[RESTRICTIONS].len) {
            PyErr_SetString(PyExc_ValueError, "the columns differ in length");
            return -1;
        }
    }
    self->count = self->views[RESTRICTIONS].len;
    return 0;
}

static PyObject *Writes_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"restrictions", "pending", "written", "owners", "turn", "command", "changed", NULL};
    PyObject *columns[COLUMNS], *turn, *command, *changed;
    if (!PyArg_ParseTupleAndKeywords(args, named, "OOOOOOO", names, &columns[0], &columns[1], &columns[2], &columns[3],
                                     &turn, &command, &changed))
        return NULL;
    if (!is_made_by(turn, Turn_new)) {
        PyErr_SetString(PyExc_TypeError, "this is no Turn");
        return NULL;
    }
    Writes *self = (Writes *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->turn = (Turn *)Py_NewRef(turn);
    self->command = Py_NewRef(command);
    self->changed = Py_NewRef(changed);
    if (take_views(self, columns) < 0) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static void *writer(Writes *self)
{
    Turn *turn = self->turn;
    return turn->task != Py_None ? turn->task : turn->law;
}

static uint8_t *bytes_of(Writes *self, int column)
{
    return self->views[column].buf;
}

static double *pending_of(Writes *self)
{
    return self->views[PENDING].buf;
}

static int append_number(PyObject *list, PyObject *number)
{
    int result = number == NULL ? -1 : PyList_Append(list, number);
    Py_XDECREF(number);
    return result;
}

/* Another one than before writes this. */
static int change(Writes *self, Py_ssize_t slot, double before, double value)
{
    PyObject *done = PyObject_CallFunction(self->changed, "[n][d][d]", slot, before, value);
    Py_XDECREF(done);
    return done == NULL ? -1 : 0;
}

/* It was taken. */
static int note(Writes *self, Py_ssize_t slot, double before, double value)
{
    void **owners = self->views[OWNERS].buf, *who = writer(self);
    uint8_t *written = bytes_of(self, WRITTEN);
    if (owners[slot] != who) {
        if (before == value)
            written[slot] |= UNSEEN;
        else if (written[slot] < TOLD && change(self, slot, before, value) < 0)
            return -1;
        owners[slot] = who;
    }
    written[slot] |= NOW;
    return 0;
}

static int arguments(Writes *self, PyObject *const *args, Py_ssize_t count, Py_ssize_t *slot, double *value)
{
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "a slot and a value are expected");
        return -1;
    }
    *slot = PyLong_AsSsize_t(args[0]);
    if (*slot < 0 || *slot >= self->count) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_IndexError, "there is no such slot");
        return -1;
    }
    *value = PyFloat_AsDouble(args[1]);
    return *value == -1.0 && PyErr_Occurred() ? -1 : 0;
}

/* write(slot, value): whether a value within the range was taken. */
static PyObject *Writes_write(Writes *self, PyObject *const *args, Py_ssize_t count)
{
    Py_ssize_t slot;
    double value;
    if (arguments(self, args, count, &slot, &value) < 0)
        return NULL;
    double before = pending_of(self)[slot];
    if (bytes_of(self, RESTRICTIONS)[slot]) {
        PyObject *taken = PyObject_CallFunctionObjArgs(self->command, args[0], args[1], NULL);
        if (taken == Py_True && note(self, slot, before, value) < 0)
            Py_CLEAR(taken);
        return taken;
    }
    if (note(self, slot, before, value) < 0)
        return NULL;
    pending_of(self)[slot] = value;
    Py_RETURN_TRUE;
}

/* Which slots: first + i * step, or those of an array. */
typedef struct {
    Py_buffer array; /* of int64; `obj` is NULL where there is none */
    Py_ssize_t first, step, count;
} Places;

static Py_ssize_t place(const Places *places, Py_ssize_t i)
{
    return places->array.obj == NULL ? places->first + i * places->step
                                     : (Py_ssize_t)((const int64_t *)places->array.buf)[i];
}

static int take_places(Writes *self, PyObject *slots, Places *places)
{
    places->array.obj = NULL;
    if (PySlice_Check(slots)) {
        Py_ssize_t end;
        if (PySlice_Unpack(slots, &places->first, &end, &places->step) < 0)
            return -1;
        places->count = PySlice_AdjustIndices(self->count, &places->first, &end, places->step);
        return 0;
    }
    if (PyObject_GetBuffer(slots, &places->array, PyBUF_SIMPLE) < 0)
        return -1;
    places->count = places->array.len / (Py_ssize_t)sizeof(int64_t);
    for (Py_ssize_t i = 0; i < places->count; i++)
        if (place(places, i) < 0 || place(places, i) >= self->count) {
            PyBuffer_Release(&places->array);
            PyErr_SetString(PyExc_IndexError, "there is no such slot");
            return -1;
        }
    return 0;
}

static double value_at(const Py_buffer *values, Py_ssize_t i)
{
    double value;
    memcpy(&value, (const char *)values->buf + i * values->strides[0], sizeof value);
    return value;
}

/* Those of them that another one than before writes are told together. */
static int change_many(Writes *self, const Places *places, const Py_buffer *values)
{
    void **owners = self->views[OWNERS].buf, *who = writer(self);
    const uint8_t *written = bytes_of(self, WRITTEN);
    PyObject *slots = NULL, *before = NULL, *after = NULL;
    for (Py_ssize_t i = 0; i < places->count; i++) {
        Py_ssize_t slot = place(places, i);
        if (owners[slot] == who || written[slot] >= TOLD || pending_of(self)[slot] == value_at(values, i))
            continue;
        if (slots == NULL && ((slots = PyList_New(0)) == NULL || (before = PyList_New(0)) == NULL ||
                              (after = PyList_New(0)) == NULL))
            break;
        if (append_number(slots, PyLong_FromSsize_t(slot)) < 0 ||
            append_number(before, PyFloat_FromDouble(pending_of(self)[slot])) < 0 ||
            append_number(after, PyFloat_FromDouble(value_at(values, i))) < 0)
            break;
    }
    int failed = PyErr_Occurred() != NULL;
    if (!failed && slots != NULL) {
        PyObject *done = PyObject_CallFunctionObjArgs(self->changed, slots, before, after, NULL);
        failed = done == NULL;
        Py_XDECREF(done);
    }
    Py_XDECREF(slots);
    Py_XDECREF(before);
    Py_XDECREF(after);
    return failed ? -1 : 0;
}

static int is_any_restricted(Writes *self, const Places *places)
{
    const uint8_t *restrictions = bytes_of(self, RESTRICTIONS);
    for (Py_ssize_t i = 0; i < places->count; i++)
        if (restrictions[place(places, i)])
            return 1;
    return 0;
}

/* Whether nobody else has written one of them before, none is restricted, and all are there. */
static inline int is_plain(Writes *self, const Places *places, const int64_t *array)
{
    const uint8_t *restrictions = bytes_of(self, RESTRICTIONS);
    void *const *owners = self->views[OWNERS].buf, *who = writer(self);
    const Py_ssize_t first = places->first, step = places->step;
    int others = 0;
    for (Py_ssize_t i = 0; i < places->count; i++) {
        Py_ssize_t slot = array == NULL ? first + i * step : (Py_ssize_t)array[i];
        others |= restrictions[slot] | (owners[slot] != who);
    }
    return !others;
}

static inline void put_plain(Writes *self, const Places *places, const int64_t *array, const char *values,
                             Py_ssize_t stride)
{
    uint8_t *restrict written = bytes_of(self, WRITTEN);
    double *restrict pending = pending_of(self);
    const Py_ssize_t first = places->first, step = places->step;
    for (Py_ssize_t i = 0; i < places->count; i++) {
        Py_ssize_t slot = array == NULL ? first + i * step : (Py_ssize_t)array[i];
        memcpy(&pending[slot], values + i * stride, sizeof(double));
        written[slot] |= NOW;
    }
}

/* Those of one writer: 1: done; 0: it has to be looked at each of them. */
static int put_at_once(Writes *self, const Places *places, const Py_buffer *values)
{
    const int64_t *array = places->array.obj == NULL ? NULL : places->array.buf;
    if (values->strides[0] != sizeof(double) || !(array ? is_plain(self, places, array) : is_plain(self, places, NULL)))
        return 0;
    if (array)
        put_plain(self, places, array, values->buf, sizeof(double));
    else
        put_plain(self, places, NULL, values->buf, sizeof(double));
    return 1;
}

static PyObject *put_many(Writes *self, const Places *places, const Py_buffer *values)
{
    if (values->ndim != 1 || values->itemsize != sizeof(double) || values->shape[0] != places->count) {
        PyErr_SetString(PyExc_ValueError, "there is not one value for each slot");
        return NULL;
    }
    if (put_at_once(self, places, values))
        Py_RETURN_TRUE;
    if (is_any_restricted(self, places))
        Py_RETURN_FALSE;
    if (change_many(self, places, values) < 0)
        return NULL;
    void **owners = self->views[OWNERS].buf, *who = writer(self);
    uint8_t *written = bytes_of(self, WRITTEN);
    double *pending = pending_of(self);
    for (Py_ssize_t i = 0; i < places->count; i++) {
        Py_ssize_t slot = place(places, i);
        double value = value_at(values, i);
        written[slot] |= owners[slot] != who && pending[slot] == value ? NOW | UNSEEN : NOW;
        owners[slot] = who;
        pending[slot] = value;
    }
    Py_RETURN_TRUE;
}

/* write_many(slots, values): as `write` of each, unless one is restricted: then nothing is done, and the result is
 * False. `slots`: a slice or an array of int64; `values`: an array of doubles. */
static PyObject *Writes_write_many(Writes *self, PyObject *const *args, Py_ssize_t count)
{
    Places places;
    Py_buffer values;
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "slots and values are expected");
        return NULL;
    }
    if (take_places(self, args[0], &places) < 0)
        return NULL;
    PyObject *taken = NULL;
    if (PyObject_GetBuffer(args[1], &values, PyBUF_STRIDES) == 0) {
        taken = put_many(self, &places, &values);
        PyBuffer_Release(&values);
    }
    if (places.array.obj != NULL)
        PyBuffer_Release(&places.array);
    return taken;
}

/* note(slot, before, value): a value was taken by other ways. */
static PyObject *Writes_note(Writes *self, PyObject *args)
{
    Py_ssize_t slot;
    double before, value;
    if (!PyArg_ParseTuple(args, "ndd", &slot, &before, &value))
        return NULL;
    if (slot < 0 || slot >= self->count) {
        PyErr_SetString(PyExc_IndexError, "there is no such slot");
        return NULL;
    }
    if (note(self, slot, before, value) < 0)
        return NULL;
    Py_RETURN_NONE;
}

static uint64_t sent(uint64_t bytes)
{
    static const uint64_t each = 0x0101010101010101u;
    return (bytes & each * (TOLD | UNSEEN)) | (bytes & each * NOW) >> 1;
}

/* What was written is sent: what was written now was written last. Eight bytes at once. */
void end_period(uint8_t *written, Py_ssize_t count)
{
    uint64_t bytes = 0;
    const Py_ssize_t width = sizeof bytes, whole = count - count % width;
    for (Py_ssize_t i = 0; i < whole; i += width) {
        memcpy(&bytes, written + i, sizeof bytes);
        bytes = sent(bytes);
        memcpy(written + i, &bytes, sizeof bytes);
    }
    size_t rest = (size_t)(count - whole);
    memcpy(&bytes, written + whole, rest);
    bytes = sent(bytes);
    memcpy(written + whole, &bytes, rest);
}

/* end_period(written): the same from Python. */
static PyObject *end_period_of(PyObject *Py_UNUSED(module), PyObject *written)
{
    Py_buffer view;
    if (PyObject_GetBuffer(written, &view, PyBUF_WRITABLE) < 0)
        return NULL;
    end_period(view.buf, view.len);
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

static PyMethodDef functions[] = {{"end_period", end_period_of, METH_O, NULL}, {NULL, NULL, 0, NULL}};
static PyMethodDef writes_methods[] = {
    {"write", (PyCFunction)(void (*)(void))Writes_write, METH_FASTCALL, NULL},
    {"write_many", (PyCFunction)(void (*)(void))Writes_write_many, METH_FASTCALL, NULL},
    {"note", (PyCFunction)Writes_note, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot writes_slots[] = {
    {Py_tp_new, Writes_new}, {Py_tp_dealloc, Writes_dealloc}, {Py_tp_traverse, Writes_traverse},
    {Py_tp_clear, Writes_clear}, {Py_tp_methods, writes_methods}, {0, NULL},
};
static PyType_Spec specs[] = {
    {"umo.cycle._columns.Turn", sizeof(Turn), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, turn_slots},
    {"umo.cycle._columns.Writes", sizeof(Writes), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, writes_slots},
};

int add_writes_types(PyObject *module)
{
    return add_types(module, specs, sizeof specs / sizeof *specs) || PyModule_AddFunctions(module, functions);
}
