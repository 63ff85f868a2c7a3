// Functions of Python on whole columns: ranges of terms, folds of pairs, and judgements of many
// traces.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "discrete/machine.hpp"
#include "episode/traces.hpp"
#include "python/arrays.hpp"
#include "python/encoding.hpp"
#include "python/object.hpp"

namespace rtamt {
namespace {

nb::tuple term_ranges(const nb::sequence& rows, std::size_t variables, const nb::sequence& observed,
                      const nb::object& reader, const nb::sequence& lower,
                      const nb::sequence& upper, std::size_t n) {
    TermRanges ranges(discrete_rows(rows), variables);
    const std::vector<std::size_t> wanted = registers_of(observed);
    for (const std::size_t slot : wanted)
        if (slot >= ranges.terms()) throw nb::value_error("an observed register is no term");
    const Arrays low(variables, wanted.size(), lower, n);
    const Arrays high(variables, wanted.size(), upper, n);
    std::vector<double> least(variables);
    std::vector<double> greatest(variables);
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t v = 0; v < variables; ++v) {
            least[v] = low.sources()[v][i];
            greatest[v] = high.sources()[v][i];
        }
        if (!ranges.find(least.data(), greatest.data(), 1))
            refuse(reader, "refuse_between", list_of(least.data(), variables),
                   list_of(greatest.data(), variables), i);
        for (std::size_t k = 0; k < wanted.size(); ++k) {
            low.targets()[k][i] = ranges[wanted[k]].lower;
            high.targets()[k][i] = ranges[wanted[k]].upper;
        }
    }
    return nb::make_tuple(low.made(), high.made());
}

nb::object fold_pairs(const nb::object& held, const nb::object& reached, std::int64_t before,
                      bool is_max, bool backwards) {
    static const NewArray array("int64");
    const std::size_t n = nb::len(held);
    const auto contiguous = nb::module_::import_("numpy").attr("ascontiguousarray");
    const ArrayView first(contiguous(held, "int64"), n, PyBUF_ND);
    const ArrayView second(contiguous(reached, "int64"), n, PyBUF_ND);
    const auto* p = first.data<std::int64_t>();
    const auto* q = second.data<std::int64_t>();
    std::int64_t* out = nullptr;
    nb::object made = array.unfilled<std::int64_t>(n, out);
    const auto fold = [=](auto combine) {
        std::int64_t last = before;
        for (std::size_t k = 0; k < n; ++k) {
            const std::size_t i = backwards ? n - 1 - k : k;
            out[i] = last = combine(p[i], q[i], last);
        }
    };
    using Key = std::int64_t;
    if (is_max) {
        fold([](Key a, Key b, Key last) { return std::max(b, std::min(a, last)); });
    } else {
        fold([](Key a, Key b, Key last) { return std::min(b, std::max(a, last)); });
    }
    return made;
}

nb::tuple negative_runs(const nb::object& signs, const nb::object& values) {
    using Key = std::int64_t;
    static const NewArray array("int64");
    const std::size_t n = nb::len(signs);
    const auto contiguous = nb::module_::import_("numpy").attr("ascontiguousarray");
    const ArrayView first_view(contiguous(signs, "int64"), n, PyBUF_ND);
    const ArrayView second_view(contiguous(values, "int64"), n, PyBUF_ND);
    const auto* sign = first_view.data<Key>();
    const auto* value = second_view.data<Key>();
    std::size_t runs = n > 0 && sign[0] < 0;
    for (std::size_t i = 1; i < n; ++i) runs += (sign[i] < 0) & (sign[i - 1] >= 0);
    Key *first = nullptr, *after = nullptr, *least = nullptr, *place = nullptr;
    const nb::tuple made =
        nb::make_tuple(array.unfilled<Key>(runs, first), array.unfilled<Key>(runs, after),
                       array.unfilled<Key>(runs, least), array.unfilled<Key>(runs, place));
    std::size_t i = 0;
    for (std::size_t run = 0; run < runs; ++run) {
        while (sign[i] >= 0) ++i;
        std::size_t worst = i;
        first[run] = static_cast<Key>(i);
        for (++i; i < n && sign[i] < 0; ++i)
            if (value[i] < value[worst]) worst = i;
        after[run] = static_cast<Key>(i);
        least[run] = value[worst];
        place[run] = static_cast<Key>(worst);
    }
    return made;
}

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
                       std::size_t variables, const nb::sequence& columns, const nb::object& begins,
                       const nb::object& lengths, const std::string& end, std::size_t threads) {
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
                         std::size_t result, const nb::sequence& columns, const nb::object& begins,
                         const nb::object& lengths, const nb::object& class_of,
                         const nb::object& ends, const nb::object& first, const nb::object& last,
                         std::size_t threads) {
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

void bind_columns(nb::module_& m) {
    m.def("term_ranges", term_ranges, "rows"_a, "variables"_a, "observed"_a, "reader"_a, "lower"_a,
          "upper"_a, "n"_a,
          "Return the least and the greatest values of observed terms at n samples, as\n"
          "rtamt.machines.terms.term_ranges says.");
    m.def("fold_pairs", fold_pairs, "p"_a, "q"_a, "before"_a, "is_max"_a, "backwards"_a,
          "Return max(q, min(p, before)) of each pair, as rtamt.machines.walk.FoldPairs says.");
    m.def("negative_runs", negative_runs, "signs"_a, "values"_a,
          "Return the runs of negative integers, as rtamt.machines.segments.FindRuns says.");
    m.def("judge_traces", judge_traces, "terms"_a, "formulas"_a, "initial"_a, "streams"_a,
          "variables"_a, "columns"_a, "begins"_a, "lengths"_a, "end"_a, "threads"_a,
          "Judge each of many traces, as rtamt.machines.native.judge_traces says.");
    m.def("count_failures", count_failures, "rows"_a, "terms"_a, "variables"_a, "result"_a,
          "columns"_a, "begins"_a, "lengths"_a, "class_of"_a, "ends"_a, "first"_a, "last"_a,
          "threads"_a,
          "Count the samples at which a program fails, as rtamt.machines.native.count_failures\n"
          "says.");
}

}  // namespace rtamt
