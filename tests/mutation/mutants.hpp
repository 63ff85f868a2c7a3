// Included before all else in a build with mutants: which of them is on, and which were reached.
#pragma once

extern "C" {
inline __attribute__((visibility("default"), used)) int mutant_on = -1;
inline __attribute__((visibility("default"), used)) unsigned char mutants_reached[MUTANTS] = {};
}

// What the compiler computes has no mutant.
constexpr bool mutant(int number) {
    if (__builtin_is_constant_evaluated()) return false;
    mutants_reached[number] = 1;
    return mutant_on == number;
}
