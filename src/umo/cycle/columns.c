/* umo.cycle._columns: what is done with the columns of the process image in each period: the conversion of its blocks
 * (conversion.py), and their copy into a frame (frames/ring.py). Compiled laws have laws.c and watch.c.
 *
 * The same IEEE operations in the same order as objects/scaling.py: compiled without contraction of a * b + c. Only
 * functions of Python's stable interface are used, so that one file serves all versions from 3.11 on.
 */
#include "extension.h"

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0 || defined(__FAST_MATH__)
#error "each operation must be rounded to a double"
#endif

typedef double umo_real;
#define umo_floor floor
#define UMO_FLASH
#include "../generate/runtime/umo_curves.h"
#include "../generate/runtime/umo_scaling.h"

/* Views of the block's part of each column: 8 bytes an object. */
enum { MOVED, RESOLUTION, ZERO_OFFSET, LOW, HIGH, RAWS, VALUES, TIMES, INPUT_VIEWS };
enum { LEAST = LOW, GREATEST, RATE = INPUT_VIEWS, PENDING, SENT, STEPPED, OUTPUT_VIEWS };

/* Of one object of an input block: its linearization, or a raw integer that is an invalid reading though it is within
 * the range. */
typedef struct {
    Py_ssize_t place;
    umo_curve curve;
    int64_t raw;
} Special;

struct Block {
    PyObject_HEAD
    Py_buffer views[OUTPUT_VIEWS];
    Py_ssize_t start, count;
    double *found; /* of an input block: room for a number of each object */
    PyObject *tables; /* of an input block: what the curves point to */
    Special *curves, *invalid;
    Py_ssize_t curve_count, invalid_count;
    Py_buffer written; /* of an output block: a byte of each object (writes.c) */
    int limited; /* whether an output of the block has a rate */
};

static void let_go(PyObject *self, Py_buffer *views, int count)
{
    PyTypeObject *type = Py_TYPE(self);
    for (int i = 0; i < count; i++)
        PyBuffer_Release(&views[i]); /* nothing where there is none */
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(self);
    Py_DECREF(type);
}

static void Block_dealloc(Block *self)
{
    PyMem_Free(self->found);
    PyMem_Free(self->curves);
    PyMem_Free(self->invalid);
    Py_CLEAR(self->tables);
    PyBuffer_Release(&self->written);
    let_go((PyObject *)self, self->views, OUTPUT_VIEWS);
}

static int is_written(int view, Py_ssize_t views)
{
    if (view == MOVED)
        return views == OUTPUT_VIEWS;
    return view == RAWS || view == VALUES || view == TIMES || view == SENT || view == STEPPED;
}

/* From a tuple of views, all of one length. */
static Block *make(PyTypeObject *type, PyObject *views, Py_ssize_t count)
{
    if (!PyTuple_Check(views) || PyTuple_Size(views) != count) {
        PyErr_Format(PyExc_ValueError, "the views of a block are a tuple of %zd", count);
        return NULL;
    }
    Block *self = (Block *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    for (int i = 0; i < count; i++) {
        int flags = is_written(i, count) ? PyBUF_WRITABLE : PyBUF_SIMPLE;
        if (PyObject_GetBuffer(PyTuple_GetItem(views, i), &self->views[i], flags) < 0) {
            Py_DECREF(self);
            return NULL;
        }
    }
    Py_ssize_t size = self->views[MOVED].len;
    self->count = size / (Py_ssize_t)sizeof(int64_t);
    for (int i = 0; i < count; i++)
        if (self->views[i].len != size || size % (Py_ssize_t)sizeof(int64_t)) {
            PyErr_SetString(PyExc_ValueError, "the views of a block differ in length");
            Py_DECREF(self);
            return NULL;
        }
    return self;
}

static double *column(Block *self, int view)
{
    return self->views[view].buf;
}

static void stamp(Block *self, double now)
{
    double *times = column(self, TIMES);
    for (Py_ssize_t i = 0; i < self->count; i++)
        times[i] = now;
}

/* (place, is_cubic, count, first, per_x, bytes of the table) */
static int take_curve(PyObject *given, Special *curve)
{
    const char *table;
    Py_ssize_t size;
    int cubic, count;
    umo_curve *to = &curve->curve;
    if (!PyArg_ParseTuple(given, "npiddy#", &curve->place, &cubic, &count, &to->first, &to->per_x, &table, &size))
        return -1;
    to->cubic = cubic;
    to->count = count;
    Py_ssize_t numbers = cubic ? 5 * ((Py_ssize_t)count + 2) : 3 * (Py_ssize_t)count - 1;
    to->table = (const double *)table;
    if (count >= (cubic ? 1 : 2) && size == 8 * numbers)
        return 0;
    PyErr_SetString(PyExc_ValueError, "the table of a curve has another length");
    return -1;
}

/* (place, raw integer) */
static int take_invalid(PyObject *given, Special *invalid)
{
    long long raw;
    if (!PyArg_ParseTuple(given, "nL", &invalid->place, &raw))
        return -1;
    invalid->raw = raw;
    return 0;
}

typedef int take_function(PyObject *, Special *);

/* A tuple of tuples, each of an object of the block. */
static int take_each(Block *self, PyObject *given, take_function *take, Special **found, Py_ssize_t *number)
{
    Py_ssize_t count = PyTuple_Size(given);
    if (count < 0 || (*found = PyMem_Calloc((size_t)count + 1, sizeof **found)) == NULL)
        return -1;
    for (Py_ssize_t i = 0; i < count; i++) {
        if (take(PyTuple_GetItem(given, i), &(*found)[i]) < 0)
            return -1;
        if ((*found)[i].place < 0 || (*found)[i].place >= self->count) {
            PyErr_SetString(PyExc_ValueError, "no such object in the block");
            return -1;
        }
    }
    *number = count;
    return 0;
}

static PyObject *Inputs_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"views", "start", "curves", "invalid", NULL};
    PyObject *views, *curves, *invalid;
    Py_ssize_t start;
    if (!PyArg_ParseTupleAndKeywords(args, named, "OnO!O!", names, &views, &start, &PyTuple_Type, &curves,
                                     &PyTuple_Type, &invalid))
        return NULL;
    Block *self = make(type, views, INPUT_VIEWS);
    if (self == NULL)
        return NULL;
    self->start = start;
    self->tables = Py_NewRef(curves);
    self->found = PyMem_Malloc((size_t)self->views[MOVED].len);
    int failed = take_each(self, curves, take_curve, &self->curves, &self->curve_count) ||
                 take_each(self, invalid, take_invalid, &self->invalid, &self->invalid_count);
    if (!failed && self->found != NULL)
        return (PyObject *)self;
    Py_DECREF(self);
    return PyErr_Occurred() ? NULL : PyErr_NoMemory();
}

static int append(PyObject *list, Py_ssize_t slot, double value)
{
    PyObject *pair = Py_BuildValue("nd", slot, value);
    int result = pair == NULL ? -1 : PyList_Append(list, pair);
    Py_XDECREF(pair);
    return result;
}

/* (double)whole of whole numbers from -2^51 to 2^51 - 1, by operations that compilers turn into vector instructions.
 * Added to the bits of 1.5 * 2^52, the whole number becomes the low end of the mantissa. */
static double small_to_double(int64_t whole)
{
    uint64_t bits = (uint64_t)whole + 0x4338000000000000u;
    double shifted;
    memcpy(&shifted, &bits, sizeof shifted);
    return shifted - 0x1.8p52;
}

/* The value of each reading into `found`, scaled; whether all are within their bounds. */
static int scale_values(Block *self)
{
    const int64_t *moved = self->views[MOVED].buf;
    const double *resolution = column(self, RESOLUTION), *zero_offset = column(self, ZERO_OFFSET);
    const double *low = column(self, LOW), *high = column(self, HIGH);
    double *restrict found = self->found;
    double inside = 1.0; /* a double, as the values: one type of vectors */
    uint64_t large = 0;
    for (Py_ssize_t i = 0; i < self->count; i++) {
        found[i] = umo_to_value(small_to_double(moved[i]), resolution[i], zero_offset[i]);
        inside = low[i] <= found[i] ? inside : 0.0;
        inside = found[i] <= high[i] ? inside : 0.0;
        large |= ((uint64_t)moved[i] + ((uint64_t)1 << 51)) >> 52;
    }
    if (!large)
        return inside != 0.0;
    int within = 1;
    for (Py_ssize_t i = 0; i < self->count; i++) {
        found[i] = umo_to_value((double)moved[i], resolution[i], zero_offset[i]);
        within &= (low[i] <= found[i]) & (found[i] <= high[i]);
    }
    return within;
}

/* Whether each value that was found is within its bounds, after those that are not only scaled were bent. */
static int bend(Block *self)
{
    const int64_t *moved = self->views[MOVED].buf;
    const double *low = column(self, LOW), *high = column(self, HIGH);
    double *found = self->found;
    for (Py_ssize_t i = 0; i < self->curve_count; i++)
        found[self->curves[i].place] = umo_on_curve(&self->curves[i].curve, found[self->curves[i].place]);
    for (Py_ssize_t i = 0; i < self->invalid_count; i++)
        if (moved[self->invalid[i].place] == self->invalid[i].raw)
            found[self->invalid[i].place] = NAN;
    int within = 1;
    for (Py_ssize_t i = 0; i < self->count; i++)
        within &= (low[i] <= found[i]) & (found[i] <= high[i]);
    return within;
}

/* The value of each reading into `found`; whether all are within their bounds. */
static int find_values(Block *self)
{
    int within = scale_values(self);
    return self->curve_count || self->invalid_count ? bend(self) : within;
}

/* Of values that were found, all within their bounds. */
static void keep_found(Block *self, double now)
{
    size_t size = (size_t)self->views[MOVED].len;
    memcpy(self->views[RAWS].buf, self->views[MOVED].buf, size);
    memcpy(self->views[VALUES].buf, self->found, size);
    stamp(self, now);
}

int inputs_convert(Block *self, double now)
{
    if (!find_values(self))
        return 0;
    keep_found(self, now);
    return 1;
}

static PyObject *Inputs_convert(Block *self, PyObject *time)
{
    double now = PyFloat_AsDouble(time);
    if (now == -1.0 && PyErr_Occurred())
        return NULL;
    if (inputs_convert(self, now))
        return PyTuple_New(0); /* the one that there is: quicker than a list */
    const double *low = column(self, LOW), *high = column(self, HIGH), *found = self->found;
    double *values = column(self, VALUES);
    memcpy(self->views[RAWS].buf, self->views[MOVED].buf, (size_t)self->views[MOVED].len);
    PyObject *outside = PyList_New(0);
    for (Py_ssize_t i = 0; outside != NULL && i < self->count; i++)
        if (low[i] <= found[i] && found[i] <= high[i])
            values[i] = found[i];
        else if (append(outside, self->start + i, found[i]) < 0)
            Py_CLEAR(outside);
    return outside;
}

static PyObject *Outputs_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"views", "written", NULL};
    PyObject *views, *written;
    if (!PyArg_ParseTupleAndKeywords(args, named, "OO", names, &views, &written))
        return NULL;
    Block *self = make(type, views, OUTPUT_VIEWS);
    if (self == NULL)
        return NULL;
    for (Py_ssize_t i = 0; i < self->count; i++)
        self->limited |= column(self, RATE)[i] < INFINITY;
    if (PyObject_GetBuffer(written, &self->written, PyBUF_WRITABLE) == 0) {
        if (self->written.len == self->count)
            return (PyObject *)self;
        PyErr_SetString(PyExc_ValueError, "the views of a block differ in length");
    }
    Py_DECREF(self);
    return NULL;
}

/* As conversion._next, of one output. */
static double step(Block *self, Py_ssize_t i, double now, double dt)
{
    double pending = column(self, PENDING)[i], rate = column(self, RATE)[i], *stepped = &column(self, STEPPED)[i];
    if (!(rate < INFINITY))
        return pending;
    if (!(now > *stepped))
        return column(self, SENT)[i];
    double value = column(self, VALUES)[i], left = pending - value;
    double way = rate * (dt != 0.0 ? dt : now - *stepped);
    *stepped = now;
    return fabs(left) <= way * (1 + 1e-9) ? pending : value + copysign(way, left);
}

void outputs_give(Block *self, double now, double dt)
{
    end_period(self->written.buf, self->count);
    const double *pending = column(self, PENDING);
    double *sent = column(self, SENT);
    if (!self->limited && memcmp(sent, pending, (size_t)self->views[SENT].len) == 0)
        return; /* what was given last is still to be sent */
    const double *resolution = column(self, RESOLUTION), *zero_offset = column(self, ZERO_OFFSET);
    const double *least = column(self, LEAST), *greatest = column(self, GREATEST);
    int64_t *moved = self->views[MOVED].buf;
    for (Py_ssize_t i = 0; i < self->count; i++) {
        double next = self->limited ? step(self, i, now, dt) : pending[i];
        if (memcmp(&next, &sent[i], sizeof next) == 0)
            continue;
        sent[i] = next;
        double raw = rint(umo_to_steps(next, resolution[i], zero_offset[i]));
        raw = raw > least[i] ? raw : least[i];
        moved[i] = (int64_t)(raw < greatest[i] ? raw : greatest[i]);
    }
}

static PyObject *Outputs_give(Block *self, PyObject *const *args, Py_ssize_t count)
{
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "two times are expected");
        return NULL;
    }
    double now = PyFloat_AsDouble(args[0]);
    double dt = now == -1.0 && PyErr_Occurred() ? now : PyFloat_AsDouble(args[1]);
    if (dt == -1.0 && PyErr_Occurred())
        return NULL;
    outputs_give(self, now, dt);
    Py_RETURN_NONE;
}

void outputs_commit(Block *self, double now)
{
    size_t size = (size_t)self->views[MOVED].len;
    memcpy(self->views[RAWS].buf, self->views[MOVED].buf, size);
    memcpy(self->views[VALUES].buf, self->views[SENT].buf, size);
    stamp(self, now);
    double *stepped = column(self, STEPPED);
    for (Py_ssize_t i = 0; self->limited && i < self->count; i++)
        if (stepped[i] == INFINITY)
            stepped[i] = now;
}

static PyObject *Outputs_commit(Block *self, PyObject *time)
{
    double now = PyFloat_AsDouble(time);
    if (now == -1.0 && PyErr_Occurred())
        return NULL;
    outputs_commit(self, now);
    Py_RETURN_NONE;
}

int is_made_by(PyObject *object, newfunc made_by)
{
    return (newfunc)PyType_GetSlot(Py_TYPE(object), Py_tp_new) == made_by;
}

int is_inputs(PyObject *block)
{
    return is_made_by(block, Inputs_new);
}

int is_outputs(PyObject *block)
{
    return is_made_by(block, Outputs_new);
}

int64_t *moved_of(Block *self, Py_ssize_t *count)
{
    *count = self->count;
    return self->views[MOVED].buf;
}

/* A frame's body: all that follows `sequence` and `checksum`. */
enum { MAP, SHOWN, BODY_VIEWS };
enum { AT, NUMBER, TIME, MISSED, BEGAN, WAKE, EXECUTION, SELDOM, PHASES, SIGNALS, ARGUMENTS };

typedef struct {
    PyObject_HEAD
    Py_buffer views[BODY_VIEWS];
    Py_ssize_t size;
} Body;

static void Body_dealloc(Body *self)
{
    let_go((PyObject *)self, self->views, BODY_VIEWS);
}

static PyObject *Body_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"file", "shown", "size", NULL};
    PyObject *views[BODY_VIEWS];
    Py_ssize_t size;
    if (!PyArg_ParseTupleAndKeywords(args, named, "OOn", names, &views[MAP], &views[SHOWN], &size))
        return NULL;
    Body *self = (Body *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->size = size;
    for (int i = 0; i < BODY_VIEWS; i++)
        if (PyObject_GetBuffer(views[i], &self->views[i], i == MAP ? PyBUF_WRITABLE : PyBUF_SIMPLE) < 0) {
            Py_DECREF(self);
            return NULL;
        }
    return (PyObject *)self;
}

static char *put(char *to, const void *from, Py_ssize_t size)
{
    memcpy(to, from, (size_t)size);
    return to + size;
}

/* No code of Python's runs here: a list could become shorter under it. */
static char *put_whole(char *to, PyObject *number)
{
    int64_t whole = 0;
    if (PyLong_Check(number))
        whole = PyLong_AsLongLong(number);
    else
        PyErr_SetString(PyExc_TypeError, "a number of a frame is not an int");
    return put(to, &whole, sizeof whole);
}

static char *put_real(char *to, PyObject *number)
{
    double real = 0.0;
    if (PyFloat_Check(number))
        real = PyFloat_AsDouble(number);
    else
        PyErr_SetString(PyExc_TypeError, "a number of a frame is not a float");
    return put(to, &real, sizeof real);
}

/* Whether the arguments are of the types that are taken for granted, and fill the place in the map exactly. */
static int fits(Body *self, PyObject *const *args, Py_ssize_t at)
{
    if (!PyBytes_Check(args[SELDOM]) || !PyList_Check(args[PHASES]) || !PyList_Check(args[SIGNALS]))
        return 0;
    Py_ssize_t numbers = SELDOM - NUMBER + PyList_Size(args[PHASES]) + PyList_Size(args[SIGNALS]);
    Py_ssize_t size = 8 * numbers + PyBytes_Size(args[SELDOM]) + self->views[SHOWN].len;
    return size == self->size && at >= 0 && at <= self->views[MAP].len - size;
}

static PyObject *Body_write(Body *self, PyObject *const *args, Py_ssize_t count)
{
    Py_ssize_t at = count == ARGUMENTS ? PyLong_AsSsize_t(args[AT]) : -1;
    if (PyErr_Occurred())
        return NULL;
    if (count != ARGUMENTS || !fits(self, args, at)) {
        PyErr_SetString(PyExc_ValueError, "this does not fit the frame");
        return NULL;
    }
    char *to = (char *)self->views[MAP].buf + at;
    to = put_whole(to, args[NUMBER]);
    to = put_real(to, args[TIME]);
    for (int i = MISSED; i <= EXECUTION; i++)
        to = put_whole(to, args[i]);
    to = put(to, PyBytes_AsString(args[SELDOM]), PyBytes_Size(args[SELDOM]));
    Py_ssize_t phases = PyList_Size(args[PHASES]), signals = PyList_Size(args[SIGNALS]);
    for (Py_ssize_t i = 0; i < phases; i++)
        to = put_whole(to, PyList_GetItem(args[PHASES], i));
    for (Py_ssize_t i = 0; i < signals; i++)
        to = put_real(to, PyList_GetItem(args[SIGNALS], i));
    put(to, self->views[SHOWN].buf, self->views[SHOWN].len);
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef inputs_methods[] = {{"convert", (PyCFunction)Inputs_convert, METH_O, NULL}, {NULL, NULL, 0, NULL}};
static PyMethodDef outputs_methods[] = {
    {"give", (PyCFunction)(void (*)(void))Outputs_give, METH_FASTCALL, NULL},
    {"commit", (PyCFunction)Outputs_commit, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};
static PyMethodDef body_methods[] = {
    {"write", (PyCFunction)(void (*)(void))Body_write, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot inputs[] = {
    {Py_tp_new, Inputs_new}, {Py_tp_dealloc, Block_dealloc}, {Py_tp_methods, inputs_methods}, {0, NULL},
};
static PyType_Slot outputs[] = {
    {Py_tp_new, Outputs_new}, {Py_tp_dealloc, Block_dealloc}, {Py_tp_methods, outputs_methods}, {0, NULL},
};
static PyType_Slot body[] = {
    {Py_tp_new, Body_new}, {Py_tp_dealloc, Body_dealloc}, {Py_tp_methods, body_methods}, {0, NULL},
};
static PyType_Spec specs[] = {
    {"umo.cycle._columns.Inputs", sizeof(Block), 0, Py_TPFLAGS_DEFAULT, inputs},
    {"umo.cycle._columns.Outputs", sizeof(Block), 0, Py_TPFLAGS_DEFAULT, outputs},
    {"umo.cycle._columns.Body", sizeof(Body), 0, Py_TPFLAGS_DEFAULT, body},
};

int add_types(PyObject *module, PyType_Spec *from, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        PyObject *type = PyType_FromSpec(&from[i]);
        if (type == NULL)
            return -1;
        int failed = PyModule_AddType(module, (PyTypeObject *)type);
        Py_DECREF(type);
        if (failed)
            return -1;
    }
    return 0;
}

static int fill(PyObject *module)
{
    int failed = add_types(module, specs, sizeof specs / sizeof *specs) || add_law_types(module);
    failed = failed || add_watch_type(module) || add_writes_types(module);
    return failed || add_period_type(module) ? -1 : 0;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, fill}, {0, NULL}};
static struct PyModuleDef columns = {PyModuleDef_HEAD_INIT, .m_name = "umo.cycle._columns", .m_slots = slots};

PyMODINIT_FUNC PyInit__columns(void)
{
    return PyModuleDef_Init(&columns);
}
