#include "batch/episodes.hpp"

#include <cmath>

#include "batch/columns.hpp"

namespace rtamt::batch {
namespace {

// A machine for each entry.
class MachineEpisodes final : public Episodes {
public:
    MachineEpisodes(const episode::Program& program, EpisodeValues& values)
        : values_(values), sample_(program.variables) {
        for (std::size_t entry = 0; entry < values.samples.size(); ++entry) {
            machines_.push_back(std::make_unique<EpisodeMachine>(program));
            publish(entry);
        }
    }

    void take(const Entries& entries, const double* inputs, RegisterColumns& terms) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            const std::uint32_t entry = entries[i];
            for (std::size_t k = 0; k < sample_.size(); ++k)
                sample_[k] = inputs[k * entries.num() + entry];
            machines_[entry]->take(sample_.data(), terms.out(0) + i, entries.num());
            publish(entry);
        }
    }
    void reset(const Entries& entries) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            machines_[entries[i]]->reset();
            publish(entries[i]);
        }
    }
    void finish(const Entries& entries, End end) override {
        for (std::size_t i = 0; i < entries.count(); ++i) {
            machines_[entries[i]]->finish(end);
            publish(entries[i]);
        }
    }
    void fields(Snapshot& s) override {
        for (std::size_t entry = 0; entry < machines_.size(); ++entry) {
            machines_[entry]->fields(s);
            publish(entry);
        }
    }

private:
    void publish(std::size_t entry) {
        const EpisodeMachine& machine = *machines_[entry];
        values_.samples[entry] = machine.samples();
        values_.finished[entry] = machine.finished();
        values_.now[entry] = machine.result();
        values_.lower[entry] = machine.lower();
        values_.upper[entry] = machine.upper();
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

}  // namespace rtamt::batch
