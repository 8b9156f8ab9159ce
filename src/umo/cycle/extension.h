/* What the files of umo.cycle._columns share. Only functions of Python's stable interface are used, so that one file
 * serves all versions from 3.11 on.
 */
#ifndef UMO_EXTENSION_H
#define UMO_EXTENSION_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <stdint.h>

int is_made_by(PyObject *object, newfunc made_by); /* columns.c: whether this is the `new` of its type */

typedef struct Block Block; /* Inputs or Outputs of columns.c */

int is_inputs(PyObject *block); /* columns.c, as all of blocks */
int is_outputs(PyObject *block);
int64_t *moved_of(Block *block, Py_ssize_t *count); /* the raw integers that a driver moves */
int inputs_convert(Block *block, double now);       /* whether all are in range; if not, nothing is kept */
void outputs_give(Block *block, double now, double dt);
void outputs_commit(Block *block, double now);

typedef struct Law Law; /* laws.c, as all of laws */
enum { LAW_IS_TRUE = -1 }; /* in the place of a fault: a condition that is true; as in umo.generate.law_library */

int is_law(PyObject *law);
int law_is_false(Law *law, double now, double dt, int32_t ticks); /* a condition; 0: it may be true, -1: an error */
int law_has_ended(const Law *law);
int16_t law_fault(const Law *law, double now, double dt, int32_t ticks); /* one period of it; its fault */
void law_was_called(Law *law, int16_t fault); /* its next `act` only tells of the fault, if there was one */

int turn_to(PyObject *turn, PyObject *law); /* writes.c: this law acts now */
int add_period_type(PyObject *module);      /* period.c */
int add_types(PyObject *module, PyType_Spec *from, size_t count);
int add_law_types(PyObject *module); /* laws.c */
int add_watch_type(PyObject *module); /* watch.c */
int add_writes_types(PyObject *module); /* writes.c */
void end_period(uint8_t *written, Py_ssize_t count); /* writes.c */

#endif
