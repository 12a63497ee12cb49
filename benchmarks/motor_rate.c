/* The right-hand side of workload D and its Jacobian as Python built-ins, so that scipy's LSODA calls compiled code: no Python frame, no
 * allocation.
 *
 * rate(parameters, answer) gives f(x, t) -> answer (2,), jacobian(parameters, answer) gives J(x, t) -> answer (2, 2); every call fills and
 * returns `answer`. parameters: 8 doubles R, L, K, B, J, Tf, width, V; the voltage may be changed between calls. */
#define PY_SSIZE_T_CLEAN
#define NPY_NO_DEPRECATED_API NPY_1_7_API_VERSION
#include <Python.h>
#include <math.h>
#include <numpy/arrayobject.h>

static double *numbers(PyObject *array) { return PyArray_DATA((PyArrayObject *)array); }

static PyObject *rate(PyObject *bound, PyObject *const *args, Py_ssize_t count) {
    if (count != 2) return PyErr_Format(PyExc_TypeError, "rate takes x and t");
    PyObject *answer = PyTuple_GET_ITEM(bound, 1);
    const double *p = numbers(PyTuple_GET_ITEM(bound, 0)), *x = numbers(args[0]);
    double *out = numbers(answer);
    out[0] = (p[7] - p[0] * x[0] - p[2] * x[1]) / p[1];
    out[1] = (p[2] * x[0] - p[3] * x[1] - p[5] * tanh(x[1] / p[6])) / p[4];
    Py_INCREF(answer);
    return answer;
}

static PyObject *jacobian(PyObject *bound, PyObject *const *args, Py_ssize_t count) {
    if (count != 2) return PyErr_Format(PyExc_TypeError, "jacobian takes x and t");
    PyObject *answer = PyTuple_GET_ITEM(bound, 1);
    const double *p = numbers(PyTuple_GET_ITEM(bound, 0)), *x = numbers(args[0]);
    double *out = numbers(answer), t = tanh(x[1] / p[6]);
    out[0] = -p[0] / p[1];
    out[1] = -p[2] / p[1];
    out[2] = p[2] / p[4];
    out[3] = (-p[3] - p[5] * (1.0 - t * t) / p[6]) / p[4];
    Py_INCREF(answer);
    return answer;
}

static PyMethodDef rate_method = {"rate", (PyCFunction)(void (*)(void))rate, METH_FASTCALL, "rate(x, t) -> dx/dt"};
static PyMethodDef jacobian_method = {"jacobian", (PyCFunction)(void (*)(void))jacobian, METH_FASTCALL, "jacobian(x, t) -> df/dx"};

static PyObject *bound_to(PyMethodDef *method, PyObject *args) {
    PyObject *parameters, *answer;
    if (!PyArg_ParseTuple(args, "O!O!", &PyArray_Type, &parameters, &PyArray_Type, &answer)) return NULL;
    PyObject *bound = PyTuple_Pack(2, parameters, answer);
    if (bound == NULL) return NULL;
    PyObject *function = PyCFunction_New(method, bound);
    Py_DECREF(bound);
    return function;
}

static PyObject *bind_rate(PyObject *self, PyObject *args) { return bound_to(&rate_method, args); }
static PyObject *bind_jacobian(PyObject *self, PyObject *args) { return bound_to(&jacobian_method, args); }

static PyMethodDef methods[] = {{"rate", bind_rate, METH_VARARGS, "rate(parameters, answer) -> rate"},
                                {"jacobian", bind_jacobian, METH_VARARGS, "jacobian(parameters, answer) -> jacobian"},
                                {NULL, NULL, 0, NULL}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "motor_rate", NULL, -1, methods};

PyMODINIT_FUNC PyInit_motor_rate(void) {
    import_array();
    return PyModule_Create(&module);
}
