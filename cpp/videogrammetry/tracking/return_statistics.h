#pragma once

#include <array>

namespace videogrammetry {

/// Learns how often points that were not seen come back, by the length of the gap.
///
/// A point that is not seen is hidden or gone, and which cannot be told from it alone. Of
/// all points that have not been seen for g stages, the share that is seen again just then,
///
///     h(g) = (returns + r0) / (exposures + e0),
///
/// the discrete hazard of a return, holds both: where points leave for good it falls to
/// nothing, where they are hidden by turns it is the share seen. Gaps count in classes of
/// 2, 3, 4-5, 6-9 and more stages; old counts are forgotten.
class ReturnStatistics {
 public:
  /// A point seen `gap` stages ago, gap >= 2, was or was not seen in this stage.
  void Add(int gap, bool returned);
  /// To be called once a stage: takes what Add gathered.
  void Commit();

  /// log(h / (1 - h)).
  double LogOdds(int gap) const;

 private:
  static constexpr std::size_t kClasses = 5;
  static std::size_t Class(int gap);

  struct Count {
    double returned = 0.0, exposed = 0.0;
  };
  std::array<Count, kClasses> past_, now_;
};

}  // namespace videogrammetry
