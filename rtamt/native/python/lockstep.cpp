// The banks as Python classes. The definition is rtamt/machines/bank.py.
#include <nanobind/nanobind.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "lockstep/bank.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

using EpisodeObject = Object<EpisodeBank>;

// The samples of lanes, or a mask of lanes: an array and its elements.
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
    std::vector<ArrayView> view_;
    const T* data_;
};

template <class B>
Held<bool> mask_of(const Object<B>& object, nb::handle mask) {
    if (mask.is_none()) return {nb::none(), static_cast<const bool*>(nullptr)};
    const std::size_t num = object.machine.num();
    const bool* fast = Numpy::instance().mask(mask.ptr(), static_cast<Py_ssize_t>(num));
    if (fast != nullptr) return {nb::borrow(mask), fast};
    return {object.reader.attr("mask")(mask), num};
}

template <class B>
Held<double> table_of(const Object<B>& object, nb::handle values) {
    const std::size_t num = object.machine.num();
    const std::size_t width = object.machine.variables();
    const double* fast = Numpy::instance().table(values.ptr(), static_cast<Py_ssize_t>(num),
                                                 static_cast<Py_ssize_t>(width));
    if (fast != nullptr) return {nb::borrow(values), fast};
    return {object.reader.attr("values")(values), num * width};
}

nb::object finished(const EpisodeObject& object) {
    static const NewArray array("bool");
    return array.make<bool>(object.machine.num(),
                                  [&](std::size_t lane) { return object.machine.finished()[lane] != 0; });
}

nb::object verdicts(const EpisodeObject& object) {
    static const NewArray array("int8");
    const double* lower = object.machine.lower();
    const double* upper = object.machine.upper();
    return array.make<std::int8_t>(object.machine.num(), [=](std::size_t lane) {
        return static_cast<std::int8_t>(!negative(lower[lane]) - negative(upper[lane]));
    });
}

template <class B>
nb::object samples(const Object<B>& object) {
    static const NewArray array("int64");
    return array.template make<std::int64_t>(
        object.machine.num(), [&](std::size_t lane) { return object.machine.samples()[lane]; });
}

template <class B>
nb::object inputs(const Object<B>& object) {
    const std::size_t num = object.machine.num();
    const std::size_t width = object.machine.variables();
    return doubles(object.machine.inputs(), num * width).attr("reshape")(num, width);
}

// Has the reader refuse the first chosen lane that is not allowed.
template <class B, class Allowed>
void require(const Object<B>& object, const bool* mask, Allowed allowed, const char* call) {
    for (std::size_t lane = 0; lane < object.machine.num(); ++lane)
        if ((mask == nullptr || mask[lane]) && !allowed(lane)) refuse(object.reader, call, lane);
}

template <class B>
nb::object update(Object<B>& object, nb::handle values, nb::handle mask) {
    B& bank = object.machine;
    const std::size_t width = bank.variables();
    const nb::object plain = table_of(object, values).array();
    const Held<bool> chosen = mask_of(object, mask);
    const Held<double> table = table_of(object, plain);  // no code of the caller runs after this
    if constexpr (requires { bank.finished(); })
        require(
            object, chosen.data(), [&](std::size_t lane) { return !bank.finished()[lane]; },
            "refuse_update");
    if (bank.take(table.data(), chosen.data()) < bank.num()) {
        const nb::object policy = object.reader.attr("without_nan");
        const nb::object filled = policy(plain, chosen.array(), samples(object), inputs(object));
        const Held<double> held = table_of(object, filled);
        const std::size_t lane = bank.take(held.data(), chosen.data());
        if (lane < bank.num())
            refuse(object.reader, "refuse", list_of(held.data() + lane * width, width),
                   bank.samples()[lane], lane);
    }
    return doubles(bank.results(), bank.num());
}

template <class B>
void reset_lanes(Object<B>& object, nb::handle mask) {
    object.machine.reset(mask_of(object, mask).data());
}

nb::object finish(EpisodeObject& object, nb::handle mask) {
    EpisodeBank& bank = object.machine;
    const Held<bool> chosen = mask_of(object, mask);
    require(
        object, chosen.data(), [&](std::size_t lane) { return bank.samples()[lane] > 0; },
        "refuse_finish");
    bank.finish(chosen.data());
    return doubles(bank.results(), bank.num());
}

template <auto values>
nb::object of_lanes(const EpisodeObject& object) {
    return doubles((object.machine.*values)(), object.machine.num());
}

// Adds a class with what both banks have to a module.
template <class B>
nb::class_<Object<B>> bank_class(nb::module_& m, const char* name, const char* doc) {
    auto made = machine_class<Object<B>>(m, name, doc);
    made.def_prop_ro("samples", samples<B>, "The number of samples of every lane since its reset.")
        .def_prop_ro("inputs", inputs<B>, "The last sample of every lane; 0 before the first.")
        .def("update", update<B>, nb::arg("values"), nb::arg("mask").none() = nb::none(),
             "Take in a sample in each lane that the mask chooses; return the results of all.")
        .def("reset", reset_lanes<B>, nb::arg("mask").none() = nb::none(),
             "Return the lanes that the mask chooses to the state before their first sample.");
    return made;
}

void construct_discrete(Object<DiscreteBank>* self, const nb::sequence& rows, std::size_t terms,
                        const nb::tuple& variables, std::size_t result, std::int64_t latency,
                        std::size_t num, nb::object reader) {
    new (self) Object<DiscreteBank>{
        DiscreteBank(discrete_rows(rows), terms, nb::len(variables), {result, latency}, num),
        std::move(reader)};
}

void construct_episode(EpisodeObject* self, const nb::sequence& terms, const nb::sequence& formulas,
                       const nb::sequence& initial, const nb::sequence& streams,
                       const nb::tuple& variables, std::size_t num, nb::object reader) {
    new (self) EpisodeObject{
        EpisodeBank(discrete_rows(terms), nb::len(variables), formula_rows(formulas),
                    registers_of(initial), registers_of(streams), num),
        std::move(reader)};
}

}  // namespace

void bind_banks(nb::module_& m) {
    bank_class<DiscreteBank>(
        m, "DiscreteBank",
        "Runs a program in many lanes, as rtamt.machines.protocols.DiscreteBank says.\n\n"
        "Args:\n"
        "    rows: The program, as rtamt.program.encoding encodes it.\n"
        "    terms: The number of rows that are arithmetic over the sample.\n"
        "    variables: Names of the inputs.\n"
        "    result: Register that update returns.\n"
        "    latency: Samples by which the result is late.\n"
        "    num: The number of lanes.\n"
        "    reader: Reads the rare forms of arrays, and raises all errors.")
        .def("__init__", construct_discrete, nb::arg("rows"), nb::arg("terms"),
             nb::arg("variables"), nb::arg("result"), nb::arg("latency"), nb::arg("num"),
             nb::arg("reader"));

    bank_class<EpisodeBank>(
        m, "EpisodeBank",
        "Bounds the robustness of many episodes, as rtamt.machines.protocols.EpisodeBank says.\n\n"
        "Args:\n"
        "    terms, formulas, initial, streams, variables: The same as for EpisodeMachine.\n"
        "    num: The number of lanes.\n"
        "    reader: Reads the rare forms of arrays, and raises all errors.")
        .def("__init__", construct_episode, nb::arg("terms"), nb::arg("formulas"),
             nb::arg("initial"), nb::arg("streams"), nb::arg("variables"), nb::arg("num"),
             nb::arg("reader"))
        .def_prop_ro("robustness", of_lanes<&EpisodeBank::results>,
                     "The robustness if the episodes ended now.")
        .def_prop_ro("lower", of_lanes<&EpisodeBank::lower>,
                     "The least robustness over all continuations.")
        .def_prop_ro("upper", of_lanes<&EpisodeBank::upper>,
                     "The greatest robustness over all continuations.")
        .def_prop_ro("verdict", verdicts,
                     "1 if the sign bit of lower is clear, -1 if that of upper is set, else 0.")
        .def_prop_ro("finished", finished, "Whether the episodes have ended.")
        .def("finish", finish, nb::arg("mask").none() = nb::none(),
             "End the episodes that the mask chooses; return the robustness of all.");
}

}  // namespace rtamt
