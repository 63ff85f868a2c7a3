#include "episode/streams.hpp"

namespace rtamt::episode {

void Polynomials::substitute(std::size_t unknown, const double* value) {
    const std::size_t bit = std::size_t{1} << unknown;
    for (std::size_t component = 0; component < width_; ++component) {
        for (std::size_t c = 0; c < corners_; ++c) {
            if (c & bit) continue;
            double* __restrict low = line(c, component).data();
            double* __restrict high = line(c | bit, component).data();
            const double u = value[c];
            const double v = value[c | bit];
            const std::size_t n = size();
            for (std::size_t i = 0; i < n; ++i) {
                const double x = low[i];
                const double y = high[i];
                low[i] = greater(x, lesser(y, u));
                high[i] = greater(x, lesser(y, v));
            }
        }
    }
}

Stream::Stream(Workspace& workspace, Time latency, std::uint32_t unknown_mask,
               std::vector<Stream*> operands)
    : workspace_(workspace),
      latency_(latency),
      unknown_mask_(unknown_mask),
      operands_(std::move(operands)),
      history_(workspace.unknowns.corners(unknown_mask), 1) {}

void Stream::propagate_demands() {
    for (Stream* operand : operands_) {
        if (active_) operand->activate();
        for (World w : kAll)
            if (finds_open(w)) operand->want(w);
        for (World w : kAtEnd)
            if (finds_open(w)) operand->want(w, reads_ahead(w, ahead_[w]));
    }
}

bool Stream::add_to(Parts& parts, bool) {
    if (unknown_mask_ != 0) return false;
    if (latency_ == 0) {
        parts.settled.push_back(this);
        return true;
    }
    if (parts.late != nullptr || !window()) return false;
    parts.late = this;
    return true;
}

void Stream::append(std::size_t corner, double value) {
    Line& line = history_.line(corner);
    if (line.size() < retained_) {
        line.push(value);
    } else if (retained_ == 1) {
        line[0] = value;
    } else {
        line.pop();
        line.push(value);
    }
}

double* Stream::open(World w, std::size_t count) {
    std::vector<double>& memory = memory_[w];
    if (memory.size() < count) memory.resize(std::max(count, 2 * memory.size()));
    open_[w] = {memory.data(), count};
    return memory.data();
}

const double* Stream::values(World w, Time begin, Time end, Scratch& scratch) const {
    const Span span = open_[w];
    const Time open_from = last_ + 1;
    const Time open_to = last_ + static_cast<Time>(span.size);
    if (begin >= open_from && end <= open_to) return span.data + (begin - open_from);
    const Time first = open_from - static_cast<Time>(history_.size());
    if (end <= last_ && history_.corners() == 1) return history_.line(0).data() + (begin - first);

    double* const values = scratch.reserve(static_cast<std::size_t>(end - begin + 1));
    double* out = values;
    for (Time i = begin; i <= std::min(end, last_); ++i)
        *out++ = history_.at(static_cast<std::size_t>(i - first), 0, w, workspace_.unknowns);
    const Time from = std::max(begin, open_from);
    const Time to = std::min(end, open_to);
    if (from <= to) out = std::copy_n(span.data + (from - open_from), to - from + 1, out);
    std::fill(out, values + (end - begin + 1), tail_[w]);
    return values;
}

void Stream::reset() {
    history_.clear();
    last_ = -1;
    open_ = {};
    for (std::size_t w = 0; w < kWorlds; ++w) tail_[w] = outlook_[w].tail;
}

void Stream::fields(Snapshot& s, Time t) {
    if (s.reads()) last_ = std::max<Time>(-1, t - latency_);
    history_.fields(s, std::min(retained_, static_cast<std::size_t>(last_ + 1)));
}

}  // namespace rtamt::episode
