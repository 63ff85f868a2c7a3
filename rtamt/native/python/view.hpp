// Arrays through the buffer protocol, for what is not read at once.
#pragma once

#include <nanobind/nanobind.h>

#include <utility>

namespace rtamt {

namespace nb = nanobind;

// A 1-D array of n elements, one behind the other, whose memory stays where it is.
class View {
public:
    View(nb::object array, std::size_t n, int flags) : array_(std::move(array)) {
        if (PyObject_GetBuffer(array_.ptr(), &view_, flags) != 0) nb::raise_python_error();
        if (view_.ndim != 1 || static_cast<std::size_t>(view_.shape[0]) != n) {
            PyBuffer_Release(&view_);
            throw nb::value_error("expected 1-D columns of n values");
        }
    }
    View(View&& other) noexcept : array_(std::move(other.array_)), view_(other.view_) {
        other.view_.obj = nullptr;  // of which PyBuffer_Release does nothing
    }
    ~View() { PyBuffer_Release(&view_); }

    template <class T>
    T* data() const {
        return static_cast<T*>(view_.buf);
    }
    const nb::object& array() const { return array_; }

private:
    nb::object array_;
    Py_buffer view_;
};

}  // namespace rtamt
