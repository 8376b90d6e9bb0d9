#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <limits>
#include <memory>

#include "bindings.h"
#include "videogrammetry/adjustment/adjust.h"
#include "videogrammetry/adjustment/bundle.h"
#include "videogrammetry/adjustment/dispersion.h"
#include "videogrammetry/adjustment/dlt.h"
#include "videogrammetry/adjustment/focal_search.h"
#include "videogrammetry/adjustment/homography.h"
#include "videogrammetry/adjustment/network.h"
#include "videogrammetry/adjustment/relative_orientation.h"
#include "videogrammetry/adjustment/resection.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <int Columns>
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Columns, Eigen::RowMajor>;
using Indices = Eigen::Ref<const Eigen::VectorXi>;

int AddCamera(Network& n, const std::string& name, const Camera& camera, const CameraMask& free,
              const CameraVector& start, const CameraVector& prior_sigma, double floor_px,
              double aspect, double time_offset, bool corrected_residual) {
  NetworkCamera c{name, camera, free, prior_sigma, start, floor_px};
  c.aspect = aspect;
  c.time_offset = time_offset;
  c.corrected_residual = corrected_residual;
  n.cameras.push_back(c);
  return static_cast<int>(n.cameras.size()) - 1;
}

int AddInterface(Network& n, const std::string& name, const FlatInterface& nominal,
                 const std::array<bool, kNumInterfaceUnknowns>& free,
                 const Eigen::Vector3d& prior_sigma) {
  NetworkInterface window{name, nominal, free, prior_sigma};
  window.distance_mm = nominal.distance_mm;
  n.interfaces.push_back(window);
  return static_cast<int>(n.interfaces.size()) - 1;
}

int AddPose(Network& n, const std::string& name, const Eigen::Matrix3d& rotation,
            const Eigen::Vector3d& translation_mm, bool free) {
  n.poses.push_back({name, {rotation, translation_mm}, free});
  return static_cast<int>(n.poses.size()) - 1;
}

int AddImage(Network& n, const std::string& name, int camera, int outer, int inner) {
  n.images.push_back({name, camera, outer, inner});
  return static_cast<int>(n.images.size()) - 1;
}

/// cov_mm2 (N, 9), row by row, of the weighted points; no rows: no priors.
void SetPoints(Network& n, const Indices& id, const Eigen::Ref<const Rows<3>>& position_mm,
               const Eigen::Ref<const Rows<9>>& cov_mm2, const std::vector<PointKind>& kind) {
  n.points.clear();
  n.prior_block = {};
  for (Eigen::Index i = 0; i < id.size(); ++i) {
    NetworkPoint p{id[i], position_mm.row(i).transpose(), kind.at(static_cast<std::size_t>(i)),
                   position_mm.row(i).transpose()};
    if (cov_mm2.rows() > 0 && p.kind == PointKind::kWeighted) {
      p.prior_cov_mm2 =
          Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(cov_mm2.row(i).data());
    }
    n.points.push_back(p);
  }
}

void SetScaleBars(Network& n, const Indices& a, const Indices& b,
                  const Eigen::Ref<const Eigen::VectorXd>& length_mm,
                  const Eigen::Ref<const Eigen::VectorXd>& sigma_mm) {
  n.scale_bars.clear();
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    n.scale_bars.push_back({a[i], b[i], length_mm[i], sigma_mm[i]});
  }
}

/// normal (N, 3) in the object's frame, radius_mm (N); radius 0 = no circle.
void SetCircles(Network& n, const Eigen::Ref<const Rows<3>>& normal,
                const Eigen::Ref<const Eigen::VectorXd>& radius_mm) {
  if (normal.rows() != static_cast<Eigen::Index>(n.points.size()) ||
      radius_mm.size() != normal.rows()) {
    throw std::invalid_argument("circles: expected normal (N, 3) and radius_mm (N) for " +
                                std::to_string(n.points.size()) + " points");
  }
  for (Eigen::Index i = 0; i < radius_mm.size(); ++i) {
    NetworkPoint& p = n.points[static_cast<std::size_t>(i)];
    p.normal = normal.row(i).transpose();
    p.radius_mm = radius_mm[i];
    if (p.radius_mm != 0) p.mark().Check(("circle of point " + std::to_string(p.id)).c_str());
  }
}

void SetObservations(Network& n, const Indices& image, const Indices& point,
                     const Eigen::Ref<const Rows<2>>& xy_px,
                     const Eigen::Ref<const Rows<3>>& cov_px2, const std::vector<bool>& used,
                     const Eigen::Ref<const Rows<2>>& velocity_px) {
  n.observations.clear();
  for (Eigen::Index i = 0; i < image.size(); ++i) {
    Eigen::Matrix2d cov;
    cov << cov_px2(i, 0), cov_px2(i, 1), cov_px2(i, 1), cov_px2(i, 2);
    n.observations.push_back({image[i], point[i], xy_px.row(i).transpose(), cov,
                              used[static_cast<std::size_t>(i)], velocity_px.row(i).transpose()});
  }
}

std::vector<bool> Used(const Network& n) {
  std::vector<bool> used;
  for (const NetworkObservation& o : n.observations) used.push_back(o.used);
  return used;
}

Rows<3> Positions(const Network& n) {
  Rows<3> positions(static_cast<Eigen::Index>(n.points.size()), 3);
  for (std::size_t i = 0; i < n.points.size(); ++i) {
    positions.row(static_cast<Eigen::Index>(i)) = n.points[i].position_mm.transpose();
  }
  return positions;
}

py::dict StatisticsArrays(const std::vector<ObservationStatistics>& statistics) {
  const Eigen::Index n = static_cast<Eigen::Index>(statistics.size());
  Rows<2> residual(n, 2), normalised(n, 2), redundancy(n, 2);
  std::vector<bool> valid;
  for (Eigen::Index i = 0; i < n; ++i) {
    const ObservationStatistics& s = statistics[static_cast<std::size_t>(i)];
    residual.row(i) = s.residual_px.transpose();
    normalised.row(i) = s.normalised.transpose();
    redundancy.row(i) = s.redundancy.transpose();
    valid.push_back(s.valid);
  }
  return py::dict("residual_px"_a = residual, "normalised"_a = normalised,
                  "redundancy"_a = redundancy, "valid"_a = valid);
}

py::dict BarArrays(const AdjustResult& r) {
  const Eigen::Index n = static_cast<Eigen::Index>(r.bars.size());
  Eigen::VectorXd residual(n), normalised(n), redundancy(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const BarStatistics& s = r.bars[static_cast<std::size_t>(i)];
    residual[i] = s.residual_mm;
    normalised[i] = s.normalised;
    redundancy[i] = s.redundancy;
  }
  return py::dict("residual_mm"_a = residual, "normalised"_a = normalised,
                  "redundancy"_a = redundancy);
}

py::dict PointArrays(const AdjustResult& r) {
  const Eigen::Index n = static_cast<Eigen::Index>(r.points.size());
  Rows<3> residual(n, 3), normalised(n, 3);
  Eigen::VectorXd test(n), redundancy(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const PointStatistics& s = r.points[static_cast<std::size_t>(i)];
    residual.row(i) = s.residual_mm.transpose();
    normalised.row(i) = s.normalised.transpose();
    test[i] = s.test;
    redundancy[i] = s.redundancy;
  }
  return py::dict("residual_mm"_a = residual, "normalised"_a = normalised, "test"_a = test,
                  "redundancy"_a = redundancy);
}

/// Per point or bar, what `get` says of it.
template <typename Item, typename Get>
std::vector<bool> Flags(const std::vector<Item>& items, const Get& get) {
  std::vector<bool> flags;
  for (const Item& item : items) flags.push_back(get(item));
  return flags;
}

/// Covariances of the points, (N, 9) row by row.
Rows<9> PointCovariances(const Dispersion& dispersion) {
  Rows<9> cov(static_cast<Eigen::Index>(dispersion.index().point.size()), 9);
  for (Eigen::Index i = 0; i < cov.rows(); ++i) {
    const Eigen::Matrix3d c = dispersion.CovPoint(static_cast<int>(i));
    cov.row(i) = Eigen::Map<const Eigen::Matrix<double, 1, 9>>(c.data());
  }
  return cov;
}

/// Predicted pictures (N, 2) and covariances (N, 3); NaN where there is none.
py::tuple PredictMany(const Dispersion& dispersion, const Indices& image, const Indices& point) {
  Rows<2> xy = Rows<2>::Constant(image.size(), 2, std::numeric_limits<double>::quiet_NaN());
  Rows<3> cov = Rows<3>::Constant(image.size(), 3, std::numeric_limits<double>::quiet_NaN());
  for (Eigen::Index i = 0; i < image.size(); ++i) {
    const auto p = dispersion.Predict(image[i], point[i]);
    if (!p) continue;
    xy.row(i) = p->pixel.transpose();
    cov.row(i) << p->cov_px2(0, 0), p->cov_px2(0, 1), p->cov_px2(1, 1);
  }
  return py::make_tuple(xy, cov);
}

void BindNetwork(py::module_& m) {
  py::enum_<PointKind>(m, "PointKind")
      .value("FIXED", PointKind::kFixed)
      .value("WEIGHTED", PointKind::kWeighted)
      .value("FREE", PointKind::kFree);
  py::enum_<Datum>(m, "Datum")
      .value("FIXED", Datum::kFixed)
      .value("WEIGHTED", Datum::kWeighted)
      .value("FREE", Datum::kFree);
  py::class_<Network>(m, "Network")
      .def(py::init<>())
      .def("add_camera", &AddCamera, "name"_a, "camera"_a, "free"_a, "start"_a, "prior_sigma"_a,
           "floor_px"_a, "aspect"_a, "time_offset"_a, "corrected_residual"_a)
      .def("add_interface", &AddInterface, "name"_a, "nominal"_a, "free"_a, "prior_sigma"_a)
      .def("set_interface",
           [](Network& n, int camera, int interface) {
             n.cameras.at(static_cast<std::size_t>(camera)).interface = interface;
           })
      .def("interface",
           [](const Network& n, int i) {
             return n.interfaces.at(static_cast<std::size_t>(i)).surface();
           })
      .def("interface_values",
           [](const Network& n, int i) {
             return n.interfaces.at(static_cast<std::size_t>(i)).values();
           })
      .def("interface_tangents",
           [](const Network& n, int i) {
             return n.interfaces.at(static_cast<std::size_t>(i)).Tangents();
           })
      .def("add_pose", &AddPose, "name"_a, "rotation"_a, "translation_mm"_a, "free"_a)
      .def("add_image", &AddImage, "name"_a, "camera"_a, "outer"_a, "inner"_a)
      .def("set_points", &SetPoints, "id"_a, "position_mm"_a, "cov_mm2"_a, "kind"_a)
      .def("set_circles", &SetCircles, "normal"_a, "radius_mm"_a)
      .def("set_observations", &SetObservations, "image"_a, "point"_a, "xy_px"_a, "cov_px2"_a,
           "used"_a, "velocity_px"_a)
      .def("set_point_prior", &Network::SetPriorBlock, "rows"_a, "mean_mm"_a, "cov_mm2"_a,
           py::call_guard<py::gil_scoped_release>())
      .def("set_scale_bars", &SetScaleBars, "a"_a, "b"_a, "length_mm"_a, "sigma_mm"_a)
      .def("set_datum", [](Network& n, Datum datum) { n.datum = datum; })
      .def("set_pose",
           [](Network& n, int i, const Eigen::Matrix3d& rotation, const Eigen::Vector3d& t) {
             n.poses.at(static_cast<std::size_t>(i)).transform = {rotation, t};
           })
      .def("set_free",
           [](Network& n, int i, const CameraMask& free) {
             n.cameras.at(static_cast<std::size_t>(i)).free = free;
           })
      .def("camera",
           [](const Network& n, int i) { return n.cameras.at(static_cast<std::size_t>(i)).camera; })
      .def("camera_values",
           [](const Network& n, int i) {
             return n.cameras.at(static_cast<std::size_t>(i)).values();
           })
      .def("free",
           [](const Network& n, int i) { return n.cameras.at(static_cast<std::size_t>(i)).free; })
      .def("floor_px", [](const Network& n,
                          int i) { return n.cameras.at(static_cast<std::size_t>(i)).floor_px; })
      .def("cov_scale", [](const Network& n,
                           int i) { return n.cameras.at(static_cast<std::size_t>(i)).cov_scale; })
      .def("pose",
           [](const Network& n, int i) {
             const Rigid3& t = n.poses.at(static_cast<std::size_t>(i)).transform;
             return py::make_tuple(t.rotation, t.translation_mm);
           })
      .def_property_readonly("num_poses", [](const Network& n) { return n.poses.size(); })
      .def_property_readonly("positions_mm", &Positions)
      .def_property_readonly("used", &Used)
      .def_property_readonly("bars_used",
                             [](const Network& n) {
                               return Flags(n.scale_bars,
                                            [](const NetworkScaleBar& b) { return b.used; });
                             })
      .def_property_readonly("priors_used",
                             [](const Network& n) {
                               return Flags(n.points,
                                            [](const NetworkPoint& p) { return p.is_observed(); });
                             })
      .def_property_readonly("starved", [](const Network& n) {
        return Flags(n.points, [](const NetworkPoint& p) { return p.starved; });
      });
}

void BindAdjust(py::module_& m) {
  py::class_<AdjustOptions>(m, "AdjustOptions")
      .def(py::init<>())
      .def_readwrite("critical_value", &AdjustOptions::critical_value)
      .def_readwrite("estimate_floor", &AdjustOptions::estimate_floor)
      .def_readwrite("robust_start", &AdjustOptions::robust_start)
      .def_readwrite("significance", &AdjustOptions::significance)
      .def_readwrite("offered", &AdjustOptions::offered)
      .def_readwrite("baarda", &AdjustOptions::baarda)
      .def_readwrite("max_rounds", &AdjustOptions::max_rounds)
      .def_readwrite("num_threads", &AdjustOptions::num_threads);
  py::class_<CameraVariance>(m, "CameraVariance")
      .def_readonly("factor", &CameraVariance::factor)
      .def_readonly("redundancy", &CameraVariance::redundancy)
      .def_readonly("rms_px", &CameraVariance::rms_px)
      .def_readonly("count", &CameraVariance::count);
  py::class_<DroppedParameter>(m, "DroppedParameter")
      .def_readonly("camera", &DroppedParameter::camera)
      .def_readonly("parameter", &DroppedParameter::parameter)
      .def_readonly("value", &DroppedParameter::value)
      .def_readonly("sigma", &DroppedParameter::sigma)
      .def_readonly("undetermined", &DroppedParameter::undetermined);
  py::class_<AdjustResult>(m, "AdjustResult")
      .def_readonly("converged", &AdjustResult::converged)
      .def_readonly("message", &AdjustResult::message)
      .def_readonly("sigma0", &AdjustResult::sigma0)
      .def_readonly("num_observations", &AdjustResult::num_observations)
      .def_readonly("num_prior", &AdjustResult::num_prior)
      .def_readonly("num_unknowns", &AdjustResult::num_unknowns)
      .def_readonly("redundancy", &AdjustResult::redundancy)
      .def_readonly("point_factor", &AdjustResult::point_factor)
      .def_readonly("point_redundancy", &AdjustResult::point_redundancy)
      .def_readonly("bar_factor", &AdjustResult::bar_factor)
      .def_readonly("bar_redundancy", &AdjustResult::bar_redundancy)
      .def_property_readonly("bars", &BarArrays)
      .def_property_readonly("points", &PointArrays)
      .def_readonly("cameras", &AdjustResult::cameras)
      .def_readonly("dropped", &AdjustResult::dropped)
      .def_readonly("rounds", &AdjustResult::rounds)
      .def_property_readonly("statistics",
                             [](const AdjustResult& r) { return StatisticsArrays(r.statistics); });
  m.def("adjust", &Adjust, "network"_a, "options"_a, py::call_guard<py::gil_scoped_release>());
  const auto release = py::call_guard<py::gil_scoped_release>();
  py::class_<Dispersion>(m, "Dispersion")
      .def(py::init([](const Network& n, int num_threads) {
             return std::make_unique<Dispersion>(n, Elimination::What::kSmallest, num_threads);
           }),
           "network"_a, "num_threads"_a, py::keep_alive<1, 2>(), release)
      .def("cov_orientation", &Dispersion::CovOrientation, release)
      .def("covariance", &Dispersion::Covariance, "a"_a, "b"_a, release)
      .def("point_covariance", &Dispersion::CovPoints, "rows"_a, release)
      .def("names",
           [](const Dispersion& d, const Network& n) { return UnknownNames(n, d.index()); })
      .def_property_readonly("camera_index", [](const Dispersion& d) { return d.index().camera; })
      .def_property_readonly("pose_index", [](const Dispersion& d) { return d.index().pose; })
      .def_property_readonly("interface_index",
                             [](const Dispersion& d) { return d.index().interface; })
      .def_property_readonly("point_index", [](const Dispersion& d) { return d.index().point; })
      .def_property_readonly("redundancy", &Dispersion::redundancy)
      .def_property_readonly("num_reduced", &Dispersion::num_reduced)
      .def_property_readonly("datum_size", &Dispersion::datum_size)
      .def("full_covariance", &Dispersion::FullCovariance, "num_threads"_a, release)
      .def("statistics", [](const Dispersion& d) { return StatisticsArrays(d.Statistics()); })
      .def("predict", &PredictMany, "image"_a, "point"_a);
  m.def("point_covariances", &PointCovariances, "dispersion"_a);
}

/// Candidates (rotation, direction, cost, inlier, convergence), rotation, parallax, has_baseline.
py::tuple RelativeOrientationTuple(const Camera& camera_a, const Eigen::Ref<const Rows<2>>& a,
                                   const Camera& camera_b, const Eigen::Ref<const Rows<2>>& b,
                                   double threshold_px, int max_samples, std::uint32_t seed) {
  RelativeOrientation found;
  {
    const py::gil_scoped_release release;
    found = OrientRelatively(camera_a, a, camera_b, b, {threshold_px, max_samples, seed});
  }
  py::list candidates;
  for (const RelativePose& c : found.candidates) {
    candidates.append(py::make_tuple(c.b_from_a.rotation, c.b_from_a.translation_mm, c.cost_px2,
                                     c.inlier, c.convergence_rad));
  }
  return py::make_tuple(candidates, found.rotation, found.parallax, found.has_baseline);
}

void BindStart(py::module_& m) {
  m.def("relative_orientation", &RelativeOrientationTuple, "camera_a"_a, "pixels_a"_a, "camera_b"_a,
        "pixels_b"_a, "threshold_px"_a, "max_samples"_a, "seed"_a);
  m.def(
      "robust_bundle",
      [](Network& network, double cauchy_scale, int max_iterations) {
        BundleOptions options;
        options.cauchy_scale = cauchy_scale;
        options.max_iterations = max_iterations;
        options.near_solution = false;
        options.function_tolerance = 1e-6;  // what it is for begins anew with other weights
        return SolveBundle(&network, options).converged;
      },
      "network"_a, "cauchy_scale"_a, "max_iterations"_a, py::call_guard<py::gil_scoped_release>());
  m.def(
      "dlt",
      [](const Eigen::Ref<const Rows<3>>& points_mm, const Eigen::Ref<const Rows<2>>& pixels) {
        const DltResult r = DirectLinearTransform(points_mm, pixels);
        return py::make_tuple(r.calibration, r.cam_from_object.rotation,
                              r.cam_from_object.translation_mm, r.rms_px);
      },
      "points_mm"_a, "pixels"_a);
  m.def(
      "resect",
      [](const Camera& camera, const Eigen::Ref<const Rows<3>>& points_mm,
         const Eigen::Ref<const Rows<2>>& pixels, double threshold_px, int num_samples) {
        std::vector<PoseCandidate> found;
        {
          const py::gil_scoped_release release;
          found = Resect(camera, points_mm, pixels, {threshold_px, num_samples});
        }
        py::list result;
        for (const PoseCandidate& c : found) {
          result.append(py::make_tuple(c.cam_from_object.rotation, c.cam_from_object.translation_mm,
                                       c.cost_px2, c.inliers));
        }
        return result;
      },
      "camera"_a, "points_mm"_a, "pixels"_a, "threshold_px"_a, "num_samples"_a);
  m.def(
      "search_focal",
      [](const Camera& camera, const std::vector<Rows<3>>& points_mm,
         const std::vector<Rows<2>>& pixels, double threshold_px) {
        std::vector<ResectionView> views;
        for (std::size_t i = 0; i < points_mm.size(); ++i) {
          views.push_back({points_mm[i], pixels.at(i)});
        }
        FocalSearchResult r;
        {
          const py::gil_scoped_release release;
          r = SearchFocal(camera, views, threshold_px);
        }
        return py::make_tuple(r.f_px, r.rms_px, r.contrast);
      },
      "camera"_a, "points_mm"_a, "pixels"_a, "threshold_px"_a);
  m.def(
      "plane_homography",
      [](const Eigen::Ref<const Rows<2>>& plane_mm, const Eigen::Ref<const Rows<2>>& pixels) {
        return FitHomography(plane_mm, pixels);
      },
      "plane_mm"_a, "pixels"_a);
  m.def("principal_extents",
        [](const Eigen::Ref<const Rows<3>>& points_mm) { return PrincipalExtents(points_mm); });
}

}  // namespace

void BindAdjustment(py::module_& parent) {
  py::module_ m = parent.def_submodule("adjustment");
  BindNetwork(m);
  BindAdjust(m);
  BindStart(m);
}

}  // namespace videogrammetry::bindings
