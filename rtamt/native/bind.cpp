#include <nanobind/nanobind.h>

NB_MODULE(_native, m) { m.doc() = "The machines of rtamt in C++."; }
