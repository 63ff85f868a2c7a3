// Arrays of numpy, read in place or through the buffer protocol, and new ones.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "core/columns.hpp"

namespace rtamt {

namespace nb = nanobind;

// References that are never released, as their modules are never unloaded.
inline PyObject* permanent(nb::object object) { return object.release().ptr(); }
inline PyTypeObject* permanent_type(const char* module, const char* name) {
    return reinterpret_cast<PyTypeObject*>(permanent(nb::module_::import_(module).attr(name)));
}
inline PyObject* dtype(const char* name) {
    return permanent(nb::module_::import_("numpy").attr("dtype")(name));
}

// Calls numpy.empty or numpy.zeros with a shape and a dtype.
inline nb::object new_array(PyObject* function, const nb::object& shape, PyObject* dtype) {
    PyObject* arguments[] = {shape.ptr(), dtype};
    PyObject* made = PyObject_Vectorcall(function, arguments, 2, nullptr);
    if (made == nullptr) nb::raise_python_error();
    return nb::steal(made);
}

// Arrays of numpy, read in place. The buffer protocol costs three times the rest of an update, so
// this reads the fields of an array where numpy's ABI has had them since 1.0, after a trial on
// known arrays.
class Numpy {
public:
    static const Numpy& instance() {
        static const Numpy numpy;
        return numpy;
    }

    bool is_array(PyObject* object) const { return Py_TYPE(object) == array_; }
    bool is_float(PyObject* object) const {
        return Py_TYPE(object) == float64_ || Py_TYPE(object) == float32_;
    }

    // Reads the n numbers of a 1-D array of float64 or float32; false if it is another array.
    bool row(PyObject* array, Py_ssize_t n, double* out) const {
        return known_ && row_of(array, n, out);
    }

    // Reads an element of a 1-D array of float64 or float32; false if it is another object, or has
    // no such element.
    bool element(PyObject* array, Py_ssize_t i, double& out) const {
        if (!known_ || !is_array(array)) return false;
        const auto* fields = reinterpret_cast<const Fields*>(array);
        if (fields->ndim != 1 || i < 0 || i >= fields->shape[0]) return false;
        return number_at(fields, fields->data + i * fields->strides[0], out);
    }
    // Numbers of a class of Python that derives from float, such as numpy.float64, made as fast as
    // those of float itself.
    static PyObject* number_of(PyTypeObject* type, double value) {
        if (type == &PyFloat_Type) return PyFloat_FromDouble(value);
        PyObject* made = type->tp_alloc(type, 0);
        if (made != nullptr) reinterpret_cast<PyFloatObject*>(made)->ob_fval = value;
        return made;
    }
    // Whether `number_of` makes numbers of this class: it holds what float holds, and no more.
    bool makes(PyTypeObject* type) const {
        return type == &PyFloat_Type ||
               (type == float64_ && type->tp_basicsize == PyFloat_Type.tp_basicsize &&
                type->tp_itemsize == 0 && PyType_IsSubtype(type, &PyFloat_Type));
    }

    // The numbers of an aligned array of float64 of this shape, in any layout; no data if it is
    // another object.
    Table table(PyObject* array, Py_ssize_t rows, Py_ssize_t columns) const {
        std::size_t width = 0;
        const Table found = table(array, rows, width);
        return width == static_cast<std::size_t>(columns) ? found : Table{};
    }
    // The same of any number of columns, which is found.
    Table table(PyObject* array, Py_ssize_t rows, std::size_t& width) const {
        if (!known_ || !is_array(array)) return {};
        const auto* fields = reinterpret_cast<const Fields*>(array);
        if (fields->ndim != 2 || fields->dtype != doubles_ || fields->shape[0] != rows) return {};
        width = static_cast<std::size_t>(fields->shape[1]);
        constexpr auto kSize = static_cast<Py_ssize_t>(sizeof(double));
        const auto place = reinterpret_cast<std::uintptr_t>(fields->data);
        const auto aligned = [](auto bytes) {
            return bytes % decltype(bytes){alignof(double)} == 0;
        };
        if (!aligned(place) || !aligned(fields->strides[0]) || !aligned(fields->strides[1]))
            return {};
        return {reinterpret_cast<const double*>(fields->data), fields->strides[0] / kSize,
                fields->strides[1] / kSize};
    }

    // The numbers of an aligned array of float64 of shape (n,) or (n, columns), row by row, and n;
    // null if it is another object.
    const double* column(PyObject* array, Py_ssize_t& n) const { return rows(array, 1, 1, n); }
    const double* rows(PyObject* array, Py_ssize_t columns, Py_ssize_t& n) const {
        return rows(array, 2, columns, n);
    }

    // Reads a number whose conversion runs no code of a caller; false if it is another object.
    bool number(PyObject* object, double& out) const {
        if (PyFloat_CheckExact(object)) [[likely]] {
            out = PyFloat_AS_DOUBLE(object);
            return true;
        }
        return other_number(object, out);
    }

    // The numbers of a contiguous 1-D array of n float64; null if it is another object.
    const double* line(PyObject* array, std::size_t n) const { return line_of<double>(array, n); }

    // The elements of a new 1-D array; null if their place is not known.
    void* begin(PyObject* array) const {
        if (!known_) return nullptr;
        return const_cast<char*>(reinterpret_cast<const Fields*>(array)->data);
    }

    // The elements of a contiguous array of one or two dimensions with n elements of this type in
    // all; null if it is another object.
    template <class T>
    void* elements(PyObject* array, std::size_t n) const {
        if (!known_ || !is_array(array)) return nullptr;
        const auto* fields = reinterpret_cast<const Fields*>(array);
        if (fields->dtype != dtype_of(T{}) || fields->ndim < 1 || fields->ndim > 2) return nullptr;
        Py_ssize_t size = 1;
        for (int i = fields->ndim - 1; i >= 0; size *= fields->shape[i--])
            if (fields->shape[i] > 1 &&  // the stride of one element says nothing
                fields->strides[i] != size * static_cast<Py_ssize_t>(sizeof(T)))
                return nullptr;
        if (size != static_cast<Py_ssize_t>(n) ||
            reinterpret_cast<std::uintptr_t>(fields->data) % alignof(T) != 0)
            return nullptr;
        return const_cast<char*>(fields->data);
    }

    // The rows of a contiguous array of one or two dimensions.
    struct Rows {
        const char* data = nullptr;
        PyObject* dtype = nullptr;
        std::size_t size = 0;  // bytes of an element
        std::size_t count = 0;
        bool single = false;  // of one dimension
    };

    // The rows of n elements, which are doubles, 64-bit integers, bools or objects; no data if it
    // is another object.
    Rows rows(PyObject* array, std::size_t n) const {
        if (!known_ || !is_array(array)) return {};
        const auto* fields = reinterpret_cast<const Fields*>(array);
        if (fields->ndim < 1 || fields->ndim > 2) return {};
        const bool single = fields->ndim == 1;
        Rows found{fields->data, fields->dtype, sizeof(double),
                   single ? 1 : static_cast<std::size_t>(fields->shape[0]), single};
        if (found.dtype == bools_)
            found.size = 1;
        else if (found.dtype != doubles_ && found.dtype != longs_ && found.dtype != objects_)
            return {};
        const auto size = static_cast<Py_ssize_t>(found.size);
        const auto width = static_cast<Py_ssize_t>(n);
        const int last = fields->ndim - 1;
        if (fields->shape[last] != width || (width > 1 && fields->strides[last] != size) ||
            (found.count > 1 && fields->strides[0] != width * size) ||
            reinterpret_cast<std::uintptr_t>(fields->data) % found.size != 0)
            return {};
        return found;
    }
    bool are_objects(const Rows& found) const { return found.dtype == objects_; }
    PyObject* bools() const { return bools_; }

    // The bytes of a contiguous 1-D array of n bools, which numpy lets be other than 0 and 1; null
    // if it is another object.
    const std::uint8_t* mask(PyObject* array, std::size_t n) const {
        return line_of<std::uint8_t>(array, n);
    }

private:
    Numpy();

    struct Fields {  // PyArrayObject_fields
        PyObject_HEAD const char* data;
        int ndim;
        const Py_ssize_t* shape;
        const Py_ssize_t* strides;
        PyObject* base;
        PyObject* dtype;
        int flags;
    };

    template <class T>
    const T* line_of(PyObject* array, std::size_t n) const {
        const auto* data = static_cast<const T*>(elements<T>(array, n));
        return data && reinterpret_cast<const Fields*>(array)->ndim == 1 ? data : nullptr;
    }
    const double* rows(PyObject* array, int dimensions, Py_ssize_t columns, Py_ssize_t& n) const {
        if (!known_ || !is_array(array)) return nullptr;
        const auto* fields = reinterpret_cast<const Fields*>(array);
        constexpr auto kSize = static_cast<Py_ssize_t>(sizeof(double));
        if (fields->ndim != dimensions || fields->dtype != doubles_ ||
            fields->strides[0] != columns * kSize ||
            (dimensions == 2 && (fields->shape[1] != columns || fields->strides[1] != kSize)) ||
            reinterpret_cast<std::uintptr_t>(fields->data) % alignof(double) != 0)
            return nullptr;
        n = fields->shape[0];
        return reinterpret_cast<const double*>(fields->data);
    }

    bool other_number(PyObject* object, double& out) const {
        if (!PyLong_CheckExact(object) && !is_float(object) && !PyBool_Check(object)) return false;
        out = PyFloat_AsDouble(object);
        if (out == -1.0 && PyErr_Occurred()) {  // an int that no double holds
            PyErr_Clear();
            return false;
        }
        return true;
    }

    bool number_at(const Fields* fields, const char* place, double& out) const {
        if (fields->dtype == doubles_) {
            std::memcpy(&out, place, sizeof out);
            return true;
        }
        if (fields->dtype != singles_) return false;
        float value;
        std::memcpy(&value, place, sizeof value);
        out = value;
        return true;
    }

    PyObject* dtype_of(double) const { return doubles_; }
    PyObject* dtype_of(std::int64_t) const { return longs_; }
    PyObject* dtype_of(std::uint8_t) const { return bools_; }

    bool row_of(PyObject* array, Py_ssize_t n, double* out) const {
        const auto* fields = reinterpret_cast<const Fields*>(array);
        if (fields->ndim != 1 || fields->shape[0] != n) return false;
        const char* place = fields->data;
        const Py_ssize_t stride = fields->strides[0];
        if (fields->dtype == doubles_) {
            for (Py_ssize_t i = 0; i < n; ++i, place += stride)
                std::memcpy(out + i, place, sizeof(double));
            return true;
        }
        if (fields->dtype == singles_) {
            for (Py_ssize_t i = 0; i < n; ++i, place += stride) {
                float value;
                std::memcpy(&value, place, sizeof value);
                out[i] = value;
            }
            return true;
        }
        return false;  // Python converts integers and other byte orders
    }

    PyTypeObject* array_ = permanent_type("numpy", "ndarray");
    PyTypeObject* float64_ = permanent_type("numpy", "float64");
    PyTypeObject* float32_ = permanent_type("numpy", "float32");
    PyObject* doubles_ = dtype("float64");
    PyObject* singles_ = dtype("float32");
    PyObject* bools_ = dtype("bool");
    PyObject* longs_ = dtype("int64");
    PyObject* objects_ = dtype("object");
    bool known_ = false;
};

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
        nb::object array = new_array(empty_, nb::int_(n), dtype_);
        elements = static_cast<T*>(Numpy::instance().begin(array.ptr()));
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
    Arrays(std::size_t variables, std::size_t observed, const nb::sequence& columns, std::size_t n);

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
