#include "videogrammetry/tracking/sparse_assignment.h"

#include <algorithm>
#include <functional>
#include <limits>
#include <queue>

namespace videogrammetry {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

// Tracks are followed by one stand-in a row, rows (the columns) by one a track:
// what stays alone has its own stand-in, and where a track and a row have each
// other, so have their stand-ins. Every assignment is perfect then, and forbidding
// a link costs one cycle.
class Assignment {
 public:
  Assignment(int num_tracks, int num_rows, const std::vector<LinkCandidate>& links)
      : tracks_(num_tracks),
        rows_(num_rows),
        begin_(static_cast<std::size_t>(num_tracks + num_rows) + 1, 0),
        column_of_(static_cast<std::size_t>(num_tracks + num_rows), -1),
        owner_(column_of_.size(), -1),
        track_potential_(column_of_.size(), 0.0),
        potential_(column_of_.size(), 0.0),
        distance_(column_of_.size(), kInfinite),
        from_(column_of_.size(), -1),
        done_(column_of_.size(), 0) {
    std::vector<char> used(column_of_.size(), 0);
    std::vector<std::pair<int, Edge>> all;
    for (const LinkCandidate& c : links) {
      const int t = c.track, stand_in = tracks_ + c.row;
      all.push_back({t, {c.row, -c.log_odds}});
      all.push_back({stand_in, {rows_ + t, 0.0}});
      if (!used[U(t)]) all.push_back({t, {rows_ + t, 0.0}});
      if (!used[U(stand_in)]) all.push_back({stand_in, {c.row, 0.0}});
      used[U(t)] = used[U(stand_in)] = 1;
    }
    for (const auto& [i, edge] : all) ++begin_[U(i) + 1];
    for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
    std::vector<int> fill(begin_.begin(), begin_.end() - 1);
    edges_.resize(all.size());
    for (const auto& [i, edge] : all) {
      edges_[U(fill[U(i)]++)] = edge;
      track_potential_[U(i)] = std::min(track_potential_[U(i)], edge.cost);  // all <= 0
    }
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i]) Augment(static_cast<int>(i));
    }
  }

  // Assigns track `i`; columns already taken change hands along the path.
  void Augment(int i) {
    const auto [end, length] = ShortestPath(i, -1);
    for (const int c : visited_) {
      if (done_[U(c)]) {
        if (owner_[U(c)] >= 0) track_potential_[U(owner_[U(c)])] += length - distance_[U(c)];
        potential_[U(c)] += distance_[U(c)] - length;
      }
    }
    track_potential_[U(i)] += length;
    int column = end;
    while (column >= 0) {
      const int track = from_[U(column)];
      const int next = column_of_[U(track)];
      owner_[U(column)] = track;
      column_of_[U(track)] = column;
      column = track == i ? -1 : next;
    }
    Reset();
  }

  // What the best solution loses without this track's column: the shortest way
  // from the track back to the column, by other tracks.
  double Margin(int i) {
    const int column = column_of_[U(i)];
    const double length = ShortestPath(i, column).second;
    Reset();
    return length - potential_[U(column)];  // the edge itself is tight: cost = u + v
  }

  int row_of(int i) const {
    const int column = column_of_[U(i)];
    return column < rows_ ? column : -1;
  }

  void Coupled(double limit, std::vector<std::pair<int, int>>* pairs) const {
    for (std::size_t i = 0; i < U(tracks_); ++i) {
      for (int e = begin_[i]; e < begin_[i + 1]; ++e) {
        const int owner = owner_[U(edges_[U(e)].column)];
        if (owner < 0 || owner >= tracks_ || owner == static_cast<int>(i)) continue;
        if (edges_[U(e)].cost - track_potential_[i] - potential_[U(edges_[U(e)].column)] <= limit) {
          pairs->emplace_back(static_cast<int>(i), owner);
        }
      }
    }
  }

 private:
  struct Edge {
    int column = 0;
    double cost = 0.0;
  };
  static std::size_t U(int i) { return static_cast<std::size_t>(i); }

  // To a column without an owner, whose potential is 0. The banned column
  // counts as one, but for the track itself; it has its potential still.
  std::pair<int, double> ShortestPath(int start, int banned) {
    using Item = std::pair<double, int>;
    std::priority_queue<Item, std::vector<Item>, std::greater<>> queue;
    const auto relax = [&](int track, double base) {
      for (int e = begin_[U(track)]; e < begin_[U(track) + 1]; ++e) {
        const int c = edges_[U(e)].column;
        if (done_[U(c)] || (track == start && c == banned)) continue;
        const double d = base + edges_[U(e)].cost - track_potential_[U(track)] - potential_[U(c)];
        if (d >= distance_[U(c)]) continue;
        if (distance_[U(c)] == kInfinite) visited_.push_back(c);
        distance_[U(c)] = d;
        from_[U(c)] = track;
        queue.emplace(d, c);
      }
    };
    relax(start, 0.0);
    const double bonus = banned >= 0 ? std::min(potential_[U(banned)], 0.0) : 0.0;
    double best = kInfinite;
    int end = -1;
    while (!queue.empty()) {
      const auto [d, c] = queue.top();
      queue.pop();
      if (d + bonus >= best) break;
      if (done_[U(c)] || d > distance_[U(c)]) continue;
      if (owner_[U(c)] < 0 || c == banned) {
        const double length = c == banned ? d + bonus : d;
        if (length < best) {
          best = length;
          end = c;
        }
        continue;
      }
      done_[U(c)] = 1;
      relax(owner_[U(c)], d);
    }
    return {end, best};
  }

  void Reset() {
    for (const int c : visited_) {
      distance_[U(c)] = kInfinite;
      done_[U(c)] = 0;
    }
    visited_.clear();
  }

  int tracks_, rows_;
  std::vector<int> begin_, column_of_, owner_;
  std::vector<Edge> edges_;
  std::vector<double> track_potential_, potential_, distance_;
  std::vector<int> from_;
  std::vector<char> done_;
  std::vector<int> visited_;
};

}  // namespace

std::vector<TrackLink> AssignRows(int num_tracks, int num_rows,
                                  const std::vector<LinkCandidate>& candidates, double coupling,
                                  std::vector<std::pair<int, int>>* coupled) {
  // Most tracks and rows have each other alone.
  std::vector<TrackLink> links(static_cast<std::size_t>(num_tracks));
  std::vector<int> of_track(links.size(), 0), of_row(static_cast<std::size_t>(num_rows), 0);
  for (const LinkCandidate& c : candidates) {
    ++of_track[static_cast<std::size_t>(c.track)];
    ++of_row[static_cast<std::size_t>(c.row)];
  }
  std::vector<LinkCandidate> shared;
  for (const LinkCandidate& c : candidates) {
    const auto t = static_cast<std::size_t>(c.track);
    if (of_track[t] == 1 && of_row[static_cast<std::size_t>(c.row)] == 1) {
      links[t] = {c.row, c.log_odds};
      of_track[t] = 0;
    } else {
      shared.push_back(c);
    }
  }
  Assignment assignment(num_tracks, num_rows, shared);
  for (std::size_t t = 0; t < links.size(); ++t) {
    if (of_track[t] == 0) continue;
    const int i = static_cast<int>(t);
    links[t] = {assignment.row_of(i), assignment.Margin(i)};
  }
  if (coupled) assignment.Coupled(coupling, coupled);
  return links;
}

}  // namespace videogrammetry
