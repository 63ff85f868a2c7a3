#include "lockstep/episodes.hpp"

#include <cmath>

#include "lockstep/columns.hpp"

namespace rtamt::lockstep {
namespace {

// A machine for each lane.
class MachineEpisodes final : public Episodes {
public:
    MachineEpisodes(const std::vector<DiscreteRow>& terms, std::size_t variables,
                    const std::vector<episode::FormulaRow>& formulas,
                    const std::vector<std::size_t>& initial,
                    const std::vector<std::size_t>& streams, EpisodeValues& values)
        : values_(values), variables_(variables) {
        for (std::size_t lane = 0; lane < values.samples.size(); ++lane) {
            machines_.push_back(
                std::make_unique<EpisodeMachine>(terms, variables, formulas, initial, streams));
            publish(lane);
        }
    }

    void take(const Lanes& lanes, const double* table, RegisterColumns& terms) override {
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            const std::uint32_t lane = lanes[i];
            machines_[lane]->take(table + lane * variables_, terms.out(0) + i, lanes.num());
            publish(lane);
        }
    }
    void reset(const Lanes& lanes) override {
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            machines_[lanes[i]]->reset();
            publish(lanes[i]);
        }
    }
    void finish(const Lanes& lanes) override {
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            machines_[lanes[i]]->finish(End::complete);
            publish(lanes[i]);
        }
    }
    void fields(Snapshot& s) override {
        for (std::size_t lane = 0; lane < machines_.size(); ++lane) {
            machines_[lane]->fields(s);
            publish(lane);
        }
    }

private:
    void publish(std::size_t lane) {
        const EpisodeMachine& machine = *machines_[lane];
        values_.samples[lane] = machine.samples();
        values_.finished[lane] = machine.finished();
        values_.now[lane] = machine.result();
        values_.lower[lane] = machine.lower();
        values_.upper[lane] = machine.upper();
    }

    EpisodeValues& values_;
    std::size_t variables_;
    std::vector<std::unique_ptr<EpisodeMachine>> machines_;
};

}  // namespace

std::unique_ptr<Episodes> episodes_of(const std::vector<DiscreteRow>& terms, std::size_t variables,
                                      const std::vector<episode::FormulaRow>& formulas,
                                      const std::vector<std::size_t>& initial,
                                      const std::vector<std::size_t>& streams,
                                      EpisodeValues& values) {
    if (auto columns = column_episodes(terms, formulas, initial, streams, values)) return columns;
    return std::make_unique<MachineEpisodes>(terms, variables, formulas, initial, streams, values);
}

}  // namespace rtamt::lockstep
