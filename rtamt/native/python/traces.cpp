// Judgements of many traces as functions of Python.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "episode/traces.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"

namespace rtamt {
namespace {

// The traces of a call: views that stay while other threads of Python run.
class TraceViews {
public:
    TraceViews(std::size_t variables, const nb::sequence& columns, const nb::object& begins,
               const nb::object& lengths)
        : count_(nb::len(lengths)),
          begins_(begins, count_, PyBUF_ND),
          lengths_(lengths, count_, PyBUF_ND) {
        const std::size_t n = nb::len(columns) == 0 ? 0 : nb::len(nb::object(columns[0]));
        for (nb::handle column : columns) {
            views_.emplace_back(nb::borrow(column), n, PyBUF_ND);
            sources_.push_back(views_.back().data<double>());
        }
        if (sources_.size() != variables)
            throw nb::value_error("expected a column for every variable");
        const auto* begin = begins_.data<std::int64_t>();
        const auto* length = lengths_.data<std::int64_t>();
        const auto size = static_cast<std::int64_t>(n);
        for (std::size_t i = 0; i < count_; ++i)
            if (length[i] < 0 || begin[i] < 0 ||
                (variables > 0 && (begin[i] > size || length[i] > size - begin[i])))
                throw nb::value_error("expected traces inside the columns");
    }
    episode::Traces traces() const {
        return {sources_.data(), begins_.data<std::int64_t>(), lengths_.data<std::int64_t>(),
                count_};
    }

private:
    std::size_t count_;
    ArrayView begins_;
    ArrayView lengths_;
    std::vector<ArrayView> views_;
    std::vector<const double*> sources_;
};

nb::tuple judge_traces(const nb::sequence& terms, const nb::sequence& formulas,
                       const nb::sequence& initial, const nb::sequence& streams,
                       std::size_t variables, const nb::sequence& columns,
                       const nb::object& begins, const nb::object& lengths,
                       const std::string& end, std::size_t threads) {
    static const NewArray numbers("float64"), integers("int64"), flags("bool");
    const End mode = end_of(end);
    const episode::Program program{discrete_rows(terms), variables, formula_rows(formulas),
                                   registers_of(initial), registers_of(streams)};
    const TraceViews views(variables, columns, begins, lengths);
    const episode::Traces traces = views.traces();
    episode::Outcomes out{};
    const nb::object robustness = numbers.unfilled<double>(traces.count, out.robustness);
    const nb::object complete = numbers.unfilled<double>(traces.count, out.complete);
    const nb::object lower = numbers.unfilled<double>(traces.count, out.lower);
    const nb::object upper = numbers.unfilled<double>(traces.count, out.upper);
    const nb::object decided = integers.unfilled<std::int64_t>(traces.count, out.decided);
    const nb::object refused = flags.unfilled<bool>(traces.count, out.refused);
    {
        const nb::gil_scoped_release others;
        episode::judge(program, traces, mode, threads, out);
    }
    return nb::make_tuple(robustness, complete, lower, upper, decided, refused);
}

nb::tuple count_failures(const nb::sequence& rows, std::size_t terms, std::size_t variables,
                         std::size_t result, const nb::sequence& columns,
                         const nb::object& begins, const nb::object& lengths,
                         const nb::object& class_of, const nb::object& ends,
                         const nb::object& first, const nb::object& last, std::size_t threads) {
    static const NewArray integers("int64");
    const std::vector<DiscreteRow> encoded = discrete_rows(rows);
    const TraceViews views(variables, columns, begins, lengths);
    const episode::Traces traces = views.traces();
    const ArrayView classes(class_of, traces.count, PyBUF_ND);
    const ArrayView run_ends(ends, nb::len(ends), PyBUF_ND);
    const ArrayView firsts(first, nb::len(first), PyBUF_ND);
    const ArrayView lasts(last, nb::len(first), PyBUF_ND);
    const episode::Runs runs{run_ends.data<std::int64_t>(), firsts.data<std::int64_t>(),
                             lasts.data<std::int64_t>(), classes.data<std::int64_t>()};
    const auto known = static_cast<std::int64_t>(nb::len(ends)) - 1;
    for (std::size_t i = 0; i < traces.count; ++i)
        if (runs.class_of[i] < 0 || runs.class_of[i] >= known)
            throw nb::value_error("expected runs for each trace");
    for (std::int64_t c = 0; c < known; ++c)
        if (runs.ends[c] < 0 || runs.ends[c] > runs.ends[c + 1] ||
            runs.ends[c + 1] > static_cast<std::int64_t>(nb::len(first)))
            throw nb::value_error("expected runs in order");
    for (std::size_t i = 0; i < nb::len(first); ++i)
        if (runs.first[i] < 0) throw nb::value_error("expected runs of samples");
    episode::Failures out{};
    const nb::object samples = integers.unfilled<std::int64_t>(traces.count, out.samples);
    const nb::object starts = integers.unfilled<std::int64_t>(traces.count, out.starts);
    const nb::object earliest = integers.unfilled<std::int64_t>(traces.count, out.first);
    {
        const nb::gil_scoped_release others;
        episode::count_failures(encoded, terms, variables, result, traces, runs, threads, out);
    }
    return nb::make_tuple(samples, starts, earliest);
}

}  // namespace

void bind_traces(nb::module_& m) {
    m.def("judge_traces", judge_traces, nb::arg("terms"), nb::arg("formulas"), nb::arg("initial"),
          nb::arg("streams"), nb::arg("variables"), nb::arg("columns"), nb::arg("begins"),
          nb::arg("lengths"), nb::arg("end"), nb::arg("threads"),
          "Judge each of many traces, as rtamt.machines.native.judge_traces says.");
    m.def("count_failures", count_failures, nb::arg("rows"), nb::arg("terms"),
          nb::arg("variables"), nb::arg("result"), nb::arg("columns"), nb::arg("begins"),
          nb::arg("lengths"), nb::arg("class_of"), nb::arg("ends"), nb::arg("first"),
          nb::arg("last"), nb::arg("threads"),
          "Count the samples at which a program fails, as rtamt.machines.native.count_failures\n"
          "says.");
}

}  // namespace rtamt
