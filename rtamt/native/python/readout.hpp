// The attributes of a monitor that show what its machine has found.
#pragma once

#include <nanobind/nanobind.h>
#include <structmember.h>

#include <array>
#include <cstring>
#include <deque>
#include <utility>

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
        if (monitor == Py_None) [[unlikely]] return PyFloat_FromDouble(machine.result());
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

}  // namespace rtamt
