#include "python/arrays.hpp"

namespace rtamt {

Numpy::Numpy() {
    const auto numpy = nb::module_::import_("numpy");
    const auto size = nb::cast<std::size_t>(numpy.attr("ndarray").attr("__basicsize__"));
    if (size < sizeof(Fields)) return;
    const auto twice = nb::slice(nb::none(), nb::none(), nb::int_(-2));
    const nb::object row = numpy.attr("arange")(6.0)[twice];
    const nb::object thin = row.attr("astype")("float32");
    const auto is_5_3_1 = [&](const nb::object& array) {
        double values[3];
        return row_of(array.ptr(), 3, values) && values[0] == 5.0 && values[1] == 3.0 &&
               values[2] == 1.0 && !row_of(array.ptr(), 2, values);
    };
    known_ = is_5_3_1(row) && is_5_3_1(thin);
}

ArrayView::ArrayView(nb::object array, std::size_t n, int flags) : array_(std::move(array)) {
    if (PyObject_GetBuffer(array_.ptr(), &view_, flags) != 0) nb::raise_python_error();
    if (reinterpret_cast<std::uintptr_t>(view_.buf) % alignof(double) != 0 &&
        view_.itemsize == sizeof(double)) {
        PyBuffer_Release(&view_);
        array_ = array_.attr("copy")();
        if (PyObject_GetBuffer(array_.ptr(), &view_, flags) != 0) nb::raise_python_error();
    }
    if (view_.ndim != 1 || static_cast<std::size_t>(view_.shape[0]) != n) {
        PyBuffer_Release(&view_);
        throw nb::value_error("expected 1-D columns of n values");
    }
}

Arrays::Arrays(std::size_t variables, std::size_t observed, const nb::sequence& columns,
               std::size_t n) {
    // A view keeps others from resizing an array. None of them runs during short calls, unless a
    // column is converted.
    const Numpy& numpy = Numpy::instance();
    bool plain = n < kWorthAThread;
    for (nb::handle column : columns) plain = plain && numpy.line(column.ptr(), n) != nullptr;
    for (nb::handle column : columns) {
        if (plain) {
            held_.push_back(nb::borrow(column));
            sources_.push_back(numpy.line(column.ptr(), n));
        } else {
            const auto contiguous = nb::module_::import_("numpy").attr("ascontiguousarray");
            in_.emplace_back(contiguous(column, "float64"), n, PyBUF_ND);
            sources_.push_back(in_.back().data<double>());
        }
    }
    if (sources_.size() != variables) throw nb::value_error("expected a column for every variable");
    for (std::size_t i = 0; i < observed; ++i) {
        const nb::object array = nb::module_::import_("numpy").attr("empty")(n);
        out_.emplace_back(array, n, PyBUF_ND | PyBUF_WRITABLE);
        targets_.push_back(out_.back().data<double>());
    }
}

std::vector<double> Arrays::sample(std::size_t i) const {
    std::vector<double> values;
    for (const double* source : sources_) values.push_back(source[i]);
    return values;
}

nb::list Arrays::made() const {
    nb::list arrays;
    for (const ArrayView& view : out_) arrays.append(view.array());
    return arrays;
}

nb::list list_of(const double* values, std::size_t n) {
    nb::list list;
    for (std::size_t i = 0; i < n; ++i) list.append(values[i]);
    return list;
}

}  // namespace rtamt
