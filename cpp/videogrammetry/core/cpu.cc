#include "videogrammetry/core/cpu.h"

#include <algorithm>
#include <cstdlib>

#if defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
#include <immintrin.h>
#include <intrin.h>
#endif

namespace videogrammetry {
namespace {

InstructionSet DetectHardware() {
#if (defined(__GNUC__) || defined(__clang__)) && (defined(__x86_64__) || defined(__i386__))
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq")) {
    return InstructionSet::kAvx512;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
    return InstructionSet::kAvx2;
  }
#elif defined(_MSC_VER) && (defined(_M_X64) || defined(_M_IX86))
  int info[4];
  __cpuid(info, 0);
  if (info[0] < 7) return InstructionSet::kBaseline;
  __cpuid(info, 1);
  const bool osxsave = (info[2] >> 27) & 1;
  const bool fma = (info[2] >> 12) & 1;
  if (!osxsave) return InstructionSet::kBaseline;
  const unsigned long long xcr = _xgetbv(0);
  __cpuidex(info, 7, 0);
  const bool avx2 = (info[1] >> 5) & 1;
  const bool avx512 = ((info[1] >> 16) & 1) && ((info[1] >> 17) & 1) && ((info[1] >> 30) & 1) &&
                      ((info[1] >> 31) & 1);
  if (avx512 && (xcr & 0xe6) == 0xe6) return InstructionSet::kAvx512;
  if (avx2 && fma && (xcr & 6) == 6) return InstructionSet::kAvx2;
#endif
  return InstructionSet::kBaseline;
}

}  // namespace

InstructionSet DetectInstructionSet() {
  static const InstructionSet hardware = DetectHardware();
  const char* wanted = std::getenv("VIDEOGRAMMETRY_ISA");
  if (wanted == nullptr) return hardware;
  const std::string name(wanted);
  if (name == "baseline") return InstructionSet::kBaseline;
  if (name == "avx2") return std::min(hardware, InstructionSet::kAvx2);
  return hardware;
}

std::string InstructionSetName(InstructionSet set) {
  switch (set) {
    case InstructionSet::kAvx512:
      return "avx512";
    case InstructionSet::kAvx2:
      return "avx2";
    case InstructionSet::kBaseline:
      break;
  }
  return "baseline";
}

}  // namespace videogrammetry
