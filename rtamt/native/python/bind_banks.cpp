// Banks of machines as Python classes: rtamt/bank.py says what the calls mean.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "lockstep/bank.hpp"
#include "python/bound.hpp"
#include "python/encoded.hpp"
#include "python/view.hpp"

namespace rtamt {
namespace {

template <class B>
struct BoundBank {
    B bank;
    nb::object reader;
};

using BoundDiscreteBank = BoundBank<DiscreteBank>;
using BoundEpisodeBank = BoundBank<EpisodeBank>;

// An array of some lanes' samples, or of which lanes are meant, and its memory.
template <class T>
class Held {
public:
    Held(nb::object array, const T* fast) : array_(std::move(array)), data_(fast) {}
    Held(nb::object array, std::size_t n) : array_(std::move(array)) {
        view_.emplace_back(array_.attr("reshape")(-1), n, PyBUF_ND);
        data_ = view_.front().template data<T>();
    }
    const nb::object& array() const { return array_; }
    const T* data() const { return data_; }

private:
    nb::object array_;
    std::vector<View> view_;
    const T* data_;
};

template <class B>
Held<bool> mask_of(const BoundBank<B>& bound, nb::handle mask) {
    if (mask.is_none()) return {nb::none(), static_cast<const bool*>(nullptr)};
    const std::size_t num = bound.bank.num();
    const bool* fast = Numpy::instance().mask(mask.ptr(), static_cast<Py_ssize_t>(num));
    if (fast != nullptr) return {nb::borrow(mask), fast};
    return {bound.reader.attr("mask")(mask), num};
}

template <class B>
Held<double> table_of(const BoundBank<B>& bound, nb::handle values) {
    const std::size_t num = bound.bank.num();
    const std::size_t width = bound.bank.variables();
    const double* fast = Numpy::instance().table(values.ptr(), static_cast<Py_ssize_t>(num),
                                                 static_cast<Py_ssize_t>(width));
    if (fast != nullptr) return {nb::borrow(values), fast};
    return {bound.reader.attr("values")(values), num * width};
}

// Makes the arrays that are handed out: fresh ones, a number for each lane.
class Fresh {
public:
    explicit Fresh(const char* dtype)
        : empty_(nb::object(numpy().attr("empty")).release().ptr()),
          dtype_(nb::object(numpy().attr("dtype")(dtype)).release().ptr()) {}

    template <class T, class Value>
    nb::object operator()(std::size_t n, Value value) const {
        const nb::int_ size(n);
        PyObject* arguments[] = {size.ptr(), dtype_};
        PyObject* made = PyObject_Vectorcall(empty_, arguments, 2, nullptr);
        if (made == nullptr) nb::raise_python_error();
        nb::object array = nb::steal(made);
        auto* elements = static_cast<T*>(Numpy::instance().begin(made));
        std::vector<View> view;
        if (elements == nullptr) {
            view.emplace_back(array, n, PyBUF_ND | PyBUF_WRITABLE);
            elements = view.front().template data<T>();
        }
        for (std::size_t i = 0; i < n; ++i) elements[i] = value(i);
        return array;
    }

private:
    static nb::module_ numpy() { return nb::module_::import_("numpy"); }

    // Borrowed for ever: numpy cannot be unloaded.
    PyObject* empty_;
    PyObject* dtype_;
};

nb::object doubles(const double* values, std::size_t n) {
    static const Fresh fresh("float64");
    return fresh.operator()<double>(n, [values](std::size_t i) { return values[i]; });
}

nb::object finished(const BoundEpisodeBank& bound) {
    static const Fresh fresh("bool");
    return fresh.operator()<bool>(bound.bank.num(),
                                  [&](std::size_t lane) { return bound.bank.finished(lane); });
}

nb::object verdicts(const BoundEpisodeBank& bound) {
    static const Fresh fresh("int8");
    const double* lower = bound.bank.lower();
    const double* upper = bound.bank.upper();
    return fresh.operator()<std::int8_t>(bound.bank.num(), [=](std::size_t lane) {
        return static_cast<std::int8_t>((lower[lane] > 0.0) - (upper[lane] < 0.0));
    });
}

template <class B>
nb::object samples(const BoundBank<B>& bound) {
    static const Fresh fresh("int64");
    return fresh.template operator()<std::int64_t>(
        bound.bank.num(), [&](std::size_t lane) { return bound.bank.samples(lane); });
}

template <class B>
nb::object inputs(const BoundBank<B>& bound) {
    const std::size_t num = bound.bank.num();
    const std::size_t width = bound.bank.variables();
    return doubles(bound.bank.inputs(), num * width).attr("reshape")(num, width);
}

template <class B>
void require(const BoundBank<B>& bound, const bool* mask, bool (*allowed)(const B&, std::size_t),
             const char* refuse) {
    for (std::size_t lane = 0; lane < bound.bank.num(); ++lane) {
        if ((mask != nullptr && !mask[lane]) || allowed(bound.bank, lane)) continue;
        bound.reader.attr(refuse)(lane);
        throw std::runtime_error("the reader did not refuse the call");
    }
}

template <class B>
nb::object update(BoundBank<B>& bound, nb::handle values, nb::handle mask) {
    B& bank = bound.bank;
    const std::size_t width = bank.variables();
    const nb::object plain = table_of(bound, values).array();
    const Held<bool> chosen = mask_of(bound, mask);
    const Held<double> table = table_of(bound, plain);  // after the last code of the caller's
    if constexpr (requires { bank.finished(0); })
        require<B>(
            bound, chosen.data(), [](const B& b, std::size_t lane) { return !b.finished(lane); },
            "refuse_update");
    if (bank.take(table.data(), chosen.data()) < bank.num()) {
        const nb::object policy = bound.reader.attr("without_nan");
        const nb::object filled = policy(plain, chosen.array(), samples(bound), inputs(bound));
        const Held<double> held = table_of(bound, filled);
        const std::size_t lane = bank.take(held.data(), chosen.data());
        if (lane < bank.num()) {
            const nb::list sample = list_of(held.data() + lane * width, width);
            bound.reader.attr("refuse")(sample, bank.samples(lane), lane);
            throw std::runtime_error("the reader did not refuse a term that is nan");
        }
    }
    return doubles(bank.results(), bank.num());
}

template <class B>
void reset_bank(BoundBank<B>& bound, nb::handle mask) {
    bound.bank.reset(mask_of(bound, mask).data());
}

nb::object finish(BoundEpisodeBank& bound, nb::handle mask) {
    const Held<bool> chosen = mask_of(bound, mask);
    require<EpisodeBank>(
        bound, chosen.data(),
        [](const EpisodeBank& bank, std::size_t lane) { return bank.samples(lane) > 0; },
        "refuse_finish");
    bound.bank.finish(chosen.data());
    return doubles(bound.bank.results(), bound.bank.num());
}

template <class B>
nb::bytes bank_state(const BoundBank<B>& bound) {
    const std::string bytes = bound.bank.state();
    return nb::bytes(bytes.data(), bytes.size());
}

template <class B>
void restore_bank(BoundBank<B>& bound, nb::handle state) {
    if (!PyBytes_Check(state.ptr())) throw nb::value_error(B::kForeign);
    const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(state.ptr()));
    bound.bank.restore({PyBytes_AS_STRING(state.ptr()), size});
}

template <class B>
int traverse_bank(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (nb::inst_ready(self)) Py_VISIT(nb::inst_ptr<BoundBank<B>>(self)->reader.ptr());
    return 0;
}

template <class B>
int clear_bank(PyObject* self) {
    if (nb::inst_ready(self)) nb::inst_ptr<BoundBank<B>>(self)->reader = nb::none();
    return 0;
}

template <class B>
PyType_Slot bank_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_bank<B>)},
    {Py_tp_clear, reinterpret_cast<void*>(clear_bank<B>)},
    {0, nullptr},
};

// What both banks have.
template <class B>
nb::class_<BoundBank<B>> bind(nb::module_& m, const char* name, const char* doc) {
    return nb::class_<BoundBank<B>>(m, name, nb::type_slots(bank_slots<B>), doc)
        .def_prop_ro("samples", samples<B>, "Samples taken in by every lane since its reset.")
        .def_prop_ro("inputs", inputs<B>, "The last sample of every lane, 0 before the first.")
        .def("update", update<B>, nb::arg("values"), nb::arg("mask").none() = nb::none(),
             "Take in a sample in every lane that the mask chooses; the result of every lane.")
        .def("reset", reset_bank<B>, nb::arg("mask").none() = nb::none(),
             "Forget every sample of the lanes that the mask chooses.")
        .def("state", bank_state<B>, "Values one behind the other, with a mark of the program.")
        .def("restore", restore_bank<B>, nb::arg("state").none(),
             "Continue from where the state was taken.\n\n"
             "Raises:\n"
             "    ValueError: If another program's bank gave it (then nothing changes), or it is\n"
             "        damaged (then all lanes are reset).");
}

void construct_bank(BoundDiscreteBank* self, const nb::sequence& rows, std::size_t terms,
                    const nb::tuple& variables, std::size_t result, std::int64_t latency,
                    std::size_t num, nb::object reader) {
    new (self) BoundDiscreteBank{{rows_of(rows), terms, nb::len(variables), {result, latency}, num},
                             std::move(reader)};
}

void construct_episodes(BoundEpisodeBank* self, const nb::sequence& terms,
                        const nb::sequence& formulas, const nb::sequence& tops,
                        const nb::sequence& streams, const nb::tuple& variables, std::size_t num,
                        nb::object reader) {
    new (self) BoundEpisodeBank{{rows_of(terms), nb::len(variables), formulas_of(formulas),
                              registers_of(tops), registers_of(streams), num},
                             std::move(reader)};
}

}  // namespace

void bind_banks(nb::module_& m) {
    bind<DiscreteBank>(m, "DiscreteBank",
               "Runs a program on samples of many lanes, as rtamt.machines.protocols.DiscreteBank says.\n\n"
               "Args:\n"
               "    rows: The program, as rtamt.program.schedule.encoded writes it.\n"
               "    terms: How many of its instructions are arithmetic over the sample.\n"
               "    variables: Names of the inputs.\n"
               "    result: Register of what update gives.\n"
               "    latency: Samples by which it is late.\n"
               "    num: How many lanes.\n"
               "    reader: Reads the arrays that are rare, and makes all messages.")
        .def("__init__", construct_bank, nb::arg("rows"), nb::arg("terms"), nb::arg("variables"),
             nb::arg("result"), nb::arg("latency"), nb::arg("num"), nb::arg("reader"));

    bind<EpisodeBank>(m, "EpisodeBank",
                      "Bounds the robustness of many episodes, as rtamt.machines.protocols.EpisodeBank says.\n\n"
                      "Args:\n"
                      "    terms, formulas, tops, streams, variables: As for EpisodeMachine.\n"
                      "    num: How many lanes.\n"
                      "    reader: Reads the arrays that are rare, and makes all messages.")
        .def("__init__", construct_episodes, nb::arg("terms"), nb::arg("formulas"),
             nb::arg("tops"), nb::arg("streams"), nb::arg("variables"), nb::arg("num"),
             nb::arg("reader"))
        .def_prop_ro("robustness",
                     [](const BoundEpisodeBank& b) { return doubles(b.bank.results(), b.bank.num()); },
                     "Robustness if the episodes ended now.")
        .def_prop_ro("lower",
                     [](const BoundEpisodeBank& b) {
                         return doubles(b.bank.lower(), b.bank.num());
                     },
                     "The least over all continuations.")
        .def_prop_ro("upper",
                     [](const BoundEpisodeBank& b) {
                         return doubles(b.bank.upper(), b.bank.num());
                     },
                     "The greatest over all continuations.")
        .def_prop_ro("verdict", verdicts, "1 where lower is above 0, -1 where upper is below.")
        .def_prop_ro("finished", finished, "Whether the traces have ended.")
        .def("finish", finish, nb::arg("mask").none() = nb::none(),
             "End the traces of the lanes that the mask chooses; the robustness of every lane.");
}

}  // namespace rtamt
