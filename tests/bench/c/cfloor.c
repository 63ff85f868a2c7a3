/* What an update costs at least when Python calls it: a sliding minimum of a + b + 2 by a monotonic
 * wedge behind a METH_FASTCALL method; and whole traces by doubling, in blocks that stay in cache. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>

typedef struct {
    double value;
    int64_t time;
} Entry;

typedef struct {
    PyObject_HEAD
    Entry *ring; /* values that rise from head to tail */
    uint64_t mask, head, tail;
    int64_t now, reach;
} Wedge;

static PyObject *name_a, *name_b;

static int wedge_grow(Wedge *w) {
    uint64_t size = w->mask + 1;
    Entry *ring = malloc(2 * size * sizeof(Entry));
    if (!ring) {
        PyErr_NoMemory();
        return -1;
    }
    for (uint64_t i = w->head; i < w->tail; i++) ring[i & (2 * size - 1)] = w->ring[i & w->mask];
    free(w->ring);
    w->ring = ring;
    w->mask = 2 * size - 1;
    return 0;
}

static inline int wedge_take(Wedge *w, double a, double b, double *least) {
    double value = a + b + 2.0;
    while (w->tail != w->head && w->ring[(w->tail - 1) & w->mask].value >= value) w->tail--;
    if (w->tail - w->head == w->mask + 1 && wedge_grow(w) < 0) return -1;
    w->ring[w->tail++ & w->mask] = (Entry){value, w->now};
    if (w->ring[w->head & w->mask].time < w->now - w->reach) w->head++;
    w->now++;
    *least = w->ring[w->head & w->mask].value;
    return 0;
}

static PyObject *wedge_push(Wedge *w, PyObject *first, PyObject *second) {
    double a = PyFloat_AsDouble(first), b = PyFloat_AsDouble(second), least;
    if ((a == -1.0 || b == -1.0) && PyErr_Occurred()) return NULL;
    return wedge_take(w, a, b, &least) < 0 ? NULL : PyFloat_FromDouble(least);
}

/* batch(wedges, rows, out): a row of two numbers and a result for each of a list of wedges. */
static PyObject *batch(PyObject *module, PyObject *args) {
    PyObject *wedges;
    Py_buffer rows, out;
    (void)module;
    if (!PyArg_ParseTuple(args, "O!y*w*", &PyList_Type, &wedges, &rows, &out)) return NULL;
    const double *row = rows.buf;
    int failed = 0;
    for (Py_ssize_t i = 0; i < PyList_GET_SIZE(wedges) && !failed; i++, row += 2)
        failed = wedge_take((Wedge *)PyList_GET_ITEM(wedges, i), row[0], row[1],
                            (double *)out.buf + i) < 0;
    PyBuffer_Release(&rows);
    PyBuffer_Release(&out);
    if (failed) return NULL;
    Py_RETURN_NONE;
}

static PyObject *wedge_update(PyObject *self, PyObject *const *args, Py_ssize_t n) {
    if (n != 2) return PyErr_Format(PyExc_TypeError, "expected 2 arguments, got %zd", n);
    return wedge_push((Wedge *)self, args[0], args[1]);
}

static PyObject *wedge_update_dict(PyObject *self, PyObject *sample) {
    if (!PyDict_CheckExact(sample)) return PyErr_Format(PyExc_TypeError, "expected a dict");
    PyObject *a = PyDict_GetItemWithError(sample, name_a);
    PyObject *b = PyDict_GetItemWithError(sample, name_b);
    if (!a || !b) return PyErr_Occurred() ? NULL : PyErr_Format(PyExc_KeyError, "a, b");
    return wedge_push((Wedge *)self, a, b);
}

static PyObject *wedge_nothing(PyObject *self, PyObject *const *args, Py_ssize_t n) {
    (void)self, (void)args, (void)n;
    Py_RETURN_NONE;
}

static PyObject *wedge_new(PyTypeObject *type, PyObject *args, PyObject *keywords) {
    long long reach;
    (void)keywords;
    if (!PyArg_ParseTuple(args, "L", &reach)) return NULL;
    Wedge *w = (Wedge *)type->tp_alloc(type, 0);
    if (!w) return NULL;
    w->mask = 15;
    w->reach = reach;
    w->ring = malloc(16 * sizeof(Entry));
    return (PyObject *)w;
}

static void wedge_dealloc(PyObject *self) {
    free(((Wedge *)self)->ring);
    Py_TYPE(self)->tp_free(self);
}

/* Minimum over [t, t + reach] for t = 0 .. n - 1, the windows cut at the end of the trace. */
enum { BLOCK = 8192 };

static void finish_window(double *restrict x, int64_t have, int64_t width, double *restrict out,
                          int64_t want) {
    int64_t length = 1;
    for (; 2 * length <= width; length *= 2) {
        have -= length;
        for (int64_t i = 0; i < have; i++) x[i] = x[i] < x[i + length] ? x[i] : x[i + length];
    }
    int64_t rest = width - length;
    for (int64_t i = 0; i < want; i++) out[i] = x[i] < x[i + rest] ? x[i] : x[i + rest];
}

static void window_minimum(const double *in, double sign, int64_t reach, double *out, int64_t n,
                           double *scratch) {
    for (int64_t start = 0; start < n; start += BLOCK) {
        int64_t want = n - start < BLOCK ? n - start : BLOCK, have = want + reach;
        int64_t there = n - start < have ? n - start : have;
        for (int64_t i = 0; i < there; i++) scratch[i] = sign * in[start + i];
        for (int64_t i = there; i < have; i++) scratch[i] = INFINITY;
        finish_window(scratch, have, reach + 1, out + start, want);
    }
    if (sign < 0)
        for (int64_t i = 0; i < n; i++) out[i] = -out[i];
}

static void always(double *x, int64_t n) {
    for (int64_t i = n - 2; i >= 0; i--) x[i] = x[i] < x[i + 1] ? x[i] : x[i + 1];
}

static void run_w1(const double *a, const double *b, double *out, int64_t n, int64_t reach,
                   double *scratch) {
    for (int64_t start = 0; start < n; start += BLOCK) {
        int64_t want = n - start < BLOCK ? n - start : BLOCK, have = want + reach;
        int64_t there = n - start < have ? n - start : have;
        for (int64_t i = 0; i < there; i++) scratch[i] = a[start + i] + b[start + i] + 2.0;
        for (int64_t i = there; i < have; i++) scratch[i] = INFINITY;
        finish_window(scratch, have, reach + 1, out + start, want);
    }
}

static void run_resp(const double *req, const double *gnt, double *out, int64_t n, double *scratch) {
    window_minimum(gnt, -1.0, 5, out, n, scratch);
    for (int64_t i = 0; i < n; i++) {
        double no = 3.0 - req[i], yes = out[i] - 3.0;
        out[i] = no > yes ? no : yes;
    }
    always(out, n);
}

static void run_nested(const double *cmd, const double *pos, double *out, int64_t n,
                       double *between, double *scratch) {
    for (int64_t i = 0; i < n; i++) out[i] = 0.1 - fabs(cmd[i] - pos[i]);
    window_minimum(out, 1.0, 50, between, n, scratch);
    window_minimum(between, -1.0, 200, out, n, scratch);
    for (int64_t i = 0; i < n; i++) {
        double no = 1.0 - cmd[i];
        if (no > out[i]) out[i] = no;
    }
    always(out, n);
}

/* offline(kind, reach, first, second, out): kind 0 is W1, 1 the response, 2 the nested one. */
static PyObject *offline(PyObject *module, PyObject *args) {
    int kind;
    long long reach;
    Py_buffer a, b, out;
    (void)module;
    if (!PyArg_ParseTuple(args, "iLy*y*w*", &kind, &reach, &a, &b, &out)) return NULL;
    int64_t n = out.len / 8;
    double *scratch = malloc((BLOCK + (reach > 200 ? reach : 200)) * 8), *between = NULL;
    if (kind == 0) run_w1(a.buf, b.buf, out.buf, n, reach, scratch);
    if (kind == 1) run_resp(a.buf, b.buf, out.buf, n, scratch);
    if (kind == 2) {
        between = malloc(n * 8);
        run_nested(a.buf, b.buf, out.buf, n, between, scratch);
    }
    free(scratch);
    free(between);
    PyBuffer_Release(&a);
    PyBuffer_Release(&b);
    PyBuffer_Release(&out);
    Py_RETURN_NONE;
}

static PyMethodDef wedge_methods[] = {
    {"update", (PyCFunction)(void (*)(void))wedge_update, METH_FASTCALL, NULL},
    {"update_dict", wedge_update_dict, METH_O, NULL},
    {"nothing", (PyCFunction)(void (*)(void))wedge_nothing, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};

static PyTypeObject wedge_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "cfloor.Wedge",
    .tp_basicsize = sizeof(Wedge),
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_new = wedge_new,
    .tp_dealloc = wedge_dealloc,
    .tp_methods = wedge_methods,
};

static PyMethodDef functions[] = {
    {"offline", offline, METH_VARARGS, NULL},
    {"batch", batch, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, .m_name = "cfloor", .m_size = -1, .m_methods = functions};

PyMODINIT_FUNC PyInit_cfloor(void) {
    name_a = PyUnicode_InternFromString("a");
    name_b = PyUnicode_InternFromString("b");
    if (PyType_Ready(&wedge_type) < 0) return NULL;
    PyObject *made = PyModule_Create(&module);
    if (made && PyModule_AddObjectRef(made, "Wedge", (PyObject *)&wedge_type) < 0) return NULL;
    return made;
}
