#include "videogrammetry/matching/stages.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "videogrammetry/matching/chunk.h"

namespace videogrammetry {
namespace {

void CheckFlat(const Rig& rig, const std::vector<FlatTargets>& cameras,
               const std::map<std::size_t, MatchEdits>& edits) {
  if (cameras.size() != rig.size()) {
    throw std::invalid_argument("cameras: expected " + std::to_string(rig.size()) +
                                " (the rig's number), got " + std::to_string(cameras.size()));
  }
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const std::vector<std::size_t>& offsets = cameras[c].offsets;
    const CameraTargets& t = cameras[c].targets;
    if (t.cov_px2.size() != t.size() || t.id.size() != t.size() ||
        t.semi_major_px.size() != t.size()) {
      throw std::invalid_argument("targets: xy_px, cov_px2, id and semi_major_px differ in length");
    }
    if (offsets.empty() || offsets.front() != 0 || offsets.back() != t.size() ||
        !std::is_sorted(offsets.begin(), offsets.end())) {
      throw std::invalid_argument("offsets of camera " + std::to_string(c) +
                                  ": expected to rise from 0 to the number of targets, " +
                                  std::to_string(t.size()));
    }
    if (offsets.size() != cameras[0].offsets.size()) {
      throw std::invalid_argument(
          "offsets: camera 0 has " + std::to_string(cameras[0].offsets.size() - 1) +
          " stages, camera " + std::to_string(c) + " has " + std::to_string(offsets.size() - 1));
    }
  }
  const std::size_t stages = cameras.empty() ? 0 : cameras[0].offsets.size() - 1;
  if (!edits.empty() && edits.rbegin()->first >= stages) {
    throw std::invalid_argument("edits: stage " + std::to_string(edits.rbegin()->first) +
                                " is not among the " + std::to_string(stages) + " stages");
  }
}

}  // namespace

StageMatches MatchStages(const Rig& rig, const std::vector<FlatTargets>& cameras,
                         const MatchingOptions& options,
                         const std::map<std::size_t, MatchEdits>& edits) {
  CheckFlat(rig, cameras, edits);
  return Chunk(rig, cameras, options, edits).Run();
}

}  // namespace videogrammetry
