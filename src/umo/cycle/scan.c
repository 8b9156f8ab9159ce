/* umo.cycle._scan: what the compiled form of the process image (forms.py) does with a block in each period.
 *
 * The same IEEE operations in the same order as objects/scaling.py: compiled without contraction of a * b + c.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <float.h>
#include <stdint.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0 || defined(__FAST_MATH__)
#error "each operation must be rounded to a double"
#endif

/* Views of the block's part of the image: 8 bytes an object, SCALES 32 bytes. */
enum { MOVED, SCALES, PENDING = SCALES, RAWS, VALUES, TIMES, VIEWS };

typedef struct {
    PyObject_HEAD
    Py_buffer views[VIEWS];
    Py_ssize_t start, count;
} Block;

static void Block_dealloc(Block *self)
{
    PyTypeObject *type = Py_TYPE(self);
    for (int i = 0; i < VIEWS; i++)
        PyBuffer_Release(&self->views[i]); /* nothing where there is none */
    type->tp_free(self);
    Py_DECREF(type);
}

/* All views have one length; the second one has so many numbers an object. */
static PyObject *make(PyTypeObject *type, PyObject *const objects[VIEWS], Py_ssize_t start, Py_ssize_t numbers)
{
    Block *self = (Block *)type->tp_alloc(type, 0);
    if (self == NULL)
        return NULL;
    for (int i = 0; i < VIEWS; i++)
        if (PyObject_GetBuffer(objects[i], &self->views[i], i < RAWS ? PyBUF_SIMPLE : PyBUF_WRITABLE) < 0) {
            Py_DECREF(self);
            return NULL;
        }
    Py_ssize_t size = self->views[MOVED].len;
    self->start = start;
    self->count = size / (Py_ssize_t)sizeof(int64_t);
    for (int i = 0; i < VIEWS; i++)
        if (self->views[i].len != (i == SCALES ? numbers : 1) * size || size % (Py_ssize_t)sizeof(int64_t)) {
            PyErr_SetString(PyExc_ValueError, "the views of a block differ in length");
            Py_DECREF(self);
            return NULL;
        }
    return (PyObject *)self;
}

static void stamp(Block *self, double now)
{
    double *times = self->views[TIMES].buf;
    for (Py_ssize_t i = 0; i < self->count; i++)
        times[i] = now;
}

static PyObject *Inputs_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"moved", "scales", "raws", "values", "times", "start", NULL};
    PyObject *views[VIEWS];
    Py_ssize_t start;
    if (!PyArg_ParseTupleAndKeywords(
            args, named, "OOOOOn", names, views, views + 1, views + 2, views + 3, views + 4, &start))
        return NULL;
    return make(type, views, start, 4);
}

static int append(PyObject *list, Py_ssize_t slot, double value)
{
    PyObject *pair = Py_BuildValue("nd", slot, value);
    int result = pair == NULL ? -1 : PyList_Append(list, pair);
    Py_XDECREF(pair);
    return result;
}

static PyObject *Inputs_convert(Block *self, PyObject *time)
{
    double now = PyFloat_AsDouble(time);
    if (now == -1.0 && PyErr_Occurred())
        return NULL;
    PyObject *outside = PyList_New(0);
    if (outside == NULL)
        return NULL;
    const int64_t *moved = self->views[MOVED].buf;
    const double *scale = self->views[SCALES].buf;
    double *values = self->views[VALUES].buf;
    memcpy(self->views[RAWS].buf, moved, (size_t)self->views[MOVED].len);
    for (Py_ssize_t i = 0; i < self->count; i++, scale += 4) {
        double value = (double)moved[i] * scale[0] + scale[1];
        if (scale[2] <= value && value <= scale[3])
            values[i] = value;
        else if (append(outside, self->start + i, value) < 0) {
            Py_DECREF(outside);
            return NULL;
        }
    }
    if (PyList_GET_SIZE(outside) == 0)
        stamp(self, now);
    return outside;
}

static PyObject *Outputs_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"moved", "pending", "raws", "values", "times", NULL};
    PyObject *views[VIEWS];
    if (!PyArg_ParseTupleAndKeywords(args, named, "OOOOO", names, views, views + 1, views + 2, views + 3, views + 4))
        return NULL;
    return make(type, views, 0, 1);
}

static PyObject *Outputs_commit(Block *self, PyObject *time)
{
    double now = PyFloat_AsDouble(time);
    if (now == -1.0 && PyErr_Occurred())
        return NULL;
    size_t size = (size_t)self->views[MOVED].len;
    memcpy(self->views[RAWS].buf, self->views[MOVED].buf, size);
    memcpy(self->views[VALUES].buf, self->views[PENDING].buf, size);
    stamp(self, now);
    Py_RETURN_NONE;
}

static PyMethodDef inputs_methods[] = {{"convert", (PyCFunction)Inputs_convert, METH_O, NULL}, {NULL, NULL, 0, NULL}};
static PyMethodDef outputs_methods[] = {{"commit", (PyCFunction)Outputs_commit, METH_O, NULL}, {NULL, NULL, 0, NULL}};
static PyType_Slot inputs[] = {
    {Py_tp_new, Inputs_new}, {Py_tp_dealloc, Block_dealloc}, {Py_tp_methods, inputs_methods}, {0, NULL},
};
static PyType_Slot outputs[] = {
    {Py_tp_new, Outputs_new}, {Py_tp_dealloc, Block_dealloc}, {Py_tp_methods, outputs_methods}, {0, NULL},
};
static PyType_Spec specs[] = {
    {"umo.cycle._scan.Inputs", sizeof(Block), 0, Py_TPFLAGS_DEFAULT, inputs},
    {"umo.cycle._scan.Outputs", sizeof(Block), 0, Py_TPFLAGS_DEFAULT, outputs},
};

static int fill(PyObject *module)
{
    for (int i = 0; i < 2; i++) {
        PyObject *type = PyType_FromSpec(&specs[i]);
        if (type == NULL)
            return -1;
        int failed = PyModule_AddType(module, (PyTypeObject *)type);
        Py_DECREF(type);
        if (failed)
            return -1;
    }
    return 0;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, fill}, {0, NULL}};
static struct PyModuleDef scan = {PyModuleDef_HEAD_INIT, .m_name = "umo.cycle._scan", .m_slots = slots};

PyMODINIT_FUNC PyInit__scan(void)
{
    return PyModuleDef_Init(&scan);
}
