// Bounds the robustness of an episode: rtamt/episode.py says what that means.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "discrete/machine.hpp"
#include "episode/streams.hpp"

namespace rtamt {

namespace episode {



constexpr Time kNever = std::numeric_limits<Time>::max() / 4;  // no bound

class Endless;
class Top;

// An instruction behind the terms, which writes the register behind the one before: WINDOW over
// offsets lo to hi, where kNever is no bound, or MAP.
struct Formula {
    std::string kind;
    std::string name;
    std::size_t a;
    std::size_t b;
    Time lo;
    Time hi;
};

}  // namespace episode

class EpisodeMachine {
public:
    // Terms in the order of their registers and formulas behind them; registers that are read at
    // time 0 alone, the result last; registers that are read at all times. Checked only as far as
    // memory is concerned.
    EpisodeMachine(const std::vector<Row>& terms, std::size_t variables,
                   const std::vector<episode::Formula>& formulas,
                   const std::vector<std::size_t>& tops, const std::vector<std::size_t>& streams);
    EpisodeMachine(const EpisodeMachine&) = delete;
    EpisodeMachine& operator=(const EpisodeMachine&) = delete;
    ~EpisodeMachine();

    std::size_t variables() const { return terms_.variables(); }
    std::int64_t samples() const { return terms_.samples(); }
    const double* inputs() const { return terms_.inputs(); }

    double* pending() { return terms_.pending(); }
    bool take();
    // The same, of a sample whose terms are known: registers that stand `stride` apart.
    void take(const double* inputs, const double* terms, std::size_t stride);
    double result() const { return values_[episode::kNow]; }

    double lower() const { return values_[episode::kLower]; }
    double upper() const { return values_[episode::kUpper]; }
    bool finished() const { return finished_; }
    // Ends the trace, of at least one sample.
    void finish();

    static constexpr const char* kForeign = DiscreteMachine::kForeign;

    void reset();
    std::string state() const;
    // Throws std::invalid_argument on what is no state of this machine.
    void restore(std::string_view bytes);

private:
    class Builder;
    struct Settle {
        episode::Stream* stream;
        episode::Endless* endless;  // the same, where it is one
    };
    struct Look {
        episode::Stream* stream;
        episode::World world;
    };

    void advance();
    void demand();
    void plan(episode::Time t);
    void settle(episode::Time t, const double* terms);
    void conclude(episode::Time t, const double* terms);

    DiscreteMachine terms_;
    std::uint64_t fingerprint_;
    episode::Desk desk_;
    std::vector<std::unique_ptr<episode::Stream>> streams_;  // each behind what it reads
    std::vector<std::unique_ptr<episode::Top>> tops_;        // likewise; the last is the result
    std::vector<episode::Endless*> unknowns_;
    // What is left to do, by streams and worlds, before sample next_plan_.
    std::vector<Settle> settles_;
    std::vector<Look> looks_;
    bool open_ = true;
    episode::Time next_plan_ = 0;
    std::array<double, episode::kWorlds> values_{};
    std::array<double, episode::kWorlds> empty_{};  // before the first sample
    bool finished_ = false;
};

}  // namespace rtamt
