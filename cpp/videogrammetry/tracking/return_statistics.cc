#include "videogrammetry/tracking/return_statistics.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace videogrammetry {
namespace {

constexpr double kForget = 1.0 / 64;           // a stage
constexpr double kReturns = 2.0, kGaps = 3.0;  // before anything is known: two of three

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
  const Count& count = past_[Class(gap)];
  const double returned = count.returned + kReturns;
  return std::log(returned / (count.exposed + kGaps - returned));
}

}  // namespace videogrammetry
