// Counts times in whole ticks, and gives the times of ticks, as rtamt/inputs/clock.py defines; what
// is rare is left to it.
#pragma once

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "dense/time.hpp"

namespace rtamt {

using dense::Time;

class Clock {
public:
    // There are `ticks` / `units` ticks in a unit of time, and `scale` is the nearest double. Zeros
    // in place of numbers that are too large leave to Python what doubles do not compute exactly.
    Clock(double scale, Time ticks, Time units) : scale_(scale), ticks_(ticks), units_(units) {
        Time power = 1;
        for (int digits = 0; digits <= kDigits; ++digits) {
            if (units == 1 && ticks == power) digits_ = digits;
            if (digits < kDigits) power *= 10;
        }
    }

    // Counts n times, every stride-th of these; false if there is one that Python should read.
    bool count(const double* given, std::size_t stride, std::size_t n, Time* out) const {
        Time unsure = 0;
        for (std::size_t i = 0; i < n; ++i) unsure |= quick(given[i * stride], out[i]);
        if (unsure == 0) return true;
        for (std::size_t i = 0; i < n; ++i)
            if (!count(given[i * stride], out[i])) return false;
        return true;
    }
    bool count(double time, Time& out) const {
        return quick(time, out) == 0 || rounded(time, out) || shortest(time, out);
    }

    // Counts by the product of doubles, which in the middle between two ticks takes either; false
    // if it is no count.
    bool nearest(double time, Time& out) const {
        const double product = std::nearbyint(time * scale_);
        if (!(std::abs(product) < static_cast<double>(dense::kTicks))) return false;
        out = static_cast<Time>(product);
        return true;
    }

    // The double that is nearest to the time of a tick; false if Python should compute it.
    bool time(Time tick, double& out) const {
        const Time size = std::abs(tick);
        if (ticks_ == 0 || size > kMost / units_) return false;
        const double time =
            quotient(static_cast<std::uint64_t>(size * units_), static_cast<std::uint64_t>(ticks_));
        out = tick < 0 ? -time : time;
        return true;
    }

private:
    static constexpr int kDigits = 18;
    static constexpr Time kMost = dense::kAfter;
    static constexpr double kExact = 0x1p53;    // below it, doubles are whole numbers of one
    static constexpr double kRound = 0x1.8p52;  // adding it rounds numbers below 2^51
    static constexpr double kPowers[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8, 1e9,
                                         1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18};

    // The product is off by less than 2^-51 of it, with the error of the double's text: if it is
    // not that near to the middle between two ticks, it rounds as the exact number does. Returns 0
    // if so: bits instead of bools, so that the loop over an array works on several at once.
    Time quick(double time, Time& out) const {
        const double product = time * scale_;
        const double sum = product + kRound;
        // Unsigned, as the difference of the bits may overflow where the count is not sure.
        out = static_cast<Time>(std::bit_cast<std::uint64_t>(sum) -
                                std::bit_cast<std::uint64_t>(kRound));
        const bool sure = std::abs(product - (sum - kRound)) + std::abs(product) * 0x1p-51 < 0.5;
        return Time{sure} - 1;
    }

    // Where decimals of so many digits are further apart than doubles, at most one of them reads as
    // the double: then it is the shortest text.
    bool rounded(double time, Time& out) const {
        if (digits_ < 0) return false;
        const double size = std::abs(time);
        int digits = digits_;
        while (digits > 0 && !(size * kPowers[digits] < 0x1p52)) --digits;
        const double decimal = std::nearbyint(size * kPowers[digits]);
        if (!(decimal < 0x1p52) || decimal / kPowers[digits] != size) return false;
        return shifted(static_cast<std::uint64_t>(decimal), digits_ - digits, time, out);
    }

    bool shortest(double time, Time& out) const {
        if (digits_ < 0 || !std::isfinite(time)) return false;
        char text[32];
        const auto end =
            std::to_chars(text, text + sizeof text, std::abs(time), std::chars_format::scientific);
        std::uint64_t number = 0;
        int shift = digits_;
        const char* c = text;
        for (bool fraction = false; *c != 'e'; ++c) {
            if (*c == '.') {
                fraction = true;
            } else {
                number = 10 * number + static_cast<std::uint64_t>(*c - '0');
                shift -= fraction;
            }
        }
        int exponent = 0;
        std::from_chars(c + (c[1] == '+' ? 2 : 1), end.ptr, exponent);
        return shifted(number, shift + exponent, time, out);
    }

    // Multiplies a number, below 10^17, with a power of ten, and rounds; false if it is too large.
    static bool shifted(std::uint64_t number, int shift, double sign, Time& out) {
        std::uint64_t power = 1;
        for (int i = 0; i < std::abs(shift) && i < kDigits; ++i) power *= 10;
        constexpr auto limit = static_cast<std::uint64_t>(dense::kTicks);
        if (shift >= 0) {
            if (shift > kDigits || number > (limit - 1) / power) return false;
            number *= power;
        } else {  // a power above all numbers stands for those that are greater
            const std::uint64_t rest = number % power;
            number /= power;
            number += rest > power / 2 || (rest == power / 2 && number % 2 == 1);
        }
        const auto size = static_cast<Time>(number);
        out = std::signbit(sign) ? -size : size;
        return true;
    }

    // The double that is nearest to n / d, both below 2^63.
    static double quotient(std::uint64_t n, std::uint64_t d) {
        if (n <= static_cast<std::uint64_t>(kExact) && d <= static_cast<std::uint64_t>(kExact))
            return static_cast<double>(n) / static_cast<double>(d);
        std::uint64_t whole = n / d;
        std::uint64_t rest = n % d;
        int shift = 0;
        // 55 bits of the quotient and whether there is a rest decide how it rounds.
        while (rest != 0 && whole < std::uint64_t{1} << 54) {
            const int most = whole == 0 ? 63 : std::countl_zero(whole) - 1;
            const int more = std::min(most, std::countl_zero(rest));
            whole = (whole << more) | ((rest << more) / d);
            rest = (rest << more) % d;
            shift += more;
        }
        return std::ldexp(static_cast<double>(whole | (rest != 0)), -shift);
    }

    double scale_;
    Time ticks_;
    Time units_;
    int digits_ = -1;  // if there are 10^digits ticks in a unit
};

}  // namespace rtamt
