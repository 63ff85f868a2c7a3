// Table: numbers in rows and columns, somewhere in memory.
#pragma once

#include <cstddef>

namespace rtamt {

struct Table {
    const double* data = nullptr;
    std::ptrdiff_t row = 0;  // from a number to the one below it
    std::ptrdiff_t column = 0;

    // A column, whose numbers are `row` apart.
    const double* at(std::size_t index) const {
        return data + static_cast<std::ptrdiff_t>(index) * column;
    }
};

}  // namespace rtamt
