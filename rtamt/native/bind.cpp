// The machine as a Python class; what its instructions mean is not known here.
#include <nanobind/nanobind.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "machine.hpp"

namespace nb = nanobind;

namespace rtamt {
namespace {

constexpr std::size_t kWorthAThread = 10'000;  // samples for which others may run meanwhile

struct Bound {
    Machine machine;
    Arguments arguments;
    nb::object reader;
    bool running = false;  // without the lock of the interpreter
};

std::vector<Row> rows_of(const nb::sequence& encoded) {
    std::vector<Row> rows;
    rows.reserve(nb::len(encoded));
    for (nb::handle handle : encoded) {
        const auto row = nb::cast<nb::tuple>(handle);
        if (nb::len(row) != 8) throw nb::value_error("expected rows of 8");
        rows.push_back({nb::cast<std::size_t>(row[0]), nb::cast<const char*>(row[1]),
                        nb::cast<const char*>(row[2]), nb::cast<std::size_t>(row[3]),
                        nb::cast<std::size_t>(row[4]), nb::cast<double>(row[5]),
                        nb::cast<std::size_t>(row[6]), nb::cast<std::int64_t>(row[7])});
    }
    return rows;
}

void construct(Bound* self, const nb::sequence& rows, std::size_t terms,
               const nb::tuple& variables, std::size_t result, const nb::sequence& observed,
               nb::object reader) {
    std::vector<Observed> looked_at;
    for (nb::handle pair : observed)
        looked_at.push_back({nb::cast<std::size_t>(pair[0]), nb::cast<std::int64_t>(pair[1])});
    if (looked_at.empty() || looked_at[0].slot != result)
        throw nb::value_error("expected the result first among the observed");
    new (self) Bound{Machine(rows_of(rows), terms, nb::len(variables), looked_at),
                       Arguments(variables), std::move(reader)};
}

void require_idle(const Bound& bound) {
    if (bound.running) throw std::runtime_error("the machine is running in another thread");
}

nb::list list_of(const double* values, std::size_t n) {
    nb::list list;
    for (std::size_t i = 0; i < n; ++i) list.append(values[i]);
    return list;
}

nb::list inputs(const Bound& bound) {
    const Machine& machine = bound.machine;
    return list_of(machine.inputs(), machine.samples() > 0 ? machine.variables() : 0);
}

nb::list registers(const Bound& bound) {
    const std::vector<double>& values = bound.machine.registers();
    return list_of(values.data(), values.size());
}

[[noreturn]] void refuse(const Bound& bound, const double* values, std::int64_t sample) {
    bound.reader.attr("refuse")(list_of(values, bound.machine.variables()), sample);
    throw std::runtime_error("the reader did not refuse a term that is nan");
}

bool any_nan(const double* values, std::size_t n) {
    for (std::size_t i = 0; i < n; ++i)
        if (values[i] != values[i]) return true;
    return false;
}

// The argument forms that are rare, the nan policy and the messages are the reader's.
void read_slowly(Bound& bound, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    nb::list positional;
    for (Py_ssize_t i = 0; i < n; ++i) positional.append(nb::handle(args[i]));
    nb::dict named;
    const Py_ssize_t keywords = kwnames == nullptr ? 0 : PyTuple_GET_SIZE(kwnames);
    for (Py_ssize_t i = 0; i < keywords; ++i)
        named[nb::handle(PyTuple_GET_ITEM(kwnames, i))] = nb::handle(args[n + i]);
    const nb::object values = bound.reader.attr("read")(nb::tuple(positional), named,
                                                        bound.machine.samples(), inputs(bound));
    require_idle(bound);
    if (nb::len(values) != bound.machine.variables())
        throw std::runtime_error("the reader gave another number of values");
    double* pending = bound.machine.pending();
    for (nb::handle value : values) *pending++ = nb::cast<double>(value);
    if (!bound.machine.take())
        refuse(bound, bound.machine.pending(), bound.machine.samples());
}

bool read_at_once(Bound& bound, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    Arguments& arguments = bound.arguments;
    double* pending = bound.machine.pending();
    if (kwnames != nullptr) return n == 0 && arguments.keywords(args, kwnames, pending);
    if (n == 1) {
        if (PyDict_CheckExact(args[0])) return arguments.dict(args[0], pending);
        if (arguments.is_array(args[0])) return arguments.array(args[0], pending);
    }
    return static_cast<std::size_t>(n) == arguments.size() && arguments.positional(args, pending);
}

PyObject* update(PyObject* self, PyObject* const* args, Py_ssize_t n, PyObject* kwnames) {
    if (!nb::inst_ready(self)) [[unlikely]] {
        PyErr_SetString(PyExc_TypeError, "the machine was not made: __init__ was not called");
        return nullptr;
    }
    Bound& bound = *nb::inst_ptr<Bound>(self);
    Machine& machine = bound.machine;
    try {
        if (bound.running) [[unlikely]] require_idle(bound);
        if (!read_at_once(bound, args, n, kwnames)) [[unlikely]] {
            read_slowly(bound, args, n, kwnames);
        } else if (!machine.take()) [[unlikely]] {
            if (!any_nan(machine.pending(), machine.variables()))
                refuse(bound, machine.pending(), machine.samples());
            read_slowly(bound, args, n, kwnames);
        }
        return PyFloat_FromDouble(machine.result());
    } catch (nb::python_error& error) {
        error.restore();
    } catch (const std::exception& error) {
        PyErr_SetString(PyExc_RuntimeError, error.what());
    }
    return nullptr;
}

// A 1-D array of doubles whose memory stays where it is.
class View {
public:
    View(nb::object array, std::size_t n, int flags) : array_(std::move(array)) {
        if (PyObject_GetBuffer(array_.ptr(), &view_, flags | PyBUF_ND) != 0)
            nb::raise_python_error();
        if (view_.ndim != 1 || static_cast<std::size_t>(view_.shape[0]) != n) {
            PyBuffer_Release(&view_);
            throw nb::value_error("expected 1-D columns of n values");
        }
    }
    View(View&& other) noexcept : array_(std::move(other.array_)), view_(other.view_) {
        other.view_.obj = nullptr;  // of which PyBuffer_Release does nothing
    }
    ~View() { PyBuffer_Release(&view_); }

    double* values() const { return static_cast<double*>(view_.buf); }
    const nb::object& array() const { return array_; }

private:
    nb::object array_;
    Py_buffer view_;
};

nb::list run(Bound& bound, const nb::sequence& columns, std::size_t n, bool final) {
    require_idle(bound);
    Machine& machine = bound.machine;
    if (final && machine.samples() > 0)
        throw nb::value_error("expected a new machine for a whole trace");
    const auto numpy = nb::module_::import_("numpy");
    std::vector<View> in;
    std::vector<View> out;
    std::vector<const double*> sources;
    std::vector<double*> targets;
    for (nb::handle column : columns) {
        in.emplace_back(numpy.attr("ascontiguousarray")(column, "float64"), n, PyBUF_SIMPLE);
        sources.push_back(in.back().values());
    }
    if (in.size() != machine.variables())
        throw nb::value_error("expected a column for every variable");
    for (std::size_t i = 0; i < machine.observed(); ++i) {
        out.emplace_back(numpy.attr("empty")(n), n, PyBUF_WRITABLE);
        targets.push_back(out.back().values());
    }
    require_idle(bound);
    std::size_t taken;
    const std::int64_t sample = machine.samples();
    if (n < kWorthAThread) {
        taken = machine.run(sources.data(), n, final, targets.data());
    } else {
        bound.running = true;
        try {
            const nb::gil_scoped_release others;
            taken = machine.run(sources.data(), n, final, targets.data());
        } catch (...) {
            bound.running = false;
            throw;
        }
        bound.running = false;
    }
    if (taken < n) {
        std::vector<double> values;
        for (const double* source : sources) values.push_back(source[taken]);
        refuse(bound, values.data(), sample + static_cast<std::int64_t>(taken));
    }
    nb::list arrays;
    for (const View& view : out) arrays.append(view.array());
    return arrays;
}

void reset(Bound& bound) {
    require_idle(bound);
    bound.machine.reset();
}

nb::bytes state(const Bound& bound) {
    require_idle(bound);
    const std::string bytes = bound.machine.state();
    return nb::bytes(bytes.data(), bytes.size());
}

void restore(Bound& bound, nb::handle state) {
    require_idle(bound);
    if (!PyBytes_Check(state.ptr())) throw nb::value_error(Machine::kForeign);
    const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(state.ptr()));
    bound.machine.restore({PyBytes_AS_STRING(state.ptr()), size});
}

int traverse(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (!nb::inst_ready(self)) return 0;
    const Bound& bound = *nb::inst_ptr<Bound>(self);
    Py_VISIT(bound.reader.ptr());
    return bound.arguments.traverse(visit, arg);
}

int clear(PyObject* self) {
    // Names are text and tuples of text: no cycle goes through them.
    if (nb::inst_ready(self)) nb::inst_ptr<Bound>(self)->reader = nb::none();
    return 0;
}

PyMethodDef methods[] = {
    {"update", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(update)),
     METH_FASTCALL | METH_KEYWORDS,
     "update($self, /, *args, **named)\n--\n\n"
     "Take in one sample, by position, by name, as a mapping or as an array; the result."},
    {nullptr, nullptr, 0, nullptr},
};

PyType_Slot slots[] = {
    {Py_tp_methods, methods},
    {Py_tp_traverse, reinterpret_cast<void*>(traverse)},
    {Py_tp_clear, reinterpret_cast<void*>(clear)},
    {0, nullptr},
};

}  // namespace
}  // namespace rtamt

NB_MODULE(_native, m) {
    using namespace rtamt;
    m.doc() = "The machines of rtamt in C++.";

    nb::class_<Bound>(m, "Machine", nb::type_slots(slots),
                      "Runs a program on samples, as rtamt.discrete.Machine does.\n\n"
                      "Args:\n"
                      "    rows: The program, as rtamt.schedule.encoded writes it.\n"
                      "    terms: How many of its instructions are arithmetic over the sample.\n"
                      "    variables: Names of the inputs.\n"
                      "    result: Register of what update gives.\n"
                      "    observed: Registers with their latencies: the result, what run gives.\n"
                      "    reader: Reads the arguments that are rare, and makes all messages.")
        .def("__init__", construct, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("observed"), nb::arg("reader"))
        .def_prop_ro("samples", [](const Bound& b) { return b.machine.samples(); },
                     "Samples taken in since the reset.")
        .def_prop_ro("registers", registers, "The value of every register.")
        .def_prop_ro("inputs", inputs, "The last sample, empty before the first.")
        .def("run", run, nb::arg("columns"), nb::arg("n"), nb::kw_only(), nb::arg("final"),
             "Take in n samples at once, all or none; the observed registers at each.")
        .def("reset", reset, "Forget every sample.")
        .def("state", state, "Values one behind the other, with a mark of the program.")
        .def("restore", restore, nb::arg("state").none(),
             "Continue from where the state was taken.\n\n"
             "Raises:\n"
             "    ValueError: If another program's machine gave it (then nothing changes), or it\n"
             "        is damaged (then the machine is reset).");

    nb::dict functions;
    nb::dict monoids;
    nb::list kinds;
#define RTAMT_NAME(name, arity, value) functions[#name] = arity;
    RTAMT_FUNCTIONS(RTAMT_NAME)
#undef RTAMT_NAME
#define RTAMT_NAME(name, Type) monoids[#name] = Type::width;
    RTAMT_MONOIDS(RTAMT_NAME)
#undef RTAMT_NAME
#define RTAMT_NAME(name) kinds.append(#name);
    RTAMT_KINDS(RTAMT_NAME)
#undef RTAMT_NAME
    m.attr("FUNCTIONS") = functions;
    m.attr("MONOIDS") = monoids;
    m.attr("KINDS") = nb::tuple(kinds);
}
