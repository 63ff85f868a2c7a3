// Arrays through the buffer protocol, for what is not read in place, and new arrays.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "python/numpy.hpp"

namespace rtamt {

namespace nb = nanobind;

// A contiguous 1-D array of n elements, whose memory stays where it is while the view exists. An
// array of misaligned elements, which no processor need be able to read, is copied.
class ArrayView {
public:
    ArrayView(nb::object array, std::size_t n, int flags);
    ArrayView(ArrayView&& other) noexcept : array_(std::move(other.array_)), view_(other.view_) {
        other.view_.obj = nullptr;  // so that PyBuffer_Release does nothing
    }
    ~ArrayView() { PyBuffer_Release(&view_); }

    template <class T>
    T* data() const {
        return static_cast<T*>(view_.buf);
    }
    const nb::object& array() const { return array_; }

private:
    nb::object array_;
    Py_buffer view_;
};

// Makes 1-D arrays of one dtype.
class NewArray {
public:
    explicit NewArray(const char* dtype) : dtype_(rtamt::dtype(dtype)) {}

    // An array of value(0) to value(n - 1).
    template <class T, class Value>
    nb::object make(std::size_t n, Value value) const {
        T* elements = nullptr;
        nb::object array = unfilled<T>(n, elements);
        for (std::size_t i = 0; i < n; ++i) elements[i] = value(i);
        return array;
    }
    // An array, and where its elements are to be written while it exists.
    template <class T>
    nb::object unfilled(std::size_t n, T*& elements) const {
        const nb::int_ size(n);
        PyObject* arguments[] = {size.ptr(), dtype_};
        PyObject* made = PyObject_Vectorcall(empty_, arguments, 2, nullptr);
        if (made == nullptr) nb::raise_python_error();
        nb::object array = nb::steal(made);
        elements = static_cast<T*>(Numpy::instance().begin(made));
        if (elements == nullptr)
            elements = ArrayView(array, n, PyBUF_ND | PyBUF_WRITABLE).template data<T>();
        return array;
    }

private:
    PyObject* empty_ = permanent(nb::module_::import_("numpy").attr("empty"));
    PyObject* dtype_;
};

inline nb::object doubles(const double* values, std::size_t n) {
    static const NewArray array("float64");
    return array.make<double>(n, [values](std::size_t i) { return values[i]; });
}

// Calls over so many elements let other threads run.
inline constexpr std::size_t kWorthAThread = 10'000;

// The columns of a call, and new arrays for the observed registers.
class Arrays {
public:
    // For so many variables and so many observed registers.
    Arrays(std::size_t variables, std::size_t observed, const nb::sequence& columns,
           std::size_t n);

    const double* const* sources() const { return sources_.data(); }
    double* const* targets() const { return targets_.data(); }
    std::vector<double> sample(std::size_t i) const;
    nb::list made() const;

private:
    std::vector<ArrayView> in_;
    std::vector<nb::object> held_;  // columns that are read in place
    std::vector<ArrayView> out_;
    std::vector<const double*> sources_;
    std::vector<double*> targets_;
};

nb::list list_of(const double* values, std::size_t n);

}  // namespace rtamt
