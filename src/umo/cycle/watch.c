/* What translated code has taken as known, compared once a period (umo.generate.known_watch). */
#include "extension.h"

#include <stdint.h>
#include <string.h>

enum { CODE, DEFAULTS, KWDEFAULTS, PARTS }; /* of a function of Python */

/* The attributes of one object, or the names of one module, that are to be what they were. */
typedef struct {
    PyObject *owner; /* an object, or a dict: that of a module, or of an object */
    PyTypeObject *kind; /* the class of the object; NULL: the owner is the dict itself */
    Py_ssize_t size; /* the number of its attributes; below 0: it does not matter */
    Py_ssize_t first, end; /* places in `names` and `values` */
} Space;

typedef struct {
    PyObject_HEAD
    Space *spaces;
    Py_ssize_t count, always, turn; /* those from `always` on are looked at in turn, one each time */
    PyObject *held; /* a tuple that keeps everything that is pointed to */
    PyObject **names, **values; /* a value that is NULL: there is no such name */
    PyObject *types; /* a tuple of classes whose flag of a valid version tells that no class above was changed */
    PyObject *contents; /* a tuple of pairs: a list, dict or other container, and its elements as a tuple */
    PyObject *attributes; /* a tuple of triples: an object, a name, and the value */
    PyObject *cells; /* a tuple of pairs: a cell of an enclosing function, and what is in it */
    PyObject *(*in_cell)(PyObject *);
    PyObject *functions; /* a tuple of tuples: a function, and what each of `parts` gives of it */
    PyObject *in_turn; /* the same, of which one is looked at each time */
    PyObject *(*parts[PARTS])(PyObject *);
    PyObject *changed; /* changed(): called where something is not what it was */
} Watch;

enum { VALID_VERSION = 1 << 19 }; /* Py_TPFLAGS_VALID_VERSION_TAG */

static int Watch_traverse(Watch *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->held);
    Py_VISIT(self->types);
    Py_VISIT(self->contents);
    Py_VISIT(self->attributes);
    Py_VISIT(self->cells);
    Py_VISIT(self->functions);
    Py_VISIT(self->in_turn);
    Py_VISIT(self->changed);
    return 0;
}

static int Watch_clear(Watch *self)
{
    self->count = self->always = 0;
    Py_CLEAR(self->held);
    Py_CLEAR(self->types);
    Py_CLEAR(self->contents);
    Py_CLEAR(self->attributes);
    Py_CLEAR(self->cells);
    Py_CLEAR(self->functions);
    Py_CLEAR(self->in_turn);
    Py_CLEAR(self->changed);
    return 0;
}

static void Watch_dealloc(Watch *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    (void)Watch_clear(self);
    PyMem_Free(self->spaces);
    PyMem_Free(self->names);
    PyMem_Free(self->values);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))((PyObject *)self);
    Py_DECREF(type);
}

/* Whether these are tuples of so many elements, and their last one is a tuple where that is asked for. */
static int are_tuples(PyObject *all, Py_ssize_t size, int of_tuple)
{
    for (Py_ssize_t i = 0; i < PyTuple_Size(all); i++) {
        PyObject *each = PyTuple_GetItem(all, i);
        if (!PyTuple_Check(each) || PyTuple_Size(each) != size ||
            (of_tuple && !PyTuple_Check(PyTuple_GetItem(each, size - 1))))
            return 0;
    }
    return 1;
}

static int are_classes(PyObject *all)
{
    for (Py_ssize_t i = 0; i < PyTuple_Size(all); i++)
        if (!PyType_Check(PyTuple_GetItem(all, i)))
            return 0;
    return 1;
}

/* One space from (owner, class or None, size, names, values); a value that is `absent`: there is no such name. */
static int take_space(Watch *self, PyObject *given, PyObject *absent, Py_ssize_t at)
{
    PyObject *owner, *kind, *names, *values;
    Py_ssize_t size;
    if (!PyArg_ParseTuple(given, "OOnO!O!", &owner, &kind, &size, &PyTuple_Type, &names, &PyTuple_Type, &values))
        return -1;
    Py_ssize_t count = PyTuple_Size(names);
    if (PyTuple_Size(values) != count || (kind == Py_None ? !PyDict_Check(owner) : !PyType_Check(kind))) {
        PyErr_SetString(PyExc_TypeError, "no attributes to watch");
        return -1;
    }
    self->spaces[self->count++] = (Space){owner, kind == Py_None ? NULL : (PyTypeObject *)kind, size, at, at + count};
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *value = PyTuple_GetItem(values, i);
        self->names[at + i] = PyTuple_GetItem(names, i);
        self->values[at + i] = value == absent ? NULL : value;
    }
    return 0;
}

static int take_spaces(Watch *self, PyObject *absent)
{
    Py_ssize_t spaces = PyTuple_Size(self->held), names = 0;
    if (!are_tuples(self->held, 5, 1)) {
        PyErr_SetString(PyExc_TypeError, "no attributes to watch");
        return -1;
    }
    for (Py_ssize_t i = 0; i < spaces; i++)
        names += PyTuple_Size(PyTuple_GetItem(PyTuple_GetItem(self->held, i), 4));
    self->spaces = PyMem_Calloc((size_t)spaces + 1, sizeof(Space));
    self->names = PyMem_Calloc((size_t)names + 1, sizeof(PyObject *));
    self->values = PyMem_Calloc((size_t)names + 1, sizeof(PyObject *));
    if (self->spaces == NULL || self->names == NULL || self->values == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    Py_ssize_t at = 0;
    for (Py_ssize_t i = 0; i < spaces; i++) {
        if (take_space(self, PyTuple_GetItem(self->held, i), absent, at))
            return -1;
        at = self->spaces[i].end;
    }
    return 0;
}

/* Whether these are tuples of so many elements, and the first of each is of this class. */
static int are_of(PyObject *all, Py_ssize_t size, PyObject *kind)
{
    if (!are_tuples(all, size, 0))
        return 0;
    for (Py_ssize_t i = 0; i < PyTuple_Size(all); i++)
        if ((PyObject *)Py_TYPE(PyTuple_GetItem(PyTuple_GetItem(all, i), 0)) != kind)
            return 0;
    return 1;
}

/* Watch(spaces, always, types, contents, attributes, cells, functions, functions in turn, addresses, class of cells,
 * class of functions, absent, changed): `always` spaces are looked at each time. The addresses are those of PyCell_Get,
 * PyFunction_GetCode, PyFunction_GetDefaults and PyFunction_GetKwDefaults, which each Python has, but not in its stable
 * interface. */
static PyObject *Watch_new(PyTypeObject *type, PyObject *args, PyObject *named)
{
    PyObject *spaces, *types, *contents, *attributes, *cells, *functions, *in_turn;
    PyObject *of_cells, *of_functions, *absent, *changed;
    Py_ssize_t always;
    unsigned long long in_cell, parts[PARTS];
    if (named != NULL && PyDict_Size(named) != 0) {
        PyErr_SetString(PyExc_TypeError, "Watch takes no arguments by name");
        return NULL;
    }
    if (!PyArg_ParseTuple(
            args, "O!nO!O!O!O!O!O!(KKKK)OOOO", &PyTuple_Type, &spaces, &always, &PyTuple_Type, &types, &PyTuple_Type,
            &contents, &PyTuple_Type, &attributes, &PyTuple_Type, &cells, &PyTuple_Type, &functions, &PyTuple_Type,
            &in_turn, &in_cell, &parts[CODE], &parts[DEFAULTS], &parts[KWDEFAULTS], &of_cells, &of_functions, &absent,
            &changed))
        return NULL;
    if (!are_classes(types) || !are_tuples(contents, 2, 1) || !are_tuples(attributes, 3, 0) ||
        !are_of(cells, 2, of_cells) || !are_of(functions, 1 + PARTS, of_functions) ||
        !are_of(in_turn, 1 + PARTS, of_functions) || always < 0 || always > PyTuple_Size(spaces)) {
        PyErr_SetString(PyExc_TypeError, "no classes, containers or attributes to watch");
        return NULL;
    }
    Watch *self = (Watch *)PyType_GenericAlloc(type, 0);
    if (self == NULL)
        return NULL;
    self->held = Py_NewRef(spaces);
    self->types = Py_NewRef(types);
    self->contents = Py_NewRef(contents);
    self->attributes = Py_NewRef(attributes);
    self->cells = Py_NewRef(cells);
    self->in_cell = (PyObject * (*)(PyObject *))(uintptr_t)in_cell;
    self->functions = Py_NewRef(functions);
    self->in_turn = Py_NewRef(in_turn);
    self->always = always;
    for (int i = 0; i < PARTS; i++)
        self->parts[i] = (PyObject * (*)(PyObject *))(uintptr_t)parts[i];
    self->changed = Py_NewRef(changed);
    if (take_spaces(self, absent)) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

/* 1: as it was; 0: not; -1: an error. */
static int is_space(Watch *self, const Space *space)
{
    PyObject *dict = space->owner;
    if (space->kind != NULL) {
        if (Py_TYPE(space->owner) != space->kind)
            return 0;
        dict = PyObject_GenericGetDict(space->owner, NULL);
        if (dict == NULL)
            return -1;
        Py_DECREF(dict); /* the object has it */
    }
    if (space->size >= 0 && PyDict_Size(dict) != space->size)
        return 0;
    for (Py_ssize_t i = space->first; i < space->end; i++) {
        PyObject *found = PyDict_GetItemWithError(dict, self->names[i]);
        if (found != self->values[i])
            return found == NULL && PyErr_Occurred() ? -1 : 0;
    }
    return 1;
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

static int is_attribute(PyObject *triple)
{
    PyObject *found = PyObject_GetAttr(PyTuple_GetItem(triple, 0), PyTuple_GetItem(triple, 1));
    if (found == NULL)
        return -1;
    Py_DECREF(found);
    return found == PyTuple_GetItem(triple, 2);
}

static int is_function(Watch *self, PyObject *given)
{
    PyObject *function = PyTuple_GetItem(given, 0);
    for (int i = 0; i < PARTS; i++) {
        PyObject *found = self->parts[i](function), *before = PyTuple_GetItem(given, 1 + i);
        if (found != before && !(found == NULL && before == Py_None))
            return 0;
    }
    return 1;
}

/* What is not looked at each time: one of it. */
static int is_next(Watch *self)
{
    Py_ssize_t spaces = self->count - self->always, functions = PyTuple_Size(self->in_turn);
    if (spaces + functions == 0)
        return 1;
    self->turn = (self->turn + 1) % (spaces + functions);
    if (self->turn < spaces)
        return is_space(self, &self->spaces[self->always + self->turn]);
    return is_function(self, PyTuple_GetItem(self->in_turn, self->turn - spaces));
}

static int is_all(Watch *self)
{
    int same = 1;
    for (Py_ssize_t i = 0; same > 0 && i < self->always; i++)
        same = is_space(self, &self->spaces[i]);
    for (Py_ssize_t i = 0; same > 0 && i < PyTuple_Size(self->types); i++)
        same = (PyType_GetFlags((PyTypeObject *)PyTuple_GetItem(self->types, i)) & VALID_VERSION) != 0;
    for (Py_ssize_t i = 0; same > 0 && i < PyTuple_Size(self->contents); i++) {
        PyObject *pair = PyTuple_GetItem(self->contents, i);
        same = is_content(PyTuple_GetItem(pair, 0), PyTuple_GetItem(pair, 1));
    }
    for (Py_ssize_t i = 0; same > 0 && i < PyTuple_Size(self->attributes); i++)
        same = is_attribute(PyTuple_GetItem(self->attributes, i));
    for (Py_ssize_t i = 0; same > 0 && i < PyTuple_Size(self->functions); i++)
        same = is_function(self, PyTuple_GetItem(self->functions, i));
    for (Py_ssize_t i = 0; same > 0 && i < PyTuple_Size(self->cells); i++) {
        PyObject *pair = PyTuple_GetItem(self->cells, i), *found = self->in_cell(PyTuple_GetItem(pair, 0));
        same = found == PyTuple_GetItem(pair, 1);
        Py_XDECREF(found);
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

int add_watch_type(PyObject *module)
{
    return add_types(module, specs, sizeof specs / sizeof *specs);
}
