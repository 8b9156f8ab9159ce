/* umo.frames._body: writes what follows `sequence` and `checksum` in a frame (body.py). */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdint.h>
#include <string.h>

enum { MAP, VALUES, RAWS, QUALITY, VIEWS };
enum { AT, NUMBER, TIME, MISSED, BEGAN, WAKE, EXECUTION, SELDOM, PHASES, SIGNALS, COMMANDS, ARGUMENTS };

typedef struct {
    PyObject_HEAD
    Py_buffer views[VIEWS];
    Py_ssize_t size;
} Body;

static void Body_dealloc(Body *self)
{
    PyTypeObject *type = Py_TYPE(self);
    for (int i = 0; i < VIEWS; i++)
        PyBuffer_Release(&self->views[i]); /* nothing where there is none */
    type->tp_free(self);
    Py_DECREF(type);
}

static PyObject *Body_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    static char *names[] = {"file", "values", "raws", "quality", "size", NULL};
    PyObject *views[VIEWS];
    Py_ssize_t size;
    if (!PyArg_ParseTupleAndKeywords(args, named, "OOOOn", names, views, views + 1, views + 2, views + 3, &size))
        return NULL;
    Body *self = (Body *)type->tp_alloc(type, 0);
    if (self == NULL)
        return NULL;
    self->size = size;
    for (int i = 0; i < VIEWS; i++)
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
        real = PyFloat_AS_DOUBLE(number);
    else
        PyErr_SetString(PyExc_TypeError, "a number of a frame is not a float");
    return put(to, &real, sizeof real);
}

/* Whether the arguments are of the types that are taken for granted, and fill the place in the map exactly. */
static int fits(Body *self, PyObject *const *args, Py_ssize_t at)
{
    if (!PyBytes_Check(args[SELDOM]) || !PyList_Check(args[PHASES]) || !PyList_Check(args[SIGNALS])
        || !PyBytes_Check(args[COMMANDS]))
        return 0;
    Py_ssize_t numbers = SELDOM - NUMBER + PyList_GET_SIZE(args[PHASES]) + PyList_GET_SIZE(args[SIGNALS]);
    Py_ssize_t size = 8 * numbers + PyBytes_GET_SIZE(args[SELDOM]) + PyBytes_GET_SIZE(args[COMMANDS]);
    for (int i = VALUES; i < VIEWS; i++)
        size += self->views[i].len;
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
    to = put(to, PyBytes_AS_STRING(args[SELDOM]), PyBytes_GET_SIZE(args[SELDOM]));
    for (Py_ssize_t i = 0; i < PyList_GET_SIZE(args[PHASES]); i++)
        to = put_whole(to, PyList_GET_ITEM(args[PHASES], i));
    for (Py_ssize_t i = 0; i < PyList_GET_SIZE(args[SIGNALS]); i++)
        to = put_real(to, PyList_GET_ITEM(args[SIGNALS], i));
    for (int i = VALUES; i < VIEWS; i++)
        to = put(to, self->views[i].buf, self->views[i].len);
    put(to, PyBytes_AS_STRING(args[COMMANDS]), PyBytes_GET_SIZE(args[COMMANDS]));
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"write", (PyCFunction)(void (*)(void))Body_write, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot body[] = {
    {Py_tp_new, Body_new}, {Py_tp_dealloc, Body_dealloc}, {Py_tp_methods, methods}, {0, NULL},
};
static PyType_Spec spec = {"umo.frames._body.Body", sizeof(Body), 0, Py_TPFLAGS_DEFAULT, body};

static int fill(PyObject *module)
{
    PyObject *type = PyType_FromSpec(&spec);
    if (type == NULL)
        return -1;
    int result = PyModule_AddType(module, (PyTypeObject *)type);
    Py_DECREF(type);
    return result;
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, fill}, {0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = "umo.frames._body", .m_slots = slots};

PyMODINIT_FUNC PyInit__body(void)
{
    return PyModuleDef_Init(&module);
}
