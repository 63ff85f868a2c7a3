// The dense machine as a Python class.
#include <nanobind/nanobind.h>

#include <utility>
#include <vector>

#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

using DenseObject = NamedObject<DenseMachine>;

void construct(DenseObject* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result, const nb::sequence& observed,
               nb::object reader) {
    new (self) DenseObject{{DenseMachine(dense_rows(rows), terms, nb::len(variables), result,
                                         registers_of(observed)),
                            std::move(reader)},
                           Arguments(variables)};
}

nb::list times_of(const dense::Sampler& sampler,
                  double (dense::Sampler::*time)(std::size_t) const) {
    nb::list times;
    for (std::size_t v = 0; v < sampler.variables(); ++v) times.append((sampler.*time)(v));
    return times;
}

[[noreturn]] void refuse_nan(const DenseObject& object) {
    const dense::Sampler& sampler = object.machine.sampler();
    const std::vector<double>& values = sampler.nan_values();
    refuse(object.reader, "refuse", list_of(values.data(), values.size()), sampler.nan_time());
}

// Reads the frequent forms of a variable's events; false if they have another form.
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

    PyTypeObject* events_ = permanent_type("rtamt.inputs.events", "Events");
    PyObject* times_ = PyUnicode_InternFromString("times");
    PyObject* values_ = PyUnicode_InternFromString("values");
    const Numpy& numpy_ = Numpy::instance();
};

bool fit(const DenseObject& object, std::vector<dense::Pending>& pending) {
    for (std::size_t v = 0; v < pending.size(); ++v)
        if (!object.machine.sampler().fits(v, pending[v].events())) return false;
    return true;
}

// Reads a dict of frequent forms, which runs no code of a caller; false if events are not that.
bool read_events(DenseObject& object, PyObject* events) {
    std::vector<dense::Pending>& pending = object.machine.pending();
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
        const std::size_t v = object.arguments.place(name, guess < pending.size() ? guess : 0);
        if (v == pending.size() || !forms.read(value, pending[v])) return false;
    }
    return fit(object, pending);
}

// The events of a pair of arrays.
class EventViews {
public:
    explicit EventViews(nb::handle pair)
        : size_(nb::len(nb::object(pair[0]))),
          times_(pair[0], size_, PyBUF_ND),
          values_(pair[1], size_, PyBUF_ND) {}

    dense::Events events() const {
        return {times_.data<double>(), values_.data<double>(), size_};
    }

private:
    std::size_t size_;
    ArrayView times_;
    ArrayView values_;
};

// Leaves the rare forms of events and all errors to the reader.
void read_events_slowly(DenseObject& object, PyObject* events) {
    const nb::object columns = object.reader.attr("read")(
        nb::handle(events), times_of(object.machine.sampler(), &dense::Sampler::last_time));
    require_idle(object);
    if (object.machine.finished()) refuse(object.reader, "refuse_update");
    std::vector<dense::Pending>& pending = object.machine.pending();
    if (nb::len(columns) != pending.size())
        throw std::runtime_error("the reader gave another number of columns");
    for (std::size_t v = 0; v < pending.size(); ++v) {
        const EventViews views(columns[v]);
        const dense::Events events = views.events();
        pending[v].times.assign(events.times, events.times + events.size);
        pending[v].values.assign(events.values, events.values + events.size);
    }
    if (!fit(object, pending)) throw std::runtime_error("the reader gave events that do not fit");
}

nb::list new_steps(DenseMachine& machine) {
    nb::list list = nb::steal<nb::list>(PyList_New(0));
    machine.drain([&](double time, double value) {
        const auto pair = nb::steal(pair_of(time, value));
        if (!pair.is_valid() || PyList_Append(list.ptr(), pair.ptr()) != 0)
            nb::raise_python_error();
    });
    return list;
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    return call<DenseObject>(self, [=](DenseObject& object) {
        if (object.running) [[unlikely]] require_idle(object);
        if (object.machine.finished()) [[unlikely]] refuse(object.reader, "refuse_update");
        nb::object events;
        if (n == 1 && !kwnames) [[likely]] {
            events = nb::borrow(args[0]);
        } else {
            const auto [positional, named] = packed(args, n, kwnames);
            events = object.reader.attr("given")(positional, named);
        }
        if (!read_events(object, events.ptr())) [[unlikely]]
            read_events_slowly(object, events.ptr());
        if (!object.machine.take()) [[unlikely]] refuse_nan(object);
        return new_steps(object.machine).release().ptr();
    });
}

void end(DenseObject& object) {
    if (object.machine.finish()) return;
    const dense::Sampler& sampler = object.machine.sampler();
    refuse(object.reader, "refuse_end", times_of(sampler, &dense::Sampler::first_time),
            times_of(sampler, &dense::Sampler::last_time));
}

nb::list finish(DenseObject& object) {
    require_idle(object);
    if (!object.machine.finished()) end(object);
    return new_steps(object.machine);
}

nb::tuple run(DenseObject& object, const nb::sequence& columns) {
    require_idle(object);
    DenseMachine& machine = object.machine;
    std::vector<EventViews> views;
    std::vector<dense::Events> events;
    std::size_t most = 0;
    for (nb::handle column : columns) {
        views.emplace_back(column);
        events.push_back(views.back().events());
        most = std::max(most, events.back().size);
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
    const bool fine = run_long(object, most, [&] { return machine.run(events.data(), emit); });
    if (!fine) refuse_nan(object);
    end(object);
    machine.drain(emit);
    return nb::make_tuple(doubles(times.data(), times.size()),
                          doubles(values.data(), values.size()));
}

PyMethodDef methods[] = {
    update_method(update,
                  "update($self, /, *events, **named)\n--\n\n"
                  "Take in new events of variables; return the new steps of the result."),
    {nullptr, nullptr, 0, nullptr},
};

}  // namespace

void bind_dense(nb::module_& m) {
    machine_class<DenseObject>(
        m, "DenseMachine",
        "Runs a program over dense time, as rtamt.machines.protocols.DenseMachine says.\n\n"
        "Args:\n"
        "    rows: The program, as rtamt.program.encoding encodes it.\n"
        "    terms: The number of rows that are arithmetic over the present values.\n"
        "    variables: Names of the inputs.\n"
        "    result: Register that update returns.\n"
        "    observed: Registers that values lists.\n"
        "    reader: Reads the rare forms of events, and raises all errors.",
        methods)
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("observed"), nb::arg("reader"))
        .def_prop_ro("settled", [](const DenseObject& o) { return o.machine.settled(); },
                     "The time before which the result is known; when finished, the end.")
        .def_prop_ro("finished", [](const DenseObject& o) { return o.machine.finished(); },
                     "Whether the trace has ended.")
        .def_prop_ro("values",
                     [](const DenseObject& o) {
                         const std::vector<double> values = o.machine.values();
                         return list_of(values.data(), values.size());
                     },
                     "The last known value of every observed register; nan before the first.")
        .def("finish", finish, "End the trace; return the rest of the result.")
        .def("run", run, nb::arg("columns"),
             "Take in a whole trace; return the times and values of the result. The machine is of\n"
             "no use after that.")
        .def("reset", reset<DenseObject>, "Return to the state before the first event.");
}

}  // namespace rtamt
