#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>

#include "bindings.h"
#include "videogrammetry/matching/match.h"
#include "videogrammetry/matching/stages.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;

CameraTargets MakeTargets(const Array<double>& xy_px, const Array<double>& cov_px2,
                          const Array<std::int32_t>& id, const Array<double>& semi_major_px) {
  const auto n = static_cast<std::size_t>(id.size());
  if (static_cast<std::size_t>(xy_px.size()) != 2 * n ||
      static_cast<std::size_t>(cov_px2.size()) != 3 * n ||
      static_cast<std::size_t>(semi_major_px.size()) != n) {
    throw std::invalid_argument(
        "targets: expected xy_px (N, 2), cov_px2 (N, 3), id (N), semi_major_px (N)");
  }
  CameraTargets targets;
  targets.xy_px.resize(n);
  targets.cov_px2.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    targets.xy_px[i] = {xy_px.data()[2 * i], xy_px.data()[2 * i + 1]};
    const double* c = cov_px2.data() + 3 * i;
    targets.cov_px2[i] << c[0], c[1], c[1], c[2];
  }
  targets.id.assign(id.data(), id.data() + n);
  targets.semi_major_px.assign(semi_major_px.data(), semi_major_px.data() + n);
  return targets;
}

py::dict ToDict(const MatchResult& result, std::size_t cameras) {
  const auto p = static_cast<py::ssize_t>(result.matches.size());
  const auto c = static_cast<py::ssize_t>(cameras);
  py::array_t<std::int32_t> target({p, c});
  py::array_t<std::int32_t> id(p);
  py::array_t<double> chi2(p), log_odds(p), false_probability(p);
  for (py::ssize_t i = 0; i < p; ++i) {
    const Match& match = result.matches[static_cast<std::size_t>(i)];
    for (py::ssize_t k = 0; k < c; ++k) {
      target.mutable_at(i, k) = match.target[static_cast<std::size_t>(k)];
    }
    id.mutable_at(i) = match.id;
    chi2.mutable_at(i) = match.chi2;
    log_odds.mutable_at(i) = match.log_odds;
    false_probability.mutable_at(i) = match.false_probability;
  }
  py::list status;
  for (const auto& camera : result.status) {
    py::array_t<std::uint8_t> values(static_cast<py::ssize_t>(camera.size()));
    for (std::size_t i = 0; i < camera.size(); ++i) {
      values.mutable_at(static_cast<py::ssize_t>(i)) = static_cast<std::uint8_t>(camera[i]);
    }
    status.append(values);
  }
  return py::dict("target"_a = target, "id"_a = id, "chi2"_a = chi2, "log_odds"_a = log_odds,
                  "false_probability"_a = false_probability, "status"_a = status);
}

template <typename To, typename From>
py::array_t<To> Copied(const std::vector<From>& values) {
  py::array_t<To> array(static_cast<py::ssize_t>(values.size()));
  std::transform(values.begin(), values.end(), array.mutable_data(),
                 [](const From& v) { return static_cast<To>(v); });
  return array;
}

py::dict ToDict(const StageMatches& result, std::size_t cameras) {
  py::list status;
  for (const auto& camera : result.status) status.append(Copied<std::uint8_t>(camera));
  return py::dict("offsets"_a = Copied<std::int64_t>(result.offsets),
                  "target"_a = Copied<std::int32_t>(result.target)
                                   .reshape({static_cast<py::ssize_t>(result.id.size()),
                                             static_cast<py::ssize_t>(cameras)}),
                  "id"_a = Copied<std::int32_t>(result.id), "chi2"_a = Copied<double>(result.chi2),
                  "log_odds"_a = Copied<double>(result.log_odds),
                  "false_probability"_a = Copied<double>(result.false_probability),
                  "status"_a = status);
}

// (N, 2) camera and target.
std::vector<ViewTarget> MakeViewTargets(const Array<std::int32_t>& rows) {
  if (rows.size() % 2 != 0) throw std::invalid_argument("edits: expected rows (camera, target)");
  std::vector<ViewTarget> set;
  for (py::ssize_t i = 0; i < rows.size(); i += 2)
    set.push_back({rows.data()[i], rows.data()[i + 1]});
  return set;
}

}  // namespace

void BindMatching(py::module_& parent) {
  py::module_ m = parent.def_submodule("matching");
  py::class_<CameraTargets>(m, "CameraTargets")
      .def(py::init(&MakeTargets), "xy_px"_a, "cov_px2"_a, "id"_a, "semi_major_px"_a);
  py::class_<MatchingOptions>(m, "MatchingOptions")
      .def(py::init<>())
      .def_readwrite("critical_value", &MatchingOptions::critical_value)
      .def_readwrite("max_size_ratio", &MatchingOptions::max_size_ratio)
      .def_readwrite("min_log_odds", &MatchingOptions::min_log_odds)
      .def_readwrite("neighbours", &MatchingOptions::neighbours)
      .def_readwrite("min_distance_mm", &MatchingOptions::min_distance_mm)
      .def_readwrite("max_distance_mm", &MatchingOptions::max_distance_mm)
      .def_readwrite("num_threads", &MatchingOptions::num_threads);
  py::class_<MatchEdits>(m, "MatchEdits")
      .def(py::init<>())
      .def(
          "put_together",
          [](MatchEdits& edits, const Array<std::int32_t>& targets) {
            edits.together.push_back(MakeViewTargets(targets));
          },
          "targets"_a)
      .def(
          "keep_apart",
          [](MatchEdits& edits, const Array<std::int32_t>& targets) {
            const std::vector<ViewTarget> pair = MakeViewTargets(targets);
            if (pair.size() != 2) {
              throw std::invalid_argument("edits: apart expects two targets, got " +
                                          std::to_string(pair.size()));
            }
            edits.apart.emplace_back(pair[0], pair[1]);
          },
          "targets"_a);
  py::class_<FlatTargets>(m, "FlatTargets")
      .def(py::init([](const Array<std::int64_t>& offsets, const CameraTargets& targets) {
             FlatTargets flat;
             for (py::ssize_t i = 0; i < offsets.size(); ++i) {
               if (offsets.data()[i] < 0) {
                 throw std::invalid_argument("offsets: expected to rise from 0, got " +
                                             std::to_string(offsets.data()[i]));
               }
               flat.offsets.push_back(static_cast<std::size_t>(offsets.data()[i]));
             }
             flat.targets = targets;
             return flat;
           }),
           "offsets"_a, "targets"_a);
  m.def(
      "match_stages",
      [](const Rig& rig, const std::vector<FlatTargets>& cameras, const MatchingOptions& options,
         const std::map<std::size_t, MatchEdits>& edits) {
        StageMatches result;
        {
          const py::gil_scoped_release release;
          result = MatchStages(rig, cameras, options, edits);
        }
        return ToDict(result, rig.size());
      },
      "rig"_a, "cameras"_a, "options"_a, "edits"_a);
  m.def(
      "match_stage",
      [](const Rig& rig, const std::vector<CameraTargets>& cameras, const MatchingOptions& options,
         const MatchEdits& edits) {
        MatchResult result;
        {
          const py::gil_scoped_release release;
          result = MatchStage(rig, cameras, options, edits);
        }
        return ToDict(result, rig.size());
      },
      "rig"_a, "cameras"_a, "options"_a, "edits"_a = MatchEdits{});
}

}  // namespace videogrammetry::bindings
