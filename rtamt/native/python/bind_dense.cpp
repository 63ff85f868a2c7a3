// The machine over dense time as a Python class.
#include <nanobind/nanobind.h>

#include <utility>
#include <vector>

#include "dense/machine.hpp"
#include "python/bound.hpp"
#include "python/view.hpp"

namespace rtamt {
namespace {

using BoundDense = Bound<dense::DenseMachine>;

constexpr std::size_t kWorthAThread = 10'000;  // events for which others may run meanwhile

std::vector<dense::Row> dense_rows(const nb::sequence& encoded) {
    std::vector<dense::Row> rows;
    rows.reserve(nb::len(encoded));
    for (nb::handle handle : encoded) {
        const auto row = nb::cast<nb::tuple>(handle);
        if (nb::len(row) != 7) throw nb::value_error("expected rows of 7");
        rows.push_back({nb::cast<const char*>(row[0]), nb::cast<const char*>(row[1]),
                        nb::cast<std::size_t>(row[2]), nb::cast<std::size_t>(row[3]),
                        nb::cast<double>(row[4]), nb::cast<double>(row[5]),
                        nb::cast<double>(row[6])});
    }
    return rows;
}

void construct(BoundDense* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result, const nb::sequence& observed,
               nb::object reader) {
    std::vector<std::size_t> looked_at;
    for (nb::handle number : observed) looked_at.push_back(nb::cast<std::size_t>(number));
    new (self) BoundDense{
        dense::DenseMachine(dense_rows(rows), terms, nb::len(variables), result, looked_at),
        Arguments(variables), std::move(reader)};
}

nb::list times_of(const dense::Sampler& sampler,
                  double (dense::Sampler::*time)(std::size_t) const) {
    nb::list times;
    for (std::size_t v = 0; v < sampler.variables(); ++v) times.append((sampler.*time)(v));
    return times;
}

// Raises the error of a call that the reader refuses.
template <class... Args>
[[noreturn]] void refused(const BoundDense& bound, const char* call, Args&&... args) {
    bound.reader.attr(call)(std::forward<Args>(args)...);
    throw std::runtime_error("the reader did not refuse the call");
}

[[noreturn]] void refuse_nan(const BoundDense& bound) {
    const dense::Sampler& sampler = bound.machine.sampler();
    const std::vector<double>& values = sampler.nan_values();
    refused(bound, "refuse", list_of(values.data(), values.size()), sampler.nan_time());
}

// Reads the forms of events that are most frequent; false leaves the others to the reader.
class Forms {
public:
    static const Forms& instance() {
        static const Forms forms;
        return forms;
    }

    bool read(PyObject* events, dense::Pending& out) const {
        if (PyList_CheckExact(events)) return pairs(events, out);
        if (Py_TYPE(events) == events_) return columns(events, out);
        Py_ssize_t n = 0;
        const double* rows = numpy_.rows(events, 2, n);
        if (rows == nullptr) return PyTuple_CheckExact(events) && pairs(events, out);
        resize(out, n);
        for (Py_ssize_t i = 0; i < n; ++i) {
            out.times[i] = rows[2 * i];
            out.values[i] = rows[2 * i + 1];
        }
        return true;
    }

private:
    Forms()
        : events_(reinterpret_cast<PyTypeObject*>(
              nb::object(nb::module_::import_("rtamt.inputs.events").attr("Events")).release().ptr())),
          times_(PyUnicode_InternFromString("times")),
          values_(PyUnicode_InternFromString("values")) {}

    static void resize(dense::Pending& out, Py_ssize_t n) {
        out.times.resize(static_cast<std::size_t>(n));
        out.values.resize(static_cast<std::size_t>(n));
    }

    // A list or tuple of lists or tuples.
    bool pairs(PyObject* events, dense::Pending& out) const {
        const Py_ssize_t n = PySequence_Fast_GET_SIZE(events);
        PyObject** items = PySequence_Fast_ITEMS(events);
        resize(out, n);
        for (Py_ssize_t i = 0; i < n; ++i) {
            PyObject* item = items[i];
            if ((!PyTuple_CheckExact(item) && !PyList_CheckExact(item)) ||
                PySequence_Fast_GET_SIZE(item) != 2)
                return false;
            PyObject** pair = PySequence_Fast_ITEMS(item);
            if (!numpy_.number(pair[0], out.times[i]) || !numpy_.number(pair[1], out.values[i]))
                return false;
        }
        return true;
    }

    bool columns(PyObject* events, dense::Pending& out) const {
        const auto times = nb::steal(PyObject_GetAttr(events, times_));
        const auto values = nb::steal(PyObject_GetAttr(events, values_));
        if (!times.is_valid() || !values.is_valid()) nb::raise_python_error();
        Py_ssize_t n = 0;
        Py_ssize_t size = 0;
        const double* t = numpy_.column(times.ptr(), n);
        const double* v = numpy_.column(values.ptr(), size);
        if (t == nullptr || v == nullptr || n != size) return false;
        out.times.assign(t, t + n);
        out.values.assign(v, v + n);
        return true;
    }

    // Borrowed for ever: they are made once.
    PyTypeObject* events_;
    PyObject* times_;
    PyObject* values_;
    const Numpy& numpy_ = Numpy::instance();
};

bool fit(const BoundDense& bound, std::vector<dense::Pending>& pending) {
    for (std::size_t v = 0; v < pending.size(); ++v)
        if (!bound.machine.sampler().fits(v, pending[v].events())) return false;
    return true;
}

// Dicts, of which no code of a caller runs.
bool read_events(BoundDense& bound, PyObject* events) {
    std::vector<dense::Pending>& pending = bound.machine.pending();
    for (dense::Pending& p : pending) {
        p.times.clear();
        p.values.clear();
    }
    if (!PyDict_CheckExact(events)) return false;
    const Forms& forms = Forms::instance();
    PyObject* name;
    PyObject* value;
    Py_ssize_t place = 0;
    for (std::size_t guess = 0; PyDict_Next(events, &place, &name, &value); ++guess) {
        const std::size_t v = bound.arguments.place(name, guess < pending.size() ? guess : 0);
        if (v == pending.size() || !forms.read(value, pending[v])) return false;
    }
    return fit(bound, pending);
}

// All other forms and the messages are the reader's.
void read_events_slowly(BoundDense& bound, PyObject* events) {
    const nb::object columns = bound.reader.attr("read")(
        nb::handle(events), times_of(bound.machine.sampler(), &dense::Sampler::last_time));
    require_idle(bound);
    if (bound.machine.finished()) refused(bound, "refuse_update");
    std::vector<dense::Pending>& pending = bound.machine.pending();
    if (nb::len(columns) != pending.size())
        throw std::runtime_error("the reader gave another number of columns");
    for (std::size_t v = 0; v < pending.size(); ++v) {
        const nb::object times = columns[v][0];
        const std::size_t n = nb::len(times);
        const View t(times, n, PyBUF_ND);
        const View x(columns[v][1], n, PyBUF_ND);
        pending[v].times.assign(t.data<double>(), t.data<double>() + n);
        pending[v].values.assign(x.data<double>(), x.data<double>() + n);
    }
    if (!fit(bound, pending)) throw std::runtime_error("the reader gave events that do not fit");
}

nb::list fresh(dense::DenseMachine& machine) {
    nb::list list = nb::steal<nb::list>(PyList_New(0));
    machine.drain([&](double time, double value) {
        PyObject* pair = PyTuple_New(2);
        if (pair == nullptr) nb::raise_python_error();
        const auto owned = nb::steal(pair);
        PyObject* t = PyFloat_FromDouble(time);
        PyObject* v = PyFloat_FromDouble(value);
        PyTuple_SET_ITEM(pair, 0, t);
        PyTuple_SET_ITEM(pair, 1, v);
        if (t == nullptr || v == nullptr || PyList_Append(list.ptr(), pair) != 0)
            nb::raise_python_error();
    });
    return list;
}

// Any other call than with one argument: the reader says what it means.
nb::object given(const BoundDense& bound, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    nb::list positional;
    for (Py_ssize_t i = 0; i < n; ++i) positional.append(nb::handle(args[i]));
    nb::dict named;
    const Py_ssize_t names = kwnames ? PyTuple_GET_SIZE(kwnames) : 0;
    for (Py_ssize_t i = 0; i < names; ++i)
        named[nb::handle(PyTuple_GET_ITEM(kwnames, i))] = nb::handle(args[n + i]);
    return bound.reader.attr("given")(nb::tuple(positional), named);
}

PyObject* update_dense(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    if (!nb::inst_ready(self)) [[unlikely]] {
        PyErr_SetString(PyExc_TypeError, "the machine was not made: __init__ was not called");
        return nullptr;
    }
    BoundDense& bound = *nb::inst_ptr<BoundDense>(self);
    try {
        if (bound.running) [[unlikely]] require_idle(bound);
        if (bound.machine.finished()) [[unlikely]] refused(bound, "refuse_update");
        nb::object events;
        if (n == 1 && !kwnames) [[likely]]
            events = nb::borrow(args[0]);
        else
            events = given(bound, args, n, kwnames);
        if (!read_events(bound, events.ptr())) [[unlikely]]
            read_events_slowly(bound, events.ptr());
        if (!bound.machine.take()) [[unlikely]] refuse_nan(bound);
        return fresh(bound.machine).release().ptr();
    } catch (nb::python_error& error) {
        error.restore();
    } catch (const std::exception& error) {
        PyErr_SetString(PyExc_RuntimeError, error.what());
    }
    return nullptr;
}

void end(BoundDense& bound) {
    if (bound.machine.finish()) return;
    const dense::Sampler& sampler = bound.machine.sampler();
    refused(bound, "refuse_end", times_of(sampler, &dense::Sampler::first_time),
            times_of(sampler, &dense::Sampler::last_time));
}

nb::list finish(BoundDense& bound) {
    require_idle(bound);
    if (!bound.machine.finished()) end(bound);
    return fresh(bound.machine);
}

nb::object array_of(const std::vector<double>& values) {
    const nb::object array = nb::module_::import_("numpy").attr("empty")(values.size());
    const View view(array, values.size(), PyBUF_ND | PyBUF_WRITABLE);
    std::copy(values.begin(), values.end(), view.data<double>());
    return array;
}

nb::tuple run(BoundDense& bound, const nb::sequence& columns) {
    require_idle(bound);
    dense::DenseMachine& machine = bound.machine;
    std::vector<View> views;
    std::vector<dense::Events> events;
    std::size_t most = 0;
    for (nb::handle column : columns) {
        const nb::object first = column[0];
        const std::size_t n = nb::len(first);
        views.emplace_back(first, n, PyBUF_ND);
        const auto* times = views.back().data<double>();
        views.emplace_back(column[1], n, PyBUF_ND);
        events.push_back({times, views.back().data<double>(), n});
        most = std::max(most, n);
    }
    const dense::Sampler& sampler = machine.sampler();
    if (events.size() != sampler.variables())
        throw nb::value_error("expected events of every variable");
    for (std::size_t v = 0; v < events.size(); ++v)
        if (sampler.last_time(v) > -kInfinity || !sampler.fits(v, events[v]))
            throw nb::value_error("expected a new machine and events that rise");
    std::vector<double> times;
    std::vector<double> values;
    const auto emit = [&](double time, double value) {
        times.push_back(time);
        values.push_back(value);
    };
    bool fine;
    if (most < kWorthAThread) {
        fine = machine.run(events.data(), emit);
    } else {
        bound.running = true;
        try {
            const nb::gil_scoped_release others;
            fine = machine.run(events.data(), emit);
        } catch (...) {
            bound.running = false;
            throw;
        }
        bound.running = false;
    }
    if (!fine) refuse_nan(bound);
    end(bound);
    machine.drain(emit);
    return nb::make_tuple(array_of(times), array_of(values));
}

PyMethodDef dense_methods[] = {
    {"update", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(update_dense)),
     METH_FASTCALL | METH_KEYWORDS,
     "update($self, /, *events, **named)\n--\n\n"
     "Take in new events of variables; what is newly known of the result."},
    {nullptr, nullptr, 0, nullptr},
};

PyType_Slot dense_slots[] = {
    {Py_tp_methods, dense_methods},
    {Py_tp_traverse, reinterpret_cast<void*>(traverse<dense::DenseMachine>)},
    {Py_tp_clear, reinterpret_cast<void*>(clear<dense::DenseMachine>)},
    {0, nullptr},
};

}  // namespace

void bind_dense(nb::module_& m) {
    nb::class_<BoundDense>(
        m, "DenseMachine", nb::type_slots(dense_slots),
        "Runs a program on events over dense time, as rtamt.machines.protocols.DenseMachine says.\n\n"
        "Args:\n"
        "    rows: The program, as rtamt.program.dense_lowering.encoded_dense writes it.\n"
        "    terms: How many of its instructions are arithmetic over the present values.\n"
        "    variables: Names of the inputs.\n"
        "    result: Register of what update gives.\n"
        "    observed: Registers of what values gives.\n"
        "    reader: Reads the forms of events that are rare, and makes all messages.")
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("observed"), nb::arg("reader"))
        .def_prop_ro("settled", [](const BoundDense& b) { return b.machine.settled(); },
                     "The time before which the result is known; when finished, the end.")
        .def_prop_ro("finished", [](const BoundDense& b) { return b.machine.finished(); },
                     "Whether the trace has ended.")
        .def_prop_ro("values",
                     [](const BoundDense& b) {
                         const std::vector<double> values = b.machine.values();
                         return list_of(values.data(), values.size());
                     },
                     "The last known value of every observed register; nan before the first.")
        .def("finish", finish, "End the trace; the rest of the result.")
        .def("run", run, nb::arg("columns"),
             "Take in a whole trace; the times and values of the result. A machine of which this\n"
             "was asked is of no use after that.")
        .def("reset", reset<dense::DenseMachine>, "Forget every event.")
        .def("state", state<dense::DenseMachine>,
             "Values one behind the other, with a mark of the program.")
        .def("restore", restore<dense::DenseMachine>, nb::arg("state").none(),
             "Continue from where the state was taken.\n\n"
             "Raises:\n"
             "    ValueError: If another program's machine gave it (then nothing changes), or it\n"
             "        is damaged (then the machine is reset).");
}

}  // namespace rtamt
