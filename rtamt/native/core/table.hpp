// Table: numbers in rows and columns, somewhere in memory.
#pragma once

#include <cstddef>

namespace rtamt {

struct Table {
    const double* data = nullptr;
    std::ptrdiff_t row = 0;  // from a number to the one below it
    std::ptrdiff_t column = 0;
    const std::size_t* picked = nullptr;  // the columns that are meant; null: the first ones

    // A column, whose numbers are `row` apart.
    const double* at(std::size_t index) const {
        const std::size_t place = picked == nullptr ? index : picked[index];
        return data + static_cast<std::ptrdiff_t>(place) * column;
    }
};

}  // namespace rtamt
