// Episodes in columns: each instruction runs in all entries at once. For programs whose folds at time
// 0 are over min and max of predicates and of bounded windows of predicates.
#pragma once

#include "batch/episodes.hpp"

namespace rtamt::batch {

// As episodes_of; null if the program has another form.
std::unique_ptr<Episodes> column_episodes(const episode::Program& program,
                                          EpisodeValues& values);

}  // namespace rtamt::batch
