#pragma once

#include <limits>
#include <vector>

namespace videogrammetry {

/// A possible link: what it adds to the logarithm of the likelihood against
/// leaving both ends alone.
struct LinkCandidate {
  int track = 0;
  int row = 0;
  double log_odds = 0.0;  ///< > 0
};

/// What a track was given.
struct TrackLink {
  int row = -1;  ///< -1: none
  /// By how much all links together are likelier than the best without this one
  /// (for a track without a row: than the best in which it has one); exact.
  double margin =
      std::numeric_limits<double>::infinity();  // infinite where nothing else is possible
};

/// The links of the largest total, no row and no track twice: successive
/// shortest augmenting paths with potentials over the graph of candidates (the
/// Hungarian method, sparse; Jonker, Volgenant, Computing 38 (1987)). A path
/// ends where a track stays without a row, so that only neighbourhoods are searched.
///
/// @param coupled  pairs of tracks that exchange rows in some solution within
///     `coupling` of the best, in no order; may be null.
std::vector<TrackLink> AssignRows(int num_tracks, int num_rows,
                                  const std::vector<LinkCandidate>& candidates, double coupling,
                                  std::vector<std::pair<int, int>>* coupled);

}  // namespace videogrammetry
