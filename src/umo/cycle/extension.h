/* What the files of umo.cycle._columns share. Only functions of Python's stable interface are used, so that one file
 * serves all versions from 3.11 on.
 */
#ifndef UMO_EXTENSION_H
#define UMO_EXTENSION_H

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030B0000
#include <Python.h>
#include <stdint.h>

int add_types(PyObject *module, PyType_Spec *from, size_t count);
int add_law_types(PyObject *module); /* laws.c */
int add_watch_type(PyObject *module); /* watch.c */
int add_writes_types(PyObject *module); /* writes.c */
void end_period(uint8_t *written, Py_ssize_t count); /* writes.c */

#endif
