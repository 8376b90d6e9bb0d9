#pragma once

#include <string>

namespace videogrammetry {

/// Instruction sets for which files of this library are compiled apart.
enum class InstructionSet { kBaseline = 0, kAvx2 = 1, kAvx512 = 2 };

/// The best set that this processor and operating system run.
///
/// The environment variable VIDEOGRAMMETRY_ISA (baseline, avx2, avx512) lowers
/// it, never raises it: for tests and for tracking a fault down.
InstructionSet DetectInstructionSet();

/// Its name as in VIDEOGRAMMETRY_ISA.
std::string InstructionSetName(InstructionSet set);

}  // namespace videogrammetry
