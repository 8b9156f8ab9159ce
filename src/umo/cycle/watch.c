/* What translated code has taken as known, compared once a period (umo.generate.known_watch). */
#include "extension.h"

#include <stdint.h>
#include <string.h>

/* The names of one dict, of a module, a class or an object, that are to be what they were. */
typedef struct {
    const uint64_t *at; /* the version of the dict, another one after each change; NONE: it has none */
    uint64_t version; /* that of when its names were compared last */
    PyObject *dict;
    Py_ssize_t first, end; /* places in `names` and `values` */
} Space;

static const uint64_t NONE = 0, NEVER = UINT64_MAX; /* versions that no dict has: NEVER, where it was not searched yet */

/* An attribute that is to be what it was. */
typedef struct {
    PyObject *const *at; /* where the object has the reference; NULL: it is asked for it */
    PyObject *was;
    PyObject *given; /* a tuple of the object, the name and the value */
} Attribute;

typedef struct {
    PyObject_HEAD
    Py_ssize_t count, always, turn; /* of spaces; those from `always` on are looked at in turn, one each time */
    Py_ssize_t attribute_count, attributes_always, attribute_turn; /* the same, IN_TURN each time */
    Space *spaces;
    Attribute *attributes;
    PyObject *held; /* a tuple that keeps everything that is pointed to */
    PyObject **names, **values; /* a value that is NULL: there is no such name */
    PyObject *contents; /* a tuple of pairs: a list, dict or other container, and its elements as a tuple */
    PyObject *changed; /* changed(): called where something is not what it was */
} Watch;

enum { IN_TURN = 4 };

static int Watch_traverse(Watch *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->held);
    Py_VISIT(self->contents);
    Py_VISIT(self->changed);
    return 0;
}

static int Watch_clear(Watch *self)
{
    self->count = self->always = self->attribute_count = self->attributes_always = 0;
    Py_CLEAR(self->held);
    Py_CLEAR(self->contents);
    Py_CLEAR(self->changed);
    return 0;
}

static void Watch_dealloc(Watch *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    (void)Watch_clear(self);
    PyMem_Free(self->spaces);
    PyMem_Free(self->attributes);
    PyMem_Free(self->names);
    PyMem_Free(self->values);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

/* Whether these are pairs of a container and a tuple. */
static int are_contents(PyObject *all)
{
    for (Py_ssize_t i = 0; i < PyTuple_Size(all); i++) {
        PyObject *each = PyTuple_GetItem(all, i);
        if (!PyTuple_Check(each) || PyTuple_Size(each) != 2 || !PyTuple_Check(PyTuple_GetItem(each, 1)))
            return 0;
    }
    return 1;
}

/* One space from (dict, names, values, address of its version or 0); a value that is `absent`: there is no such name. */
static int take_space(Watch *self, PyObject *given, PyObject *absent, Py_ssize_t at)
{
    PyObject *dict, *names, *values;
    unsigned long long version;
    if (!PyArg_ParseTuple(given, "O!O!O!K", &PyDict_Type, &dict, &PyTuple_Type, &names, &PyTuple_Type, &values,
                          &version))
        return -1;
    Py_ssize_t count = PyTuple_Size(names);
    if (PyTuple_Size(values) != count) {
        PyErr_SetString(PyExc_TypeError, "no names to watch");
        return -1;
    }
    const uint64_t *version_at = version == 0 ? &NONE : (const uint64_t *)(uintptr_t)version;
    self->spaces[self->count++] = (Space){version_at, NEVER, dict, at, at + count};
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *value = PyTuple_GetItem(values, i);
        self->names[at + i] = PyTuple_GetItem(names, i);
        self->values[at + i] = value == absent ? NULL : value;
    }
    return 0;
}

static int take_spaces(Watch *self, PyObject *given, PyObject *absent)
{
    Py_ssize_t spaces = PyTuple_Size(given), names = 0, at = 0;
    for (Py_ssize_t i = 0; i < spaces; i++) {
        PyObject *each = PyTuple_GetItem(given, i);
        if (!PyTuple_Check(each) || PyTuple_Size(each) != 4 || !PyTuple_Check(PyTuple_GetItem(each, 1))) {
            PyErr_SetString(PyExc_TypeError, "no names to watch");
            return -1;
        }
        names += PyTuple_Size(PyTuple_GetItem(each, 1));
    }
    self->spaces = PyMem_Calloc((size_t)spaces + 1, sizeof(Space));
    self->names = PyMem_Calloc((size_t)names + 1, sizeof(PyObject *));
    self->values = PyMem_Calloc((size_t)names + 1, sizeof(PyObject *));
    if (self->spaces == NULL || self->names == NULL || self->values == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    for (Py_ssize_t i = 0; i < spaces; i++) {
        if (take_space(self, PyTuple_GetItem(given, i), absent, at))
            return -1;
        at = self->spaces[i].end;
    }
    return 0;
}

/* The attributes from (object, name, value, address): where the address is not 0, the reference is there, now. */
static int take_attributes(Watch *self, PyObject *given)
{
    Py_ssize_t count = PyTuple_Size(given);
    self->attributes = PyMem_Calloc((size_t)count + 1, sizeof(Attribute));
    if (self->attributes == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *each = PyTuple_GetItem(given, i), *owner, *name, *value;
        unsigned long long address;
        if (!PyTuple_Check(each)) {
            PyErr_SetString(PyExc_TypeError, "no attributes to watch");
            return -1;
        }
        if (!PyArg_ParseTuple(each, "OUOK", &owner, &name, &value, &address))
            return -1;
        PyObject *const *at = (PyObject *const *)(uintptr_t)address;
        self->attributes[self->attribute_count++] = (Attribute){at, at == NULL ? NULL : *at, each};
    }
    return 0;
}

/* Watch(spaces, how many of them always, attributes, how many of them always, contents, absent,
 * changed): the others are looked at in turn. */
static PyObject *Watch_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    PyObject *spaces, *attributes, *contents, *absent, *changed;
    Py_ssize_t always, attributes_always;
    if (named != NULL && PyDict_Size(named) != 0) {
        PyErr_SetString(PyExc_TypeError, "Watch takes no arguments by name");
        return NULL;
    }
    if (!PyArg_ParseTuple(args, "O!nO!nO!OO", &PyTuple_Type, &spaces, &always, &PyTuple_Type, &attributes,
                          &attributes_always, &PyTuple_Type, &contents, &absent, &changed))
        return NULL;
    if (!are_contents(contents) || always < 0 || always > PyTuple_Size(spaces) ||
        attributes_always < 0 || attributes_always > PyTuple_Size(attributes)) {
        PyErr_SetString(PyExc_TypeError, "no names, containers or attributes to watch");
        return NULL;
    }
    Watch *self = (Watch *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->held = PyTuple_Pack(2, spaces, attributes);
    self->contents = Py_NewRef(contents);
    self->always = always;
    self->attributes_always = attributes_always;
    self->changed = Py_NewRef(changed);
    if (self->held == NULL || take_spaces(self, spaces, absent) || take_attributes(self, attributes)) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* 1: as it was; 0: not; -1: an error. */
static int has_names(Watch *self, Space *space)
{
    uint64_t version = *space->at;
    for (Py_ssize_t i = space->first; i < space->end; i++) {
        PyObject *found = PyDict_GetItemWithError(space->dict, self->names[i]);
        if (found != self->values[i])
            return found == NULL && PyErr_Occurred() ? -1 : 0;
    }
    space->version = space->at == &NONE ? NEVER : version;
    return 1;
}

/* The same. A dict of the same version is not searched again. */
static inline int is_space(Watch *self, Space *space)
{
    return *space->at == space->version ? 1 : has_names(self, space);
}

static inline int is_attribute(const Attribute *each)
{
    if (each->at != NULL)
        return *each->at == each->was;
    PyObject *found = PyObject_GetAttr(PyTuple_GetItem(each->given, 0), PyTuple_GetItem(each->given, 1));
    if (found == NULL)
        return -1;
    Py_DECREF(found);
    return found == PyTuple_GetItem(each->given, 2);
}

static int is_list(PyObject *list, PyObject *elements)
{
    Py_ssize_t count = PyTuple_Size(elements);
    if (PyList_Size(list) != count)
        return 0;
    for (Py_ssize_t i = 0; i < count; i++)
        if (PyList_GetItem(list, i) != PyTuple_GetItem(elements, i))
            return 0;
    return 1;
}

/* The elements of a dict are its keys and values in turn. */
static int is_dict(PyObject *dict, PyObject *elements)
{
    Py_ssize_t at = 0, i = 0;
    PyObject *key, *value;
    if (2 * PyDict_Size(dict) != PyTuple_Size(elements))
        return 0;
    for (; PyDict_Next(dict, &at, &key, &value); i += 2)
        if (key != PyTuple_GetItem(elements, i) || value != PyTuple_GetItem(elements, i + 1))
            return 0;
    return 1;
}

/* The only element of an array are its bytes. */
static int is_array(PyObject *array, PyObject *elements)
{
    Py_buffer now, before;
    if (PyTuple_Size(elements) != 1 || PyObject_GetBuffer(array, &now, PyBUF_C_CONTIGUOUS))
        return -1;
    if (PyObject_GetBuffer(PyTuple_GetItem(elements, 0), &before, PyBUF_SIMPLE)) {
        PyBuffer_Release(&now);
        return -1;
    }
    int same = now.len == before.len && memcmp(now.buf, before.buf, (size_t)now.len) == 0;
    PyBuffer_Release(&before);
    PyBuffer_Release(&now);
    return same;
}

static int is_content(PyObject *container, PyObject *elements)
{
    if (PyObject_CheckBuffer(container))
        return is_array(container, elements);
    if (PyList_Check(container))
        return is_list(container, elements);
    if (PyDict_Check(container))
        return is_dict(container, elements);
    PyObject *now = PySequence_Tuple(container);
    if (now == NULL)
        return -1;
    Py_ssize_t count = PyTuple_Size(now);
    int same = count == PyTuple_Size(elements);
    for (Py_ssize_t i = 0; same && i < count; i++)
        same = PyTuple_GetItem(now, i) == PyTuple_GetItem(elements, i);
    Py_DECREF(now);
    return same;
}

/* What is not looked at each time: some of it. */
static int is_next(Watch *self)
{
    Py_ssize_t spaces = self->count - self->always, attributes = self->attribute_count - self->attributes_always;
    int same = 1;
    if (spaces > 0) {
        self->turn = self->turn + 1 < spaces ? self->turn + 1 : 0; /* faster than a division */
        same = is_space(self, &self->spaces[self->always + self->turn]);
    }
    for (int i = 0; same > 0 && i < IN_TURN && attributes > 0; i++) {
        self->attribute_turn = self->attribute_turn + 1 < attributes ? self->attribute_turn + 1 : 0;
        same = is_attribute(&self->attributes[self->attributes_always + self->attribute_turn]);
    }
    return same;
}

static int is_all(Watch *self)
{
    int same = 1;
    for (Py_ssize_t i = 0; same > 0 && i < self->attributes_always; i++)
        same = is_attribute(&self->attributes[i]);
    for (Py_ssize_t i = 0; same > 0 && i < self->always; i++)
        same = is_space(self, &self->spaces[i]);
    for (Py_ssize_t i = 0; same > 0 && i < PyTuple_Size(self->contents); i++) {
        PyObject *pair = PyTuple_GetItem(self->contents, i);
        same = is_content(PyTuple_GetItem(pair, 0), PyTuple_GetItem(pair, 1));
    }
    if (same > 0)
        same = is_next(self);
    if (same < 0) {
        PyErr_Clear(); /* what can no longer be read is not what it was */
        same = 0;
    }
    return same;
}

/* look(): True where everything is as it was; else what changed() gives. False once it has been collected. */
static PyObject *Watch_look(Watch *self, PyObject *Py_UNUSED(none))
{
    if (self->held == NULL)
        Py_RETURN_FALSE;
    if (is_all(self))
        Py_RETURN_TRUE;
    return PyObject_CallNoArgs(self->changed);
}

static PyMethodDef methods[] = {{"look", (PyCFunction)Watch_look, METH_NOARGS, NULL}, {NULL, NULL, 0, NULL}};
static PyType_Slot watch[] = {
    {Py_tp_new, Watch_new}, {Py_tp_dealloc, Watch_dealloc}, {Py_tp_traverse, Watch_traverse},
    {Py_tp_clear, Watch_clear}, {Py_tp_methods, methods}, {0, NULL},
};
static PyType_Spec specs[] = {
    {"umo.cycle._columns.Watch", sizeof(Watch), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC, watch},
};

/* Versions of dicts that Python tells of each change: one of these each; dicts of the same one change together. */
enum { VERSIONS = 1024 };
static uint64_t versions[VERSIONS];

static uint64_t *counter_of(PyObject *dict)
{
    return &versions[((uintptr_t)dict >> 4) % VERSIONS];
}

static int count_change(int Py_UNUSED(event), PyObject *dict, PyObject *Py_UNUSED(key), PyObject *Py_UNUSED(value))
{
    ++*counter_of(dict);
    return 0;
}

/* count_changes(dict, addresses of PyDict_AddWatcher and PyDict_Watch): from now on each change counts in the address that
 * this gives. Python has these functions from 3.12 on, but not in its stable interface. */
static PyObject *count_changes(PyObject *Py_UNUSED(module), PyObject *args)
{
    static int watcher = -1;
    PyObject *dict;
    unsigned long long add, watch_dict;
    if (!PyArg_ParseTuple(args, "O!KK", &PyDict_Type, &dict, &add, &watch_dict))
        return NULL;
    if (watcher < 0)
        watcher = ((int (*)(int (*)(int, PyObject *, PyObject *, PyObject *)))(uintptr_t)add)(count_change);
    if (watcher < 0 || ((int (*)(int, PyObject *))(uintptr_t)watch_dict)(watcher, dict))
        return NULL;
    return PyLong_FromUnsignedLongLong((uintptr_t)counter_of(dict));
}

static PyMethodDef functions[] = {{"count_changes", count_changes, METH_VARARGS, NULL}, {NULL, NULL, 0, NULL}};

int add_watch_type(PyObject *module)
{
    return PyModule_AddFunctions(module, functions) ? -1 : add_types(module, specs, sizeof specs / sizeof *specs);
}
