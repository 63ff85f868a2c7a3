// The module rtamt._native: the machines, and the names that both languages must know.
#include <nanobind/nanobind.h>

#include "discrete/instruction.hpp"
#include "python/object.hpp"

NB_MODULE(_native, m) {
    using namespace rtamt;
    m.doc() = "The machines of rtamt in C++.";
    bind_discrete(m);
    bind_episode(m);
    bind_dense(m);
    bind_batches(m);
    bind_verdict_logs(m);
    bind_columns(m);

    nb::dict functions;
    nb::dict folds;
    nb::list kinds;
#define RTAMT_NAME(name, arity, value) functions[#name] = arity;
    RTAMT_FUNCTIONS(RTAMT_NAME)
#undef RTAMT_NAME
#define RTAMT_NAME(name, Type) folds[#name] = Type::width;
    RTAMT_FOLDS(RTAMT_NAME)
#undef RTAMT_NAME
#define RTAMT_NAME(name) kinds.append(#name);
    RTAMT_KINDS(RTAMT_NAME)
#undef RTAMT_NAME
    m.attr("FUNCTIONS") = functions;
    m.attr("FOLDS") = folds;
    m.attr("KINDS") = nb::tuple(kinds);
}
