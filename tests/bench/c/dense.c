/* What the least of a signal over the next second costs at least, when Python hands over events: a
 * monotonic wedge over the steps, behind methods that read a dict of a list of one pair, a dict of
 * an array of pairs, or two whole arrays. Gives the breakpoints that are settled. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>

enum { SIZE = 1 << 16 }; /* steps inside a window, at most */

typedef struct {
    double value, leaves; /* the newest one leaves at INFINITY, as its end is not known */
} Entry;

typedef struct {
    PyObject_HEAD
    Entry *ring; /* values that rise from head to tail */
    uint64_t head, tail;
    double reach, last, waits_since, waits; /* the last breakpoint is not settled yet */
} Steps;

typedef int (*Emit)(void *out, double time, double value);

static inline int steps_set(Steps *s, double time, double value, Emit emit, void *out) {
    if (time != s->waits_since && s->waits_since > -INFINITY && s->waits != s->last) {
        if (emit(out, s->waits_since, s->waits) < 0) return -1;
        s->last = s->waits;
    }
    s->waits_since = time;
    s->waits = value;
    return 0;
}

static inline int steps_take(Steps *s, double time, double value, Emit emit, void *out) {
    double now = time - s->reach;
    value += 2.0;
    if (s->tail != s->head) s->ring[(s->tail - 1) & (SIZE - 1)].leaves = time;
    while (s->tail != s->head && s->ring[s->head & (SIZE - 1)].leaves <= now) {
        double leaves = s->ring[s->head++ & (SIZE - 1)].leaves;
        if (s->tail != s->head && leaves < now &&
            steps_set(s, leaves, s->ring[s->head & (SIZE - 1)].value, emit, out) < 0)
            return -1;
    }
    while (s->tail != s->head && s->ring[(s->tail - 1) & (SIZE - 1)].value >= value) s->tail--;
    s->ring[s->tail++ & (SIZE - 1)] = (Entry){value, INFINITY};
    double least = s->ring[s->head & (SIZE - 1)].value;
    return least != s->waits ? steps_set(s, now, least, emit, out) : 0;
}

static int append(void *list, double time, double value) {
    PyObject *pair = PyTuple_New(2);
    if (!pair) return -1;
    PyTuple_SET_ITEM(pair, 0, PyFloat_FromDouble(time));
    PyTuple_SET_ITEM(pair, 1, PyFloat_FromDouble(value));
    int failed = PyList_Append(list, pair);
    Py_DECREF(pair);
    return failed;
}

static int store(void *out, double time, double value) {
    double **next = out;
    *(*next)++ = time;
    *(*next)++ = value;
    return 0;
}

static PyObject *name_s;

/* update({"s": [(time, value)]}) */
static PyObject *steps_update(PyObject *self, PyObject *events) {
    PyObject *list = PyDict_CheckExact(events) ? PyDict_GetItemWithError(events, name_s) : NULL;
    if (!list || !PyList_CheckExact(list)) return PyErr_Format(PyExc_TypeError, "a list of s");
    PyObject *out = PyList_New(0);
    for (Py_ssize_t i = 0; out && i < PyList_GET_SIZE(list); i++) {
        PyObject *pair = PyList_GET_ITEM(list, i);
        if (!PyTuple_CheckExact(pair) || PyTuple_GET_SIZE(pair) != 2)
            return PyErr_Format(PyExc_TypeError, "a pair");
        double time = PyFloat_AsDouble(PyTuple_GET_ITEM(pair, 0));
        double value = PyFloat_AsDouble(PyTuple_GET_ITEM(pair, 1));
        if (steps_take((Steps *)self, time, value, append, out) < 0) return NULL;
    }
    return out;
}

/* update_array({"s": array of shape (n, 2)}) */
static PyObject *steps_update_array(PyObject *self, PyObject *events) {
    PyObject *array = PyDict_CheckExact(events) ? PyDict_GetItemWithError(events, name_s) : NULL;
    Py_buffer view;
    if (!array || PyObject_GetBuffer(array, &view, PyBUF_ND) < 0) return NULL;
    PyObject *out = PyList_New(0);
    const double *row = view.buf;
    for (Py_ssize_t i = 0; i < view.shape[0]; i++, row += 2)
        if (steps_take((Steps *)self, row[0], row[1], append, out) < 0) return NULL;
    PyBuffer_Release(&view);
    return out;
}

/* run(times, values, out) -> breakpoints; out has room for two numbers for each event and more. */
static PyObject *steps_run(PyObject *self, PyObject *args) {
    Py_buffer times, values, out;
    if (!PyArg_ParseTuple(args, "y*y*w*", &times, &values, &out)) return NULL;
    double *next = out.buf;
    for (Py_ssize_t i = 0; i < times.len / 8; i++)
        steps_take((Steps *)self, ((double *)times.buf)[i], ((double *)values.buf)[i], store,
                   &next);
    Py_ssize_t count = (next - (double *)out.buf) / 2;
    PyBuffer_Release(&times);
    PyBuffer_Release(&values);
    PyBuffer_Release(&out);
    return PyLong_FromSsize_t(count);
}

static PyObject *steps_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    double reach;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "d", &reach)) return NULL;
    Steps *s = (Steps *)type->tp_alloc(type, 0);
    if (!s) return NULL;
    s->ring = malloc(SIZE * sizeof(Entry));
    s->reach = reach;
    s->last = s->waits = NAN;
    s->waits_since = -INFINITY;
    return (PyObject *)s;
}

static void steps_dealloc(PyObject *self) {
    free(((Steps *)self)->ring);
    Py_TYPE(self)->tp_free(self);
}

static PyMethodDef steps_methods[] = {
    {"update", steps_update, METH_O, NULL},
    {"update_array", steps_update_array, METH_O, NULL},
    {"run", steps_run, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyTypeObject steps_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "cdense.Steps",
    .tp_basicsize = sizeof(Steps),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = steps_new,
    .tp_dealloc = steps_dealloc,
    .tp_methods = steps_methods,
};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = "cdense", .m_size = -1};

PyMODINIT_FUNC PyInit_cdense(void) {
    name_s = PyUnicode_InternFromString("s");
    if (PyType_Ready(&steps_type) < 0) return NULL;
    PyObject *made = PyModule_Create(&module);
    if (made && PyModule_AddObjectRef(made, "Steps", (PyObject *)&steps_type) < 0) return NULL;
    return made;
}
