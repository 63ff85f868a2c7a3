// The episode machine, and monitor sets of several that take in the same samples, as Python
// classes.
#include <nanobind/nanobind.h>
#include <structmember.h>

#include <array>
#include <cstring>
#include <deque>
#include <limits>
#include <utility>
#include <vector>

#include "core/order.hpp"
#include "episode/variants.hpp"
#include "python/encoding.hpp"
#include "python/samples.hpp"

namespace rtamt {

namespace nb = nanobind;

// A slot of a Python class, by the descriptor that reads and writes it.
inline const PyMemberDef& slot_of(nb::handle descriptor) {
    if (!PyObject_TypeCheck(descriptor.ptr(), &PyMemberDescr_Type))
        throw nb::type_error("expected a slot of a class");
    const PyMemberDef& slot = *reinterpret_cast<PyMemberDescrObject*>(descriptor.ptr())->d_member;
    if (slot.type != T_OBJECT_EX || slot.flags & READONLY)
        throw nb::type_error("expected a slot that can be written");
    return slot;
}

// A descriptor that reads a slot of a class, and does not write it.
inline nb::object read_only(nb::handle descriptor) {
    static std::deque<PyMemberDef> made;  // a descriptor refers to its definition for ever
    made.push_back(slot_of(descriptor));
    made.back().flags |= READONLY;
    nb::object reader = nb::steal(PyDescr_NewMember(PyDescr_TYPE(descriptor.ptr()), &made.back()));
    if (!reader.is_valid()) nb::raise_python_error();
    return reader;
}

// Keeps the attributes robustness, lower, upper and verdict of a monitor up to date while the
// monitor lives: Python reads a slot without a call. The machine may outlive the monitor, so the
// reference to it is weak.
class Readout {
public:
    // Takes the slots of the monitor's class, and the verdicts violated, undecided and satisfied.
    template <class M>
    void attach(const M& machine, nb::handle monitor, const nb::sequence& slots,
                const nb::sequence& verdicts) {
        Readout made;
        if (nb::len(slots) != made.places_.size() || nb::len(verdicts) != made.verdicts_.size())
            throw nb::value_error("expected 4 slots and 3 verdicts");
        for (std::size_t i = 0; i < made.places_.size(); ++i) {
            const nb::object slot = slots[i];
            made.places_[i] = slot_of(slot).offset;
            if (!PyObject_TypeCheck(monitor.ptr(), PyDescr_TYPE(slot.ptr())))
                throw nb::type_error("expected slots of the monitor's class");
        }
        for (std::size_t i = 0; i < made.verdicts_.size(); ++i) made.verdicts_[i] = verdicts[i];
        made.monitor_ = nb::steal(PyWeakref_NewRef(monitor.ptr(), nullptr));
        if (!made.monitor_.is_valid()) nb::raise_python_error();
        const std::array<double, 3> numbers = numbers_of(machine);
        for (std::size_t i = 0; i < numbers.size(); ++i)
            if (!made.write(monitor.ptr(), i, numbers[i])) nb::raise_python_error();
        made.write_verdict(monitor.ptr(), machine);
        *this = std::move(made);
    }

    // Writes what has changed. Returns a new reference to the robustness, or null with an error.
    template <class M>
    PyObject* show(const M& machine) {
        PyObject* const monitor =
            monitor_.is_valid() ? PyWeakref_GET_OBJECT(monitor_.ptr()) : Py_None;
        if (monitor == Py_None) [[unlikely]]
            return PyFloat_FromDouble(machine.result());
        const std::array<double, 3> numbers = numbers_of(machine);
        if (std::memcmp(&shown_, &numbers, sizeof numbers) != 0) {
            for (std::size_t i = 0; i < numbers.size(); ++i)
                if (!is_shown(i, numbers[i]) && !write(monitor, i, numbers[i])) return nullptr;
            write_verdict(monitor, machine);
        }
        return Py_NewRef(at(monitor, 0));
    }

private:
    // The numbers in the order of their slots.
    template <class M>
    static std::array<double, 3> numbers_of(const M& machine) {
        return {machine.result(), machine.lower(), machine.upper()};
    }
    PyObject*& at(PyObject* monitor, std::size_t i) const {
        return *reinterpret_cast<PyObject**>(reinterpret_cast<char*>(monitor) + places_[i]);
    }
    // Whether a slot has a number, bit for bit.
    bool is_shown(std::size_t i, double number) const {
        return std::memcmp(&shown_[i], &number, sizeof number) == 0;
    }
    bool write(PyObject* monitor, std::size_t i, double number) {
        PyObject* const made = PyFloat_FromDouble(number);
        if (made == nullptr) return false;
        Py_XSETREF(at(monitor, i), made);
        shown_[i] = number;
        return true;
    }
    template <class M>
    void write_verdict(PyObject* monitor, const M& machine) {
        const nb::object& verdict = verdicts_[static_cast<std::size_t>(1 + machine.verdict())];
        Py_XSETREF(at(monitor, places_.size() - 1), Py_NewRef(verdict.ptr()));
    }

    nb::object monitor_;  // a weak reference; null: there is none
    std::array<Py_ssize_t, 4> places_{};
    std::array<nb::object, 3> verdicts_;
    std::array<double, 3> shown_{};
};

namespace {

struct EpisodeObject : NamedObject<EpisodeVariants> {
    Readout readout;
    bool nan_is_unknown = false;  // as the reader has it
};

void construct(EpisodeObject* self, const nb::sequence& terms, const nb::sequence& formulas,
               const nb::sequence& initial, const nb::sequence& streams, const nb::tuple& variables,
               nb::object reader, const nb::sequence& neutral) {
    const nb::object policy = nb::getattr(reader, "nan", nb::none());
    const bool nan_is_unknown = policy.equal(nb::str("unknown"));
    Arguments names(variables);
    new (self) EpisodeObject{
        {{EpisodeVariants({discrete_rows(terms), nb::len(variables), formula_rows(formulas),
                           registers_of(initial), registers_of(streams)},
                          registers_of(neutral)),
          std::move(reader)},
         std::move(names)},
        {},
        nan_is_unknown};
}

// Judges a whole trace from a reset on, without a sample that is refused: None if there is one.
nb::object judge(EpisodeObject& object, const nb::sequence& columns, std::size_t n,
                 const std::string& end) {
    require_idle(object);
    const End reading = end_of(end);
    EpisodeVariants& machine = object.machine;
    const Arrays arrays(machine.variables(), 0, columns, n);
    require_idle(object);
    if (n == 0) throw nb::value_error("expected a sample, got none");
    machine.reset();
    nb::object decided = nb::none();
    for (std::size_t i = 0; i < n; ++i) {
        double* pending = machine.pending();
        for (std::size_t k = 0; k < machine.variables(); ++k) pending[k] = arrays.sources()[k][i];
        if (!machine.take()) return nb::none();
        if (decided.is_none() && machine.verdict() != 0) decided = nb::int_(i);
    }
    const double complete = machine.result();
    machine.finish(reading);
    return nb::make_tuple(machine.result(), complete, machine.lower(), machine.upper(), decided);
}

double finish(EpisodeObject& object, const std::string& end) {
    require_idle(object);
    const End reading = end_of(end);
    if (object.machine.samples() == 0) refuse_state("refuse_finish");
    object.machine.finish(reading);
    refresh(object);
    return object.machine.result();
}

void show_in(EpisodeObject& object, nb::handle monitor, const nb::sequence& slots,
             const nb::sequence& verdicts) {
    object.readout.attach(object.machine, monitor, slots, verdicts);
}

// The number that a function of the machine gives.
template <auto number>
double get(const EpisodeObject& object) {
    return (object.machine.*number)();
}

PyMethodDef methods[] = {sample_update<EpisodeObject>(), {nullptr, nullptr, 0, nullptr}};

namespace monitor_set {

// How a number of a sample is read.
struct Source {
    enum class Kind { element, held, called };
    Kind kind;
    nb::object what;        // the key of an element, the array that holds the number, or a function
    Py_ssize_t index = -1;  // of an element or in the array; -1: the key is none
};

struct Part {
    nb::object owner;  // holds the machine
    EpisodeObject* object;
    std::vector<std::size_t> places;  // of its variables in a sample
};

struct EpisodeMonitorSet {
    std::vector<Part> parts;
    std::vector<Source> sources;
    nb::object decided;
    nb::object seen;
    nb::object number;
    std::vector<double> sample;
    bool feeding = false;
    const Numpy& numpy = Numpy::instance();
};

Source source_of(nb::handle given) {
    // A tuple of anything else is a key, of an array of several dimensions.
    if (PyTuple_CheckExact(given.ptr()) && PyTuple_GET_SIZE(given.ptr()) == 2 &&
        Numpy::instance().is_array(PyTuple_GET_ITEM(given.ptr(), 0))) {
        const nb::tuple pair = nb::borrow<nb::tuple>(given);
        const auto index = nb::cast<Py_ssize_t>(pair[1]);
        double number;
        // The array beneath is held, never a view of it: Python before 3.11.8 crashes when its
        // collector clears a memoryview that something else still reads.
        if (!Numpy::instance().element(nb::object(pair[0]).ptr(), index, number))
            throw nb::value_error("expected an element of an array of float64 or float32");
        return {Source::Kind::held, pair[0], index};
    }
    const nb::object what = nb::borrow(given);
    if (PyCallable_Check(given.ptr())) return {Source::Kind::called, what};
    Source element{Source::Kind::element, what};
    if (PyLong_CheckExact(given.ptr())) element.index = nb::cast<Py_ssize_t>(given);
    return element;
}

void construct(EpisodeMonitorSet* self, const nb::sequence& machines, const nb::sequence& places,
               const nb::sequence& reads, nb::object decided, nb::object seen,
               nb::type_object number) {
    EpisodeMonitorSet made;
    for (nb::handle read : reads) made.sources.push_back(source_of(read));
    made.sample.resize(made.sources.size());
    if (nb::len(machines) != nb::len(places))
        throw nb::value_error("expected the places of the variables of each machine");
    for (std::size_t i = 0; i < nb::len(machines); ++i) {
        Part part{machines[i], nullptr, {}};
        part.object = &nb::cast<EpisodeObject&>(part.owner);
        for (nb::handle place : nb::sequence(places[i]))
            part.places.push_back(nb::cast<std::size_t>(place));
        if (part.places.size() != part.object->machine.variables())
            throw nb::value_error("expected a place for each variable of a machine");
        for (std::size_t place : part.places)
            if (place >= made.sources.size()) throw nb::value_error("expected places in a sample");
        made.parts.push_back(std::move(part));
    }
    if (!made.numpy.makes(reinterpret_cast<PyTypeObject*>(number.ptr())))
        throw nb::type_error("expected float or numpy.float64");
    made.decided = std::move(decided);
    made.seen = std::move(seen);
    made.number = std::move(number);
    new (self) EpisodeMonitorSet(std::move(made));
}

// What float() makes of an object that a caller has given.
double float_of(const nb::object& given) {
    if (!given.is_valid()) nb::raise_python_error();
    double number;
    if (Numpy::instance().number(given.ptr(), number)) return number;
    const nb::object made = nb::steal(PyNumber_Float(given.ptr()));
    if (!made.is_valid()) nb::raise_python_error();
    return PyFloat_AS_DOUBLE(made.ptr());
}

double read(const EpisodeMonitorSet& monitor_set, const Source& source, PyObject* const* args,
            Py_ssize_t n) {
    double number;
    switch (source.kind) {
        case Source::Kind::element:
            if (n == 0) throw std::runtime_error("expected what elements are read from");
            if (monitor_set.numpy.element(args[0], source.index, number)) [[likely]]
                return number;
            return float_of(nb::steal(PyObject_GetItem(args[0], source.what.ptr())));
        case Source::Kind::held:
            if (monitor_set.numpy.element(source.what.ptr(), source.index, number)) [[likely]]
                return number;
            throw std::runtime_error("an array has lost the element that is read");
        default:
            const auto count = static_cast<std::size_t>(n);
            return float_of(
                nb::steal(PyObject_Vectorcall(source.what.ptr(), args, count, nullptr)));
    }
}

// Has a machine take in the numbers of a sample that it reads.
void feed(Part& part, const double* sample) {
    EpisodeObject& object = *part.object;
    require_open(object);
    double* pending = object.machine.pending();
    for (std::size_t place : part.places) *pending++ = sample[place];
    if (!object.machine.take()) [[unlikely]] {
        nb::list values;  // what update() would be called with
        for (std::size_t place : part.places) values.append(nb::float_(sample[place]));
        const nb::tuple args(values);
        const auto n = static_cast<Py_ssize_t>(nb::len(args));
        take_pending(object, PySequence_Fast_ITEMS(args.ptr()), n, nullptr);
    }
    if (!nb::steal(result_of(object)).is_valid()) nb::raise_python_error();
}

struct Numbers {
    double robustness = std::numeric_limits<double>::infinity();
    double lower = robustness;
    double upper = robustness;
    std::int64_t decided = 0;
};

Numbers least(const EpisodeMonitorSet& monitor_set) {
    Numbers found;
    for (const Part& part : monitor_set.parts) {
        const EpisodeVariants& machine = part.object->machine;
        found.robustness = alone::lesser(found.robustness, machine.result());
        found.lower = alone::lesser(found.lower, machine.lower());
        found.upper = alone::lesser(found.upper, machine.upper());
        found.decided += machine.verdict() != 0;
    }
    return found;
}

PyObject* shown(const EpisodeMonitorSet& monitor_set, const Numbers& found) {
    auto* type = reinterpret_cast<PyTypeObject*>(monitor_set.number.ptr());
    PyObject* made = PyTuple_New(3);
    if (made == nullptr) return nullptr;
    const double numbers[] = {found.robustness, found.lower, found.upper};
    for (Py_ssize_t i = 0; i < 3; ++i) {
        PyObject* number = Numpy::number_of(type, numbers[i]);
        if (number == nullptr) {
            Py_DECREF(made);
            return nullptr;
        }
        PyTuple_SET_ITEM(made, i, number);
    }
    return made;
}

// Reads a sample, and has all machines take it in.
Numbers take(EpisodeMonitorSet& monitor_set, PyObject* const* args, Py_ssize_t n) {
    if (monitor_set.feeding)
        refuse(nb::module_::import_("rtamt.machines.native"), "refuse_running");
    const WhileSet feeding(monitor_set.feeding);
    for (std::size_t i = 0; i < monitor_set.sources.size(); ++i)
        monitor_set.sample[i] = read(monitor_set, monitor_set.sources[i], args, n);
    for (Part& part : monitor_set.parts) feed(part, monitor_set.sample.data());
    const Numbers found = least(monitor_set);
    if (found.decided != 0 && !monitor_set.decided.is_none()) monitor_set.decided(found.decided);
    if (!monitor_set.seen.is_none())
        monitor_set.seen(list_of(monitor_set.sample.data(), monitor_set.sample.size()));
    return found;
}

PyObject* feed_all(PyObject* self, PyObject* const* args, Py_ssize_t n) {
    return call<EpisodeMonitorSet>(self, [=](EpisodeMonitorSet& monitor_set) {
        return shown(monitor_set, take(monitor_set, args, n));
    });
}

PyObject* take_all(PyObject* self, PyObject* const* args, Py_ssize_t n) {
    return call<EpisodeMonitorSet>(self, [=](EpisodeMonitorSet& monitor_set) {
        take(monitor_set, args, n);
        return Py_NewRef(Py_None);
    });
}

PyObject* look(PyObject* self, PyObject*) {
    return call<EpisodeMonitorSet>(self, [](EpisodeMonitorSet& monitor_set) {
        return shown(monitor_set, least(monitor_set));
    });
}

int traverse_monitor_set(PyObject* self, visitproc visit, void* arg) {
    Py_VISIT(Py_TYPE(self));
    if (!nb::inst_ready(self)) return 0;
    const EpisodeMonitorSet& monitor_set = *nb::inst_ptr<EpisodeMonitorSet>(self);
    for (const Part& part : monitor_set.parts) Py_VISIT(part.owner.ptr());
    for (const Source& source : monitor_set.sources) Py_VISIT(source.what.ptr());
    Py_VISIT(monitor_set.decided.ptr());
    Py_VISIT(monitor_set.seen.ptr());
    return 0;
}

int clear_monitor_set(PyObject* self) {
    if (!nb::inst_ready(self)) return 0;
    EpisodeMonitorSet& monitor_set = *nb::inst_ptr<EpisodeMonitorSet>(self);
    // Taken out first: what goes may run code that looks at the monitor set.
    const auto parts = std::exchange(monitor_set.parts, {});
    const auto sources = std::exchange(monitor_set.sources, {});
    const nb::object decided = std::exchange(monitor_set.decided, nb::none());
    const nb::object seen = std::exchange(monitor_set.seen, nb::none());
    return 0;
}

PyMethodDef methods[] = {
    {"feed", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(feed_all)), METH_FASTCALL,
     "feed($self, /, *args)\n--\n\n"
     "Read a sample, have all machines take it in, and return the least robustness and bounds."},
    {"take", reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(take_all)), METH_FASTCALL,
     "take($self, /, *args)\n--\n\nAs feed, but return None: the numbers are made for look."},
    {"look", look, METH_NOARGS,
     "look($self, /)\n--\n\nReturn the least robustness and bounds of the samples so far."},
    {nullptr, nullptr, 0, nullptr}};

}  // namespace monitor_set

}  // namespace

void bind_episode(nb::module_& m) {
    sample_class<EpisodeObject>(
        m, "EpisodeMachine",
        "Bounds the robustness of an episode, as rtamt.machines.protocols.EpisodeMachine says.",
        methods)
        .def("__init__", construct, "terms"_a, "formulas"_a, "initial"_a, "streams"_a,
             "variables"_a, "reader"_a, "neutral"_a = nb::tuple())
        .def_prop_ro("robustness", get<&EpisodeVariants::result>)
        .def_prop_ro("lower", get<&EpisodeVariants::lower>)
        .def_prop_ro("upper", get<&EpisodeVariants::upper>)
        .def_prop_ro("finished", [](const EpisodeObject& o) { return o.machine.finished(); })
        .def("judge", judge, "columns"_a, "n"_a, "end"_a)
        .def("finish", finish, "end"_a = "complete")
        .def("show_in", show_in, "monitor"_a, "slots"_a, "verdicts"_a);
    m.def("read_only", read_only, "slot"_a,
          "Return a descriptor that reads a slot of a class, and does not write it.");
    PyType_Slot slots[] = {
        {Py_tp_traverse, reinterpret_cast<void*>(monitor_set::traverse_monitor_set)},
        {Py_tp_clear, reinterpret_cast<void*>(monitor_set::clear_monitor_set)},
        {Py_tp_methods, monitor_set::methods},
        {0, nullptr}};
    nb::class_<monitor_set::EpisodeMonitorSet>(
        m, "EpisodeMonitorSet", nb::type_slots(slots),
        "Has several episode machines take in the same samples.\n\n"
        "Args:\n"
        "    machines: The machines.\n"
        "    places: For each machine the places of its variables in a sample.\n"
        "    reads: What reads each number of a sample: an array and an index, a function of the\n"
        "        arguments of feed, or else the key of an element of the first of these.\n"
        "    decided: Called after a sample with the number of verdicts that are decided, unless\n"
        "        it is 0; or None.\n"
        "    seen: Called after that with the numbers of the sample; or None.\n"
        "    number: The class of the numbers that feed and look return: float or numpy.float64.")
        .def("__init__", monitor_set::construct, "machines"_a, "places"_a, "reads"_a,
             "decided"_a.none(), "seen"_a.none(), "number"_a);
}

}  // namespace rtamt
