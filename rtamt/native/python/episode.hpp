// What a Python object of the episode machine holds.
#pragma once

#include "episode/variants.hpp"
#include "python/readout.hpp"
#include "python/samples.hpp"

namespace rtamt {

struct EpisodeObject : NamedObject<EpisodeVariants> {
    Readout readout;
    bool nan_is_unknown = false;  // as the reader has it
};

}  // namespace rtamt
