// Time: whole ticks. Times of events and bounds are less than kTicks, so that the sum of two is a
// Time; what has no begin or no end has flags of its own, which are never added to.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

namespace rtamt::dense {

using Time = std::int64_t;

constexpr Time kTicks = Time{1} << 62;
constexpr Time kBefore = std::numeric_limits<Time>::min();  // before all times
constexpr Time kAfter = std::numeric_limits<Time>::max();   // after all times

// What the times of events are; `none` before the first.
enum class Dating : std::uint8_t { none, numbers, dates };

inline bool counts(Time time) { return -kTicks < time && time < kTicks; }

// A frontier, which is no later than kTicks, less a bound.
inline Time earlier(Time frontier, Time bound) {
    return bound > 0 && frontier <= kBefore + bound ? kBefore
           : frontier == kBefore                    ? kBefore
                                                    : frontier - bound;
}

inline bool rises(const Time* times, std::size_t n) {
    bool fine = true;
    for (std::size_t i = 0; i < n; ++i)
        fine &= counts(times[i]) && (i == 0 || times[i] > times[i - 1]);
    return fine;
}

}  // namespace rtamt::dense
