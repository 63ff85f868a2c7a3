// Machines of one program in lockstep, a lane each, an instruction at a time over all lanes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "discrete/machine.hpp"
#include "episode/machine.hpp"

namespace rtamt {

// The lanes that a call is about, in rising order.
class Lanes {
public:
    explicit Lanes(std::size_t num);
    // The lanes where the mask is true, all without one.
    void choose(const bool* mask);

    std::size_t num() const { return all_.size(); }
    std::size_t count() const { return chosen_ == all_.data() ? all_.size() : some_.size(); }
    std::uint32_t operator[](std::size_t i) const { return chosen_[i]; }

private:
    std::vector<std::uint32_t> all_;
    std::vector<std::uint32_t> some_;
    const std::uint32_t* chosen_;
};

// The registers of the chosen lanes, a column each.
class LaneColumns {
public:
    LaneColumns(const DiscreteMachine& program, std::size_t num);

    const double* at(std::size_t slot) const { return at_[slot]; }
    double* out(std::size_t slot) { return memory_.get() + slot * num_; }

    // Evaluates the terms of samples, a row for each lane. The first of the lanes with a nan, as a
    // place among the chosen, or their count.
    std::size_t terms(const double* table, const Lanes& lanes);
    void map(const Step& step, std::size_t count);
    // Hands the terms of the chosen lane at a place to a machine.
    template <class M>
    void hand_to(M& machine, const double* inputs, std::size_t place) const {
        machine.take(inputs, memory_.get() + place, num_);
    }

private:
    const DiscreteMachine& program_;
    std::size_t num_;
    std::unique_ptr<double[]> memory_;
    std::vector<const double*> at_;
};

// What `DiscreteMachine` is for one lane.
class DiscreteBank {
public:
    // As for DiscreteMachine; all machines are new.
    DiscreteBank(const std::vector<Row>& rows, std::size_t terms, std::size_t variables,
         const Observed& result, std::size_t num);
    DiscreteBank(const DiscreteBank&) = delete;
    DiscreteBank& operator=(const DiscreteBank&) = delete;

    std::size_t num() const { return lanes_.num(); }
    std::size_t variables() const { return program_.variables(); }
    std::int64_t samples(std::size_t lane) const { return samples_[lane]; }
    const double* inputs() const { return inputs_.data(); }  // a row for each lane
    const double* results() const { return results_.data(); }

    // One sample of every chosen lane, from its row of the table. The lane of a nan, of which
    // nothing is changed in any lane, or num().
    std::size_t take(const double* table, const bool* mask);
    void reset(const bool* mask);

    static constexpr const char* kForeign = DiscreteMachine::kForeign;

    std::string state() const;
    // Throws std::invalid_argument on what is no state of a bank like this.
    void restore(std::string_view bytes);

private:
    // An instruction behind the terms, with the part that it pushes to of every lane.
    struct LaneStep {
        Step step;
        std::vector<Part*> parts;
    };

    void execute(const LaneStep& step);
    template <class Fold>
    void push(const LaneStep& step);

    DiscreteMachine program_;
    LaneColumns columns_;
    Lanes lanes_;
    std::vector<std::unique_ptr<Part>> parts_;  // lane behind lane
    std::vector<LaneStep> formulas_;
    std::vector<std::int64_t> samples_;
    std::vector<double> inputs_;
    std::vector<double> results_;
    std::int64_t least_ = 0;  // samples of the chosen lanes
};

// What `EpisodeMachine` is for one lane.
class EpisodeBank {
public:
    EpisodeBank(const std::vector<Row>& terms, std::size_t variables,
                const std::vector<episode::Formula>& formulas,
                const std::vector<std::size_t>& tops, const std::vector<std::size_t>& streams,
                std::size_t num);
    EpisodeBank(const EpisodeBank&) = delete;
    EpisodeBank& operator=(const EpisodeBank&) = delete;

    std::size_t num() const { return lanes_.num(); }
    std::size_t variables() const { return program_.variables(); }
    std::int64_t samples(std::size_t lane) const { return machines_[lane]->samples(); }
    bool finished(std::size_t lane) const { return machines_[lane]->finished(); }
    const double* inputs() const { return inputs_.data(); }
    const double* results() const { return robustness_.data(); }
    const double* lower() const { return lower_.data(); }
    const double* upper() const { return upper_.data(); }

    // As for DiscreteBank; no chosen lane is finished.
    std::size_t take(const double* table, const bool* mask);
    void reset(const bool* mask);
    // Ends the traces of the chosen lanes, of at least one sample each.
    void finish(const bool* mask);

    static constexpr const char* kForeign = DiscreteMachine::kForeign;

    std::string state() const;
    void restore(std::string_view bytes);

private:
    void look_at(std::size_t lane);

    DiscreteMachine program_;  // the terms
    LaneColumns columns_;
    Lanes lanes_;
    std::vector<std::unique_ptr<EpisodeMachine>> machines_;
    std::uint64_t mark_;
    std::vector<double> inputs_;
    std::vector<double> robustness_;
    std::vector<double> lower_;
    std::vector<double> upper_;
};

}  // namespace rtamt
