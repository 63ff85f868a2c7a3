// Episodes with neutral predicates or uncertain values, as up to three variants of one episode. The
// definition is rtamt/machines/episode/machine.py.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "discrete/machine.hpp"
#include "episode/machine.hpp"

namespace rtamt {

// The variants of a machine or of a batch M:
//   worst   gives the lower bound:  neutral predicates are -0.0, values the smallest;
//   result  gives the robustness:   neutral predicates are 0.0, values the smallest;
//   best    gives the upper bound:  neutral predicates are 0.0, values the largest.
// The worst is the result itself in a program without neutral predicates, and so is the best until
// the first uncertain value, from which it continues from the state of the result.
template <class M>
class VariantsOf {
public:
    // Takes the terms that are neutral predicates, and the number of entries of a batch.
    template <class... Num>
    VariantsOf(episode::Program program, std::vector<std::size_t> neutral, Num... num)
        : program_(std::move(program)),
          neutral_(std::move(neutral)),
          result_(std::make_unique<M>(program_, num...)),
          lower_(result_.get()),
          upper_(result_.get()) {
        if (neutral_.empty()) return;
        episode::Program worst = program_;
        for (const std::size_t term : neutral_) worst.terms.at(term).value = -0.0;
        worst_ = std::make_unique<M>(worst, num...);
        lower_ = worst_.get();
    }

    std::size_t variables() const { return program_.variables; }
    auto samples() const { return result_->samples(); }
    auto finished() const { return result_->finished(); }
    const double* inputs() const { return result_->inputs(); }
    const double* upper_inputs() const { return upper_->inputs(); }
    auto lower() const { return lower_->lower(); }
    auto upper() const { return upper_->upper(); }

    std::uint64_t fingerprint() const {
        Fingerprint print;
        print.add(result_->fingerprint(), lower_->fingerprint());
        return print.value();
    }

protected:
    bool several() const { return lower_ != upper_; }
    bool apart() const { return upper_ != result_.get(); }
    template <class Run>
    void each(Run run) {
        run(*result_);
        if (worst_) run(*worst_);
        if (apart()) run(*best_);
    }
    // Lets the best variant go on from the state of the result.
    template <class... Num>
    void part(Num... num) {
        if (apart()) return;
        if (!best_) best_ = std::make_unique<M>(program_, num...);
        restore_from(*best_, state_of(*result_));
        upper_ = best_.get();
    }
    void join() { upper_ = result_.get(); }

    TermRanges& ranges() {
        if (!ranges_) ranges_ = std::make_unique<TermRanges>(program_.terms, variables());
        return *ranges_;
    }

    template <class... Num>
    void fields_of_all(Snapshot& s, Num... num) {
        bool is_apart = apart();
        s(is_apart);
        result_->fields(s);
        if (worst_) worst_->fields(s);
        if (!is_apart) return;
        if (s.reads()) part(num...);
        best_->fields(s);
    }

    episode::Program program_;
    std::vector<std::size_t> neutral_;
    std::unique_ptr<M> worst_;  // null without neutral predicates
    std::unique_ptr<M> result_;
    std::unique_ptr<M> best_;  // null until it is needed
    M* lower_;
    M* upper_;
    std::vector<double> least_terms_;
    std::vector<double> greatest_terms_;

private:
    std::unique_ptr<TermRanges> ranges_;
};

class EpisodeVariants : public VariantsOf<EpisodeMachine> {
public:
    using VariantsOf::VariantsOf;

    // Takes a sample in as DiscreteMachine does.
    double* pending() { return result_->pending(); }
    bool take() {
        if (!several()) [[likely]]
            return result_->take();
        const std::vector<double> sample(pending(), pending() + variables());
        for (const double value : sample)
            if (value != value) return false;  // also of a variable that no term reads
        return take(sample.data(), sample.data(), apart());
    }
    // Takes a sample in that lies between two others. Returns false, and changes nothing, if a term
    // has no value.
    bool take(const double* lower, const double* upper, bool uncertain = true) {
        if (!ranges().find(lower, upper, 1)) return false;
        if (uncertain) part();
        least_terms_.clear();
        greatest_terms_.clear();
        for (std::size_t i = 0; i < ranges().terms(); ++i) {
            least_terms_.push_back(ranges()[i].lower);
            greatest_terms_.push_back(ranges()[i].upper);
        }
        result_->take(lower, least_terms_.data(), 1);
        if (uncertain) best_->take(upper, greatest_terms_.data(), 1);
        if (worst_) {
            for (const std::size_t term : neutral_) least_terms_[term] = -0.0;
            worst_->take(lower, least_terms_.data(), 1);
        }
        return true;
    }

    // The smallest robustness if the episode ended now; nan before the first sample.
    double result() const { return moved_ ? *moved_ : result_->result(); }
    int verdict() const { return verdict_of(lower(), upper()); }
    void finish(End end) {
        if (finished()) return;
        const double robustness = result();
        each([=](EpisodeMachine& machine) { machine.finish(end); });
        if (several()) moved_ = moved(robustness, lower(), upper());
    }
    void reset() {
        join();
        each([](EpisodeMachine& machine) { machine.reset(); });
        moved_.reset();
    }
    void fields(Snapshot& s) {
        fields_of_all(s);
        if (!several()) return;
        double robustness = moved_.value_or(std::nan(""));
        s(robustness);
        moved_ = robustness == robustness ? std::optional(robustness) : std::nullopt;
        each([&](EpisodeMachine& machine) {
            s.require(machine.samples() == samples() && machine.finished() == finished());
        });
    }

private:
    std::optional<double> moved_;  // the robustness inside the bounds of all, after the end
};

}  // namespace rtamt
