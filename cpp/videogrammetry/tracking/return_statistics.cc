#include "videogrammetry/tracking/return_statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace videogrammetry {
namespace {

constexpr double kForget = 1.0 / 64;  // a stage
// Before anything is known: nine of ten come back from a short gap, two of three from a longer.
constexpr std::size_t kShort = 3;  // classes
constexpr double kReturns[] = {9.0, 2.0}, kGaps[] = {10.0, 3.0};

}  // namespace

std::size_t ReturnStatistics::Class(int gap) {
  const unsigned before = static_cast<unsigned>(std::max(gap, 2)) - 1;
  return std::min<std::size_t>(std::bit_width(before - 1U), kClasses - 1);
}

void ReturnStatistics::Add(int gap, bool returned) {
  Count& count = now_[Class(gap)];
  count.exposed += 1.0;
  count.returned += returned ? 1.0 : 0.0;
}

void ReturnStatistics::Commit() {
  for (std::size_t k = 0; k < kClasses; ++k) {
    past_[k].returned += now_[k].returned - kForget * past_[k].returned;
    past_[k].exposed += now_[k].exposed - kForget * past_[k].exposed;
  }
  now_ = {};
}

double ReturnStatistics::LogOdds(int gap) const {
  const std::size_t own = Class(gap), prior = own < kShort ? 0 : 1;
  const double returned = past_[own].returned + kReturns[prior];
  return std::log(returned / (past_[own].exposed + kGaps[prior] - returned));
}

}  // namespace videogrammetry
