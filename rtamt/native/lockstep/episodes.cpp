#include "lockstep/episodes.hpp"

#include <cmath>

#include "lockstep/columns.hpp"

namespace rtamt::lockstep {
namespace {

// A machine for each lane.
class MachineEpisodes final : public Episodes {
public:
    MachineEpisodes(const episode::Program& program, EpisodeValues& values)
        : values_(values), sample_(program.variables) {
        for (std::size_t lane = 0; lane < values.samples.size(); ++lane) {
            machines_.push_back(std::make_unique<EpisodeMachine>(program));
            publish(lane);
        }
    }

    void take(const Lanes& lanes, const double* inputs, RegisterColumns& terms) override {
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            const std::uint32_t lane = lanes[i];
            for (std::size_t k = 0; k < sample_.size(); ++k)
                sample_[k] = inputs[k * lanes.num() + lane];
            machines_[lane]->take(sample_.data(), terms.out(0) + i, lanes.num());
            publish(lane);
        }
    }
    void reset(const Lanes& lanes) override {
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            machines_[lanes[i]]->reset();
            publish(lanes[i]);
        }
    }
    void finish(const Lanes& lanes, End end) override {
        for (std::size_t i = 0; i < lanes.count(); ++i) {
            machines_[lanes[i]]->finish(end);
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
    std::vector<double> sample_;
    std::vector<std::unique_ptr<EpisodeMachine>> machines_;
};

}  // namespace

std::unique_ptr<Episodes> episodes_of(const episode::Program& program, EpisodeValues& values) {
    if (auto columns = column_episodes(program, values)) return columns;
    return std::make_unique<MachineEpisodes>(program, values);
}

}  // namespace rtamt::lockstep
