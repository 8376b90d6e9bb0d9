#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "videogrammetry/matching/view.h"

namespace videogrammetry {

/// Which targets are free: a camera, a target.
using FreeTargets = std::vector<std::vector<char>>;

/// Two cameras; found once a rig.
struct CameraPair {
  std::size_t a = 0, b = 0;
  Eigen::Matrix3d essential = Eigen::Matrix3d::Zero();  ///< x_b^T E x_a = 0; without windows
  bool curved = false;                                  ///< through a window
  /// Along a's rays, the range from which b sees anything; empty if least >= most.
  double least_mm = 0.0, most_mm = 0.0;
};

/// All pairs a < b of a rig.
std::vector<CameraPair> CameraPairs(const std::vector<CameraView>& cameras,
                                    const MatchingOptions& options);

/// Whether an ID or none is compatible with another.
inline bool IdsAgree(int a, int b) { return a < 0 || b < 0 || a == b; }

/// Finds the targets of one camera whose rays meet one of another's.
class PairFinder {
 public:
  PairFinder(const std::vector<CameraView>& cameras, const std::vector<TargetView>& targets,
             std::span<const CameraTargets> data, const std::vector<CameraPair>& pairs,
             double critical_value)
      : cameras_(cameras),
        targets_(targets),
        data_(data),
        pairs_(pairs),
        critical_value_(critical_value) {}

  const std::vector<CameraPair>& pairs() const { return pairs_; }

  /// Replaces `near` by the free targets of camera b within the gate of the epipolar line of
  /// a's target i, or of the curve on which its refracted ray is seen; ascending.
  void Partners(const CameraPair& pair, std::size_t i, const FreeTargets& free,
                std::vector<int>* near) const;

  /// Volume of the space from which the rays come, from pairs that pass the gate.
  double Volume(const FreeTargets& free) const;

 private:
  void AlongLine(const CameraPair& pair, std::size_t i, const FreeTargets& free,
                 std::vector<int>* near) const;
  void AlongCurve(const CameraPair& pair, std::size_t i, const FreeTargets& free,
                  std::vector<int>* near) const;
  bool Passes(const CameraPair& pair, std::size_t i, std::size_t j) const;

  const std::vector<CameraView>& cameras_;
  const std::vector<TargetView>& targets_;
  std::span<const CameraTargets> data_;
  const std::vector<CameraPair>& pairs_;
  double critical_value_;
};

}  // namespace videogrammetry
