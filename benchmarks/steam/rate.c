/* The right-hand side of workload S as a Python built-in, so that scipy's LSODA calls compiled code: no Python frame, no allocation.
 *
 * bind(parameters, answer) gives rate(x, t) -> answer; parameters: 31 doubles, k[10] u, A1[10], A2[10] and one unused;
 * answer: the array (2,) that every call fills and returns. */
#define PY_SSIZE_T_CLEAN
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <Python.h>
#include <numpy/arrayobject.h>

static double look(const double *table, int piece, double part) { return table[piece] + part * (table[piece + 1] - table[piece]); }

static PyObject *rate(PyObject *bound, PyObject *const *args, Py_ssize_t count) {
    if (count != 2) return PyErr_Format(PyExc_TypeError, "rate takes x and t");
    const double *p = PyArray_DATA((PyArrayObject *)PyTuple_GET_ITEM(bound, 0));
    PyObject *answer = PyTuple_GET_ITEM(bound, 1);
    const double *x = PyArray_DATA((PyArrayObject *)args[0]);
    double *out = PyArray_DATA((PyArrayObject *)answer);
    double place = x[0] > 0.0 ? (x[0] < 20.0 ? x[0] * (9 / 20.0) : 9.0) : 0.0;
    int piece = place < 8.0 ? (int)place : 8;
    double part = place - piece;
    out[0] = x[1];
    out[1] = (look(p, piece, part) - x[0] - look(p + 10, piece, part) * x[1]) / look(p + 20, piece, part);
    Py_INCREF(answer);
    return answer;
}

static PyMethodDef rate_method = {"rate", (PyCFunction)(void (*)(void))rate, METH_FASTCALL, "rate(x, t) -> d(x1, x2)/dt"};

static PyObject *bind(PyObject *self, PyObject *args) {
    PyObject *parameters, *answer;
    if (!PyArg_ParseTuple(args, "O!O!", &PyArray_Type, &parameters, &PyArray_Type, &answer)) return NULL;
    PyObject *bound = PyTuple_Pack(2, parameters, answer);
    if (bound == NULL) return NULL;
    PyObject *function = PyCFunction_New(&rate_method, bound);
    Py_DECREF(bound);
    return function;
}

static PyMethodDef methods[] = {{"bind", bind, METH_VARARGS, "bind(parameters, answer) -> rate"}, {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "rate", NULL, -1, methods};

PyMODINIT_FUNC PyInit_rate(void) {
    import_array();
    return PyModule_Create(&module);
}
