#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>

#include "bindings.h"
#include "videogrammetry/tracking/smoother.h"
#include "videogrammetry/tracking/tracker.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;

std::vector<Eigen::Vector3d> Positions(const Array<double>& xyz) {
  std::vector<Eigen::Vector3d> points(static_cast<std::size_t>(xyz.size()) / 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i] = Eigen::Map<const Eigen::Vector3d>(xyz.data() + 3 * i);
  }
  return points;
}

std::vector<Eigen::Matrix3d> Covariances(const Array<double>& cov) {
  std::vector<Eigen::Matrix3d> matrices(static_cast<std::size_t>(cov.size()) / 9);
  for (std::size_t i = 0; i < matrices.size(); ++i) {
    matrices[i] = Eigen::Map<const Eigen::Matrix3d>(cov.data() + 9 * i);  // symmetric
  }
  return matrices;
}

template <typename T, typename U>
py::array_t<T> ToArray(const std::vector<U>& values) {
  py::array_t<T> array(static_cast<py::ssize_t>(values.size()));
  std::copy(values.begin(), values.end(), array.mutable_data());
  return array;
}

py::dict ToDict(const StageLinks& links) {
  std::vector<int> from, to, stage, row, number;
  std::vector<double> log_odds;
  for (const Rename& r : links.renames) {
    from.push_back(r.from);
    to.push_back(r.to);
  }
  for (const Revision& r : links.revisions) {
    stage.push_back(r.stage);
    row.push_back(r.row);
    number.push_back(r.number);
    log_odds.push_back(r.log_odds);
  }
  return py::dict(
      "number"_a = ToArray<std::int32_t>(links.number),
      "log_odds"_a = ToArray<double>(links.log_odds), "rename_from"_a = ToArray<std::int32_t>(from),
      "rename_to"_a = ToArray<std::int32_t>(to), "revised_stage"_a = ToArray<std::int32_t>(stage),
      "revised_row"_a = ToArray<std::int32_t>(row),
      "revised_number"_a = ToArray<std::int32_t>(number),
      "revised_log_odds"_a = ToArray<double>(log_odds));
}

py::dict Add(Tracker& tracker, const Array<std::int32_t>& id, const Array<double>& position_mm,
             const Array<double>& cov_mm2) {
  if (position_mm.size() != 3 * id.size() || cov_mm2.size() != 9 * id.size()) {
    throw std::invalid_argument("points: expected id (P,), position_mm (P, 3), cov_mm2 (P, 3, 3)");
  }
  const std::vector<int> ids(id.data(), id.data() + id.size());
  const auto positions = Positions(position_mm);
  const auto covariances = Covariances(cov_mm2);
  StageLinks links;
  {
    const py::gil_scoped_release release;
    links = tracker.Add(ids, positions, covariances);
  }
  return ToDict(links);
}

/// What some stages gave, one after the other; changes with the stage at which they came.
struct ManyLinks {
  std::vector<int> number, rename_at, rename_from, rename_to;
  std::vector<double> log_odds;
  std::vector<int> revised_at, revised_stage, revised_row, revised_number;
  std::vector<double> revised_log_odds;

  void Add(int stage, const StageLinks& links) {
    number.insert(number.end(), links.number.begin(), links.number.end());
    log_odds.insert(log_odds.end(), links.log_odds.begin(), links.log_odds.end());
    for (const Rename& r : links.renames) {
      rename_at.push_back(stage);
      rename_from.push_back(r.from);
      rename_to.push_back(r.to);
    }
    for (const Revision& r : links.revisions) {
      revised_at.push_back(stage);
      revised_stage.push_back(r.stage);
      revised_row.push_back(r.row);
      revised_number.push_back(r.number);
      revised_log_odds.push_back(r.log_odds);
    }
  }
};

py::dict AddStages(Tracker& tracker, const Array<std::int64_t>& offsets,
                   const Array<std::int32_t>& id, const Array<double>& position_mm,
                   const Array<double>& cov6_mm2) {
  if (position_mm.size() != 3 * id.size() || cov6_mm2.size() != 6 * id.size()) {
    throw std::invalid_argument("points: expected id (P,), position_mm (P, 3), cov_mm2 (P, 6)");
  }
  const std::int64_t* begin = offsets.data();
  const auto stages = static_cast<int>(offsets.size()) - 1;
  if (stages < 0 || begin[0] != 0 || begin[stages] != id.size() ||
      !std::is_sorted(begin, begin + stages + 1)) {
    throw std::invalid_argument("offsets: expected to rise from 0 to the number of points");
  }
  ManyLinks links;
  {
    const py::gil_scoped_release release;
    std::vector<int> ids;
    std::vector<Eigen::Vector3d> positions;
    std::vector<Eigen::Matrix3d> covariances;
    for (int s = 0; s < stages; ++s) {
      ids.assign(id.data() + begin[s], id.data() + begin[s + 1]);
      positions.clear();
      covariances.clear();
      for (std::int64_t i = begin[s]; i < begin[s + 1]; ++i) {
        positions.emplace_back(Eigen::Map<const Eigen::Vector3d>(position_mm.data() + 3 * i));
        const double* c = cov6_mm2.data() + 6 * i;
        covariances.emplace_back() << c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5];
      }
      links.Add(s, tracker.Add(ids, positions, covariances));
    }
  }
  return py::dict("number"_a = ToArray<std::int32_t>(links.number),
                  "log_odds"_a = ToArray<double>(links.log_odds),
                  "rename_at"_a = ToArray<std::int32_t>(links.rename_at),
                  "rename_from"_a = ToArray<std::int32_t>(links.rename_from),
                  "rename_to"_a = ToArray<std::int32_t>(links.rename_to),
                  "revised_at"_a = ToArray<std::int32_t>(links.revised_at),
                  "revised_stage"_a = ToArray<std::int32_t>(links.revised_stage),
                  "revised_row"_a = ToArray<std::int32_t>(links.revised_row),
                  "revised_number"_a = ToArray<std::int32_t>(links.revised_number),
                  "revised_log_odds"_a = ToArray<double>(links.revised_log_odds));
}

py::tuple Fill(const Array<double>& position_mm, const Array<double>& cov_mm2,
               const FillOptions& options) {
  if (position_mm.ndim() != 3 || cov_mm2.size() != 3 * position_mm.size()) {
    throw std::invalid_argument("trajectories: expected position_mm (S, P, 3), cov (S, P, 3, 3)");
  }
  PointTable table;
  table.stages = static_cast<std::size_t>(position_mm.shape(0));
  table.points = static_cast<std::size_t>(position_mm.shape(1));
  table.position_mm = Positions(position_mm);
  table.cov_mm2 = Covariances(cov_mm2);
  for (const auto& x : table.position_mm) table.seen.push_back(std::isfinite(x[0]));
  std::vector<char> filled;
  {
    const py::gil_scoped_release release;
    filled = FillGaps(&table, options);
  }
  const py::ssize_t s = position_mm.shape(0), p = position_mm.shape(1);
  py::array_t<double> position({s, p, py::ssize_t{3}});
  py::array_t<double> cov({s, p, py::ssize_t{3}, py::ssize_t{3}});
  py::array_t<bool> mask({s, p});
  for (std::size_t i = 0; i < filled.size(); ++i) {
    Eigen::Map<Eigen::Vector3d>(position.mutable_data() + 3 * i) = table.position_mm[i];
    Eigen::Map<Eigen::Matrix3d>(cov.mutable_data() + 9 * i) = table.cov_mm2[i];
    mask.mutable_data()[i] = filled[i] != 0;
  }
  return py::make_tuple(position, cov, mask);
}

}  // namespace

void BindTracking(py::module_& parent) {
  py::module_ m = parent.def_submodule("tracking");
  py::class_<LinkOptions>(m, "LinkOptions")
      .def(py::init<>())
      .def_readwrite("gate_sigma", &LinkOptions::gate_sigma)
      .def_readwrite("max_share_of_spacing", &LinkOptions::max_share_of_spacing)
      .def_readwrite("neighbours", &LinkOptions::neighbours)
      .def_readwrite("min_log_odds", &LinkOptions::min_log_odds)
      .def_readwrite("window_stages", &LinkOptions::window_stages)
      .def_readwrite("max_gap_stages", &LinkOptions::max_gap_stages);
  py::class_<Tracker>(m, "Tracker")
      .def(py::init<int, const LinkOptions&>(), "first_free_id"_a, "options"_a)
      .def("add", &Add, "id"_a, "position_mm"_a, "cov_mm2"_a)
      .def("add_stages", &AddStages, "offsets"_a, "id"_a, "position_mm"_a, "cov_mm2"_a)
      .def_property_readonly("num_points", &Tracker::num_points);
  py::class_<FillOptions>(m, "FillOptions")
      .def(py::init<>())
      .def_readwrite("largest_gap", &FillOptions::largest_gap)
      .def_readwrite("neighbours", &FillOptions::neighbours);
  m.def("fill_gaps", &Fill, "position_mm"_a, "cov_mm2"_a, "options"_a);
}

}  // namespace videogrammetry::bindings
