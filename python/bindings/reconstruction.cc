#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <string>

#include "bindings.h"
#include "videogrammetry/reconstruction/bilinear.h"
#include "videogrammetry/reconstruction/pose_scores.h"
#include "videogrammetry/reconstruction/triangulate.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;

template <typename T>
py::array_t<T> Shaped(const std::vector<T>& values, std::vector<py::ssize_t> shape) {
  py::array_t<T> array(std::move(shape));
  std::copy(values.begin(), values.end(), array.mutable_data());
  return array;
}

MatchArrays ViewOf(const Array<std::int64_t>& offsets, const Array<std::int32_t>& camera,
                   const Array<double>& xy_px, const Array<double>& cov_px2) {
  if (xy_px.size() != 2 * camera.size() || cov_px2.size() != 3 * camera.size()) {
    throw std::invalid_argument("xy_px: expected (M, 2), cov_px2: (M, 3) for M cameras");
  }
  return {{offsets.data(), static_cast<std::size_t>(offsets.size())},
          {camera.data(), static_cast<std::size_t>(camera.size())},
          xy_px.data(),
          cov_px2.data()};
}

/// The data of an array of `count` rows of `columns`, null where it has no rows.
const double* RowsOrNull(const Array<double>& array, py::ssize_t count, py::ssize_t columns,
                         const char* name) {
  if (array.size() == 0) return nullptr;
  if (array.size() != count * columns) {
    throw std::invalid_argument(std::string(name) + ": expected (" + std::to_string(count) + ", " +
                                std::to_string(columns) + ")");
  }
  return array.data();
}

py::dict TriangulateArrays(const Rig& rig, const Array<std::int64_t>& offsets,
                           const Array<std::int32_t>& camera, const Array<double>& xy_px,
                           const Array<double>& cov_px2, const Eigen::MatrixXd& cov_rig,
                           const Eigen::MatrixXd& frame_by_parameters, int num_threads,
                           const Array<double>& diameter_mm, const Array<double>& ellipse,
                           const Array<double>& ellipse_cov, const Array<double>& normal,
                           const Array<double>& normal_cov, double thickness_mm) {
  const MatchArrays matches = ViewOf(offsets, camera, xy_px, cov_px2);
  const auto p = std::max<py::ssize_t>(offsets.size() - 1, 0);
  const auto m = static_cast<py::ssize_t>(camera.size());
  const CircleArrays circles = {
      RowsOrNull(diameter_mm, p, 1, "diameter_mm"), RowsOrNull(ellipse, m, 3, "ellipse"),
      RowsOrNull(ellipse_cov, m, 9, "ellipse_cov"), RowsOrNull(normal, p, 3, "normal"),
      RowsOrNull(normal_cov, p, 9, "normal_cov"),   thickness_mm};
  TriangulatedPoints points;
  {
    const py::gil_scoped_release release;
    points = Triangulate(rig, matches, {cov_rig, frame_by_parameters}, {num_threads}, circles);
  }
  py::dict result("position_mm"_a = Shaped(points.position_mm, {p, 3}),
                  "cov_image_mm2"_a = Shaped(points.cov_image, {p, 3, 3}),
                  "cov_rig_mm2"_a = Shaped(points.cov_rig, {p, 3, 3}),
                  "chi2"_a = Shaped(points.chi2, {p}),
                  "convergence_rad"_a = Shaped(points.convergence_rad, {p}),
                  "residual_px"_a = Shaped(points.residual_px, {m, 2}),
                  "status"_a = Shaped(points.status, {p}));
  if (!circles.empty()) {
    result["normal"] = Shaped(points.normal, {p, 3});
    result["cov_normal"] = Shaped(points.cov_normal, {p, 3, 3});
    result["offset_px"] = Shaped(points.offset_px, {m, 2});
    result["circle"] = Shaped(points.circle, {p});
  }
  return result;
}

py::array_t<double> PointDerivativeArray(const Rig& rig, const Array<std::int64_t>& offsets,
                                         const Array<std::int32_t>& camera,
                                         const Array<double>& cov_px2,
                                         const Array<double>& position_mm,
                                         const Eigen::MatrixXd& frame_by_parameters,
                                         int num_threads) {
  if (cov_px2.size() != 3 * camera.size()) {
    throw std::invalid_argument("cov_px2: expected (M, 3) for M cameras");
  }
  const MatchArrays matches = {{offsets.data(), static_cast<std::size_t>(offsets.size())},
                               {camera.data(), static_cast<std::size_t>(camera.size())},
                               nullptr,
                               cov_px2.data()};
  std::vector<double> derivatives;
  {
    const py::gil_scoped_release release;
    derivatives = PointDerivatives(
        rig, matches, {position_mm.data(), static_cast<std::size_t>(position_mm.size())},
        frame_by_parameters, {num_threads});
  }
  return Shaped(derivatives, {offsets.size() - 1, 3,
                              static_cast<py::ssize_t>(rig.size()) * kNumCameraParameters});
}

py::dict PoseScoreArrays(const Rig& rig, const Array<std::int64_t>& offsets,
                         const Array<double>& position_mm, const Array<double>& residual_px,
                         const Array<double>& variance_px2, const Array<double>& cov_mm2,
                         const Array<double>& factor) {
  const auto c = static_cast<py::ssize_t>(rig.size());
  const auto k = std::max<py::ssize_t>(offsets.size() - 1, 0);
  const py::ssize_t p = offsets.size() > 0 ? offsets.at(k) : 0;
  if (position_mm.size() != 3 * p || residual_px.size() != 2 * p * c ||
      variance_px2.size() != 2 * p * c) {
    throw std::invalid_argument(
        "position_mm: expected (P, 3), residual_px and variance_px2: (P, C, 2) for "
        "offsets (K + 1,) up to P");
  }
  const py::ssize_t rank = factor.ndim() == 2 ? factor.shape(1) : 0;
  if (factor.size() != kNumCameraParameters * c * rank) {
    throw std::invalid_argument("factor: expected (16 C, R)");
  }
  const LookResiduals residuals = {{offsets.data(), static_cast<std::size_t>(offsets.size())},
                                   position_mm.data(),
                                   residual_px.data(),
                                   variance_px2.data(),
                                   RowsOrNull(cov_mm2, p, 9, "cov_mm2"),
                                   factor.data(),
                                   static_cast<std::size_t>(rank)};
  PoseScores scores;
  {
    const py::gil_scoped_release release;
    scores = SumPoseScores(rig, residuals);
  }
  return py::dict("normal"_a = Shaped(scores.normal, {k, 6 * c, 6 * c}),
                  "score"_a = Shaped(scores.score, {k, 6 * c}),
                  "chi2"_a = Shaped(scores.chi2, {k, c}),
                  "by_calibration"_a = Shaped(scores.by_calibration, {k, 6 * c, rank}));
}

py::array_t<double> BilinearArray(const Array<double>& nodes, double width_px, double height_px,
                                  const Array<double>& xy_px) {
  if (nodes.ndim() != 3) throw std::invalid_argument("nodes: expected (rows, columns, 3)");
  const PictureNodes grid = {{nodes.data(), static_cast<std::size_t>(nodes.size())},
                             static_cast<int>(nodes.shape(1)),
                             static_cast<int>(nodes.shape(0)),
                             width_px,
                             height_px};
  std::vector<double> values;
  {
    const py::gil_scoped_release release;
    values = Bilinear(grid, {xy_px.data(), static_cast<std::size_t>(xy_px.size())});
  }
  return Shaped(values, {xy_px.size() / 2, 3});
}

}  // namespace

void BindReconstruction(py::module_& parent) {
  py::module_ m = parent.def_submodule("reconstruction");
  m.def("triangulate", &TriangulateArrays, "rig"_a, "offsets"_a.noconvert(), "camera"_a.noconvert(),
        "xy_px"_a.noconvert(), "cov_px2"_a.noconvert(), "cov_rig"_a, "frame_by_parameters"_a,
        "num_threads"_a, "diameter_mm"_a.noconvert(), "ellipse"_a.noconvert(),
        "ellipse_cov"_a.noconvert(), "normal"_a.noconvert(), "normal_cov"_a.noconvert(),
        "thickness_mm"_a);
  m.def("bilinear", &BilinearArray, "nodes"_a.noconvert(), "width_px"_a, "height_px"_a,
        "xy_px"_a.noconvert());
  m.def("point_derivatives", &PointDerivativeArray, "rig"_a, "offsets"_a.noconvert(),
        "camera"_a.noconvert(), "cov_px2"_a.noconvert(), "position_mm"_a.noconvert(),
        "frame_by_parameters"_a, "num_threads"_a);
  m.def("pose_scores", &PoseScoreArrays, "rig"_a, "offsets"_a.noconvert(),
        "position_mm"_a.noconvert(), "residual_px"_a.noconvert(), "variance_px2"_a.noconvert(),
        "cov_mm2"_a.noconvert(), "factor"_a.noconvert());
  m.def(
      "shared_frame_motion",
      [](const Rig& rig, const Array<std::int64_t>& offsets, const Array<std::int32_t>& camera,
         const Array<double>& xy_px, const Array<double>& cov_px2) {
        return SharedFrameMotion(rig, ViewOf(offsets, camera, xy_px, cov_px2));
      },
      "rig"_a, "offsets"_a.noconvert(), "camera"_a.noconvert(), "xy_px"_a.noconvert(),
      "cov_px2"_a.noconvert());
}

}  // namespace videogrammetry::bindings
