/* Compiled laws (umo.generate.compiled_laws): their call, and the attributes of live objects in their memory. */
#include "extension.h"

#include <stdint.h>
#include <string.h>

/* A law: it is called with the time of a clock. */
enum { NOW, DT, TICKS, TIMES_OF_CLOCK };
static const char *const times_of_clock[] = {"now", "dt", "ticks"};

struct Law {
    PyObject_HEAD
    int16_t (*call)(void *machine, int32_t law, double now, double dt, int32_t ticks);
    void *machine;
    int32_t number;
    int was_called; /* whether it has acted in this period, with `fault` */
    int16_t fault;
    PyObject *clock, *failed, *instead, *look, *names[TIMES_OF_CLOCK];
};

static int Law_traverse(Law *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->clock);
    Py_VISIT(self->failed);
    Py_VISIT(self->instead);
    Py_VISIT(self->look);
    return 0;
}

static int Law_clear(Law *self)
{
    Py_CLEAR(self->clock);
    Py_CLEAR(self->failed);
    Py_CLEAR(self->instead);
    Py_CLEAR(self->look);
    return 0;
}

static void Law_dealloc(Law *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    for (int i = 0; i < TIMES_OF_CLOCK; i++)
        Py_XDECREF(self->names[i]);
    (void)Law_clear(self);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

/* Law(address of the function, address of the machine, number of the law, clock, failed) */
static PyObject *Law_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    unsigned long long call, machine;
    int number;
    PyObject *clock, *failed;
    if (named != NULL && PyDict_Size(named) != 0) {
        PyErr_SetString(PyExc_TypeError, "Law takes no arguments by name");
        return NULL;
    }
    if (!PyArg_ParseTuple(args, "KKiOO", &call, &machine, &number, &clock, &failed))
        return NULL;
    Law *self = (Law *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->call = (int16_t(*)(void *, int32_t, double, double, int32_t))(uintptr_t)call;
    self->machine = (void *)(uintptr_t)machine;
    self->number = number;
    self->clock = Py_NewRef(clock);
    self->failed = Py_NewRef(failed);
    for (int i = 0; i < TIMES_OF_CLOCK; i++)
        if ((self->names[i] = PyUnicode_InternFromString(times_of_clock[i])) == NULL) {
            Py_DECREF(self);
            return NULL;
        }
    return (PyObject *)self;
}

static int time_of(Law *self, int which, double *number)
{
    PyObject *found = PyObject_GetAttr(self->clock, self->names[which]);
    if (found == NULL)
        return -1;
    *number = PyFloat_AsDouble(found);
    Py_DECREF(found);
    return *number == -1.0 && PyErr_Occurred() ? -1 : 0;
}

static int called(Law *self, int16_t *fault)
{
    double times[TIMES_OF_CLOCK];
    for (int i = 0; i < TIMES_OF_CLOCK; i++)
        if (time_of(self, i, &times[i]))
            return -1;
    *fault = self->call(self->machine, self->number, times[NOW], times[DT], (int32_t)times[TICKS]);
    return 0;
}

/* act(node): one period. Where it has a fault, the result, or the error, is that of failed(number of the fault). */
static PyObject *Law_act(Law *self, PyObject *Py_UNUSED(node))
{
    int16_t fault = self->fault;
    int was_called = self->was_called;
    self->was_called = 0;
    if (!was_called && self->instead != NULL)
        return PyObject_CallNoArgs(self->instead);
    if (!was_called && called(self, &fault))
        return NULL;
    if (fault == 0)
        Py_RETURN_NONE;
    return PyObject_CallFunction(self->failed, "i", (int)fault);
}

int is_law(PyObject *law)
{
    return is_made_by(law, Law_new);
}

int law_has_ended(const Law *self)
{
    return self->instead != NULL;
}

int16_t law_fault(const Law *self, double now, double dt, int32_t ticks)
{
    return self->call(self->machine, self->number, now, dt, ticks);
}

void law_was_called(Law *self, int16_t fault)
{
    self->was_called = 1;
    self->fault = fault;
}

/* guard(look): `holds` calls look() first; where that is not True, the result is that of failed(0). None: nothing. */
static PyObject *Law_guard(Law *self, PyObject *look)
{
    PyObject *before = self->look;
    self->look = look == Py_None ? NULL : Py_NewRef(look);
    Py_XDECREF(before);
    Py_RETURN_NONE;
}

/* 1: what look() says is True, or there is none; 0: it is not; -1: an error. */
static int is_known(Law *self)
{
    if (self->look == NULL)
        return 1;
    PyObject *look = Py_NewRef(self->look), *found = PyObject_CallNoArgs(look);
    int known = found == NULL ? -1 : found == Py_True;
    Py_XDECREF(found);
    Py_DECREF(look);
    return known;
}

int law_is_false(Law *self, double now, double dt, int32_t ticks)
{
    int known = is_known(self);
    return known <= 0 ? known : self->call(self->machine, self->number, now, dt, ticks) == 0;
}

/* holds(): whether a condition, whose fault is LAW_IS_TRUE or 0, is true. Any other fault as of `act`. */
static PyObject *Law_holds(Law *self, PyObject *Py_UNUSED(none))
{
    int16_t fault;
    int known = is_known(self);
    if (known <= 0)
        return known < 0 ? NULL : PyObject_CallFunction(self->failed, "i", 0);
    if (called(self, &fault))
        return NULL;
    if (fault == 0 || fault == LAW_IS_TRUE)
        return PyBool_FromLong(fault == LAW_IS_TRUE);
    return PyObject_CallFunction(self->failed, "i", (int)fault);
}

/* end(instead): from now on `act` calls this. */
static PyObject *Law_end(Law *self, PyObject *instead)
{
    PyObject *before = self->instead;
    self->instead = Py_NewRef(instead);
    Py_XDECREF(before);
    Py_RETURN_NONE;
}

static PyMethodDef law_methods[] = {
    {"act", (PyCFunction)Law_act, METH_O, NULL},
    {"end", (PyCFunction)Law_end, METH_O, NULL},
    {"guard", (PyCFunction)Law_guard, METH_O, NULL},
    {"holds", (PyCFunction)Law_holds, METH_NOARGS, NULL},
    {NULL, NULL, 0, NULL},
};
static PyType_Slot law[] = {
    {Py_tp_new, Law_new}, {Py_tp_dealloc, Law_dealloc}, {Py_tp_traverse, Law_traverse}, {Py_tp_clear, Law_clear},
    {Py_tp_methods, law_methods}, {0, NULL},
};

/* An attribute in the memory of a compiled library: a descriptor (umo.generate.bound_fields). */
enum { REAL = 'd', INT = 'i', BOOL = '?', STATE = 's', TUPLE = 't', OPTIONAL = 'o' };

typedef struct {
    PyObject_HEAD
    int kind;
    char *at;
    PyObject *values; /* the members of an Enum, or the class of a NamedTuple */
    PyObject *parts; /* the fields of a tuple; that of what is optional, whose `at` is a bool */
    PyObject *put; /* put(owner, value): sets what is not of the plain kind */
} Field;

static int Field_traverse(Field *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->values);
    Py_VISIT(self->parts);
    Py_VISIT(self->put);
    return 0;
}

static int Field_clear(Field *self)
{
    Py_CLEAR(self->values);
    Py_CLEAR(self->parts);
    Py_CLEAR(self->put);
    return 0;
}

static void Field_dealloc(Field *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    (void)Field_clear(self);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

static int is_sound(int kind, PyObject *values, PyObject *parts, PyTypeObject *type)
{
    switch (kind) {
    case REAL:
    case INT:
    case BOOL:
        return 1;
    case STATE:
        return PyTuple_Check(values);
    case TUPLE:
    case OPTIONAL:
        break;
    default:
        return 0;
    }
    if (!PyTuple_Check(parts) || (kind == OPTIONAL && PyTuple_Size(parts) != 1))
        return 0;
    for (Py_ssize_t i = 0; i < PyTuple_Size(parts); i++)
        if (!PyObject_TypeCheck(PyTuple_GetItem(parts, i), type))
            return 0;
    return kind == OPTIONAL || values == Py_None ||
           (PyType_Check(values) && PyType_IsSubtype((PyTypeObject *)values, &PyTuple_Type));
}

/* Field(kind, address, values, parts, put) */
static PyObject *Field_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    int kind;
    unsigned long long at;
    PyObject *values, *parts, *put;
    if (named != NULL && PyDict_Size(named) != 0) {
        PyErr_SetString(PyExc_TypeError, "Field takes no arguments by name");
        return NULL;
    }
    if (!PyArg_ParseTuple(args, "CKOOO", &kind, &at, &values, &parts, &put))
        return NULL;
    if (!is_sound(kind, values, parts, type)) {
        PyErr_SetString(PyExc_TypeError, "this is no field");
        return NULL;
    }
    Field *self = (Field *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->kind = kind;
    self->at = (char *)(uintptr_t)at;
    self->values = Py_NewRef(values);
    self->parts = Py_NewRef(parts);
    self->put = Py_NewRef(put);
    return (PyObject *)self;
}

static PyObject *value_of(Field *self);

static PyObject *tuple_of(Field *self)
{
    Py_ssize_t count = PyTuple_Size(self->parts);
    PyObject *found = PyTuple_New(count);
    for (Py_ssize_t i = 0; found != NULL && i < count; i++) {
        PyObject *part = value_of((Field *)PyTuple_GetItem(self->parts, i));
        if (part == NULL)
            Py_CLEAR(found);
        else
            PyTuple_SetItem(found, i, part);
    }
    if (found == NULL || self->values == Py_None)
        return found;
    newfunc make = (newfunc)PyType_GetSlot(&PyTuple_Type, Py_tp_new); /* as _make of a NamedTuple */
    PyObject *given = PyTuple_Pack(1, found);
    PyObject *named = given == NULL ? NULL : make((PyTypeObject *)self->values, given, NULL);
    Py_XDECREF(given);
    Py_DECREF(found);
    return named;
}

static PyObject *value_of(Field *self)
{
    double real;
    int32_t whole;
    uint8_t small;
    switch (self->kind) {
    case REAL:
        memcpy(&real, self->at, sizeof real);
        return PyFloat_FromDouble(real);
    case INT:
        memcpy(&whole, self->at, sizeof whole);
        return PyLong_FromLong(whole);
    case TUPLE:
        return tuple_of(self);
    default:
        memcpy(&small, self->at, sizeof small);
    }
    if (self->kind == BOOL)
        return PyBool_FromLong(small);
    if (self->kind == OPTIONAL)
        return small ? value_of((Field *)PyTuple_GetItem(self->parts, 0)) : Py_NewRef(Py_None);
    return Py_XNewRef(PyTuple_GetItem(self->values, small)); /* IndexError for a number of no state */
}

static PyObject *Field_get(Field *self, PyObject *owner, PyObject *Py_UNUSED(type))
{
    return owner == NULL ? Py_NewRef((PyObject *)self) : value_of(self);
}

/* Whether the value was of the plain kind, and has been set. */
static int set_plain(Field *self, PyObject *value)
{
    if (self->kind == REAL && PyFloat_CheckExact(value)) {
        double real = PyFloat_AsDouble(value);
        memcpy(self->at, &real, sizeof real);
        return 1;
    }
    if (self->kind == BOOL && PyBool_Check(value)) {
        *self->at = value == Py_True;
        return 1;
    }
    for (Py_ssize_t i = 0; self->kind == STATE && i < PyTuple_Size(self->values); i++)
        if (PyTuple_GetItem(self->values, i) == value) {
            *self->at = (char)i;
            return 1;
        }
    return 0;
}

static int Field_set(Field *self, PyObject *owner, PyObject *value)
{
    if (value == NULL) {
        PyErr_SetString(PyExc_AttributeError, "an attribute of compiled laws cannot be deleted");
        return -1;
    }
    if (set_plain(self, value))
        return 0;
    PyObject *done = PyObject_CallFunctionObjArgs(self->put, owner, value, NULL);
    Py_XDECREF(done);
    return done == NULL ? -1 : 0;
}

static PyType_Slot field[] = {
    {Py_tp_new, Field_new}, {Py_tp_dealloc, Field_dealloc}, {Py_tp_traverse, Field_traverse},
    {Py_tp_clear, Field_clear}, {Py_tp_descr_get, Field_get}, {Py_tp_descr_set, Field_set}, {0, NULL},
};
static PyType_Spec specs[] = {
    {"umo.cycle._columns.Law", sizeof(Law), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, law},
    {"umo.cycle._columns.Field", sizeof(Field), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, field},
};

int add_law_types(PyObject *module)
{
    return add_types(module, specs, sizeof specs / sizeof *specs);
}
