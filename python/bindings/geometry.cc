#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "bindings.h"
#include "videogrammetry/geometry/camera.h"
#include "videogrammetry/geometry/circle.h"
#include "videogrammetry/geometry/circle_normal.h"
#include "videogrammetry/geometry/conic.h"
#include "videogrammetry/geometry/half_spaces.h"
#include "videogrammetry/geometry/remap.h"
#include "videogrammetry/geometry/rig.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <int Columns>
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Columns, Eigen::RowMajor>;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Rows<2> ProjectPoints(const Camera& camera, const Eigen::Ref<const Rows<3>>& points_in_cam) {
  Rows<2> pixels(points_in_cam.rows(), 2);
  for (Eigen::Index i = 0; i < points_in_cam.rows(); ++i) {
    const auto pixel = Project(camera, points_in_cam.row(i).transpose());
    pixels.row(i) = pixel ? pixel->transpose() : Eigen::RowVector2d(kNan, kNan);
  }
  return pixels;
}

py::tuple ProjectWithJacobians(const Camera& camera,
                               const Eigen::Ref<const Rows<3>>& points_in_cam) {
  const Eigen::Index n = points_in_cam.rows();
  Rows<2> pixels(n, 2);
  py::array_t<double> by_point({n, Eigen::Index{2}, Eigen::Index{3}});
  py::array_t<double> by_interior({n, Eigen::Index{2}, Eigen::Index{kNumInterior}});
  auto point_view = by_point.mutable_unchecked<3>();
  auto interior_view = by_interior.mutable_unchecked<3>();
  for (Eigen::Index i = 0; i < n; ++i) {
    ProjectionJacobians jacobians;
    const auto pixel = Project(camera, points_in_cam.row(i).transpose(), &jacobians);
    pixels.row(i) = pixel ? pixel->transpose() : Eigen::RowVector2d(kNan, kNan);
    if (!pixel) {
      jacobians.by_point.setConstant(kNan);
      jacobians.by_interior.setConstant(kNan);
    }
    for (int r = 0; r < 2; ++r) {
      for (int c = 0; c < 3; ++c) point_view(i, r, c) = jacobians.by_point(r, c);
      for (int c = 0; c < kNumInterior; ++c) interior_view(i, r, c) = jacobians.by_interior(r, c);
    }
  }
  return py::make_tuple(pixels, by_point, by_interior);
}

using Array = py::array_t<double, py::array::c_style>;

py::array_t<bool> Inside(const Array& points, const Array& planes, double border) {
  std::vector<char> inside;
  {
    const py::gil_scoped_release release;
    inside = InsideHalfSpaces({points.data(), static_cast<std::size_t>(points.size())},
                              {planes.data(), static_cast<std::size_t>(planes.size())}, border);
  }
  py::array_t<bool> result(static_cast<py::ssize_t>(inside.size()));
  std::transform(inside.begin(), inside.end(), result.mutable_data(),
                 [](char value) { return value != 0; });
  return result;
}

Rows<3> Rays(const Camera& camera, const Eigen::Ref<const Rows<2>>& pixels) {
  Rows<3> rays(pixels.rows(), 3);
  for (Eigen::Index i = 0; i < pixels.rows(); ++i) {
    const auto ray = RayThroughPixel(camera, pixels.row(i).transpose());
    rays.row(i) = ray ? ray->transpose() : Eigen::RowVector3d(kNan, kNan, kNan);
  }
  return rays;
}

Rows<2> EllipseCenters(const Camera& camera, const Eigen::Ref<const Rows<3>>& centers_in_cam,
                       const Eigen::Ref<const Rows<3>>& normals,
                       const Eigen::Ref<const Eigen::VectorXd>& diameter_mm) {
  if (normals.rows() != centers_in_cam.rows() || diameter_mm.size() != centers_in_cam.rows()) {
    throw std::invalid_argument("circles: expected as many normals and diameters as centres");
  }
  Rows<2> pixels(centers_in_cam.rows(), 2);
  for (Eigen::Index i = 0; i < centers_in_cam.rows(); ++i) {
    const Circle circle{centers_in_cam.row(i).transpose(), normals.row(i).transpose(),
                        0.5 * diameter_mm[i]};
    circle.Check(("circle " + std::to_string(i)).c_str());
    const auto pixel = ProjectEllipseCenter(camera, circle);
    pixels.row(i) = pixel ? pixel->transpose() : Eigen::RowVector2d(kNan, kNan);
  }
  return pixels;
}

/// Point i has the sightings offsets[i] ... offsets[i + 1]; ellipse (M, 5): centre,
/// axes, angle; cov (M, 9) of axes and angle. NaN where there is no estimate.
py::tuple EstimateNormals(const Rig& rig, const std::vector<std::int64_t>& offsets,
                          const std::vector<int>& camera, const Eigen::Ref<const Rows<5>>& ellipse,
                          const Eigen::Ref<const Rows<9>>& cov,
                          const Eigen::Ref<const Rows<3>>& position_mm) {
  const auto count = position_mm.rows();
  if (static_cast<Eigen::Index>(offsets.size()) != count + 1 || offsets.front() != 0 ||
      offsets.back() != ellipse.rows() || cov.rows() != ellipse.rows() ||
      static_cast<Eigen::Index>(camera.size()) != ellipse.rows()) {
    throw std::invalid_argument("ellipses: offsets, camera, ellipse, cov, position do not fit");
  }
  Rows<3> normal = Rows<3>::Constant(count, 3, kNan);
  Rows<9> cov_normal = Rows<9>::Constant(count, 9, kNan);
  Eigen::VectorXd diameter = Eigen::VectorXd::Constant(count, kNan);
  for (Eigen::Index i = 0; i < count; ++i) {
    std::vector<EllipseSighting> sightings;
    for (auto k = offsets[static_cast<std::size_t>(i)];
         k < offsets[static_cast<std::size_t>(i) + 1]; ++k) {
      const int index = camera[static_cast<std::size_t>(k)];
      if (index < 0 || index >= static_cast<int>(rig.size())) {
        throw std::invalid_argument("camera: index out of range");
      }
      const auto e = ellipse.row(k);
      sightings.push_back({index,
                           {e[0], e[1], e[2], e[3], e[4]},
                           Eigen::Map<const Eigen::Matrix3d>(cov.row(k).data())});
    }
    const auto estimate = EstimateNormal(rig, sightings, position_mm.row(i).transpose());
    if (!estimate) continue;
    normal.row(i) = estimate->normal.transpose();
    cov_normal.row(i) = Eigen::Map<const Eigen::Matrix<double, 1, 9>>(estimate->cov.data());
    diameter[i] = 2 * estimate->radius_mm;
  }
  return py::make_tuple(normal, cov_normal, diameter);
}

template <typename T>
py::array_t<T> RemapImage(const py::array_t<T, py::array::c_style>& image,
                          const py::array_t<double, py::array::c_style>& map_px,
                          Interpolation interpolation, int fill, int largest, int num_threads) {
  if (image.ndim() != 2 || map_px.ndim() != 3 || map_px.shape(2) != 2) {
    throw std::invalid_argument("remap: expected a picture (H, W) and a map (h, w, 2)");
  }
  const ImageView<T> view(image.data(), static_cast<int>(image.shape(1)),
                          static_cast<int>(image.shape(0)));
  py::array_t<T> out({map_px.shape(0), map_px.shape(1)});
  const double* places = map_px.data();
  T* samples = out.mutable_data();
  const int width = static_cast<int>(map_px.shape(1)), height = static_cast<int>(map_px.shape(0));
  const RemapOptions options{interpolation, fill, largest, num_threads};
  {
    const py::gil_scoped_release release;
    Remap(view, places, width, height, options, samples);
  }
  return out;
}

template <typename T>
void BindRemap(py::module_& m) {
  m.def("remap", &RemapImage<T>, "image"_a.noconvert(), "map_px"_a.noconvert(), "interpolation"_a,
        "fill"_a, "largest"_a, "num_threads"_a);
}

}  // namespace

/// The points (N, 3) of the surface through which points are seen; NaN where there is none.
Rows<3> SeenThroughMany(const FlatInterface& interface, const Eigen::Ref<const Rows<3>>& points_mm,
                        const Eigen::Vector3d& center_mm) {
  Rows<3> seen(points_mm.rows(), 3);
  for (Eigen::Index i = 0; i < points_mm.rows(); ++i) {
    const auto point = SeenThrough(interface, points_mm.row(i).transpose(), center_mm);
    seen.row(i) = point ? point->transpose() : Eigen::RowVector3d(kNan, kNan, kNan);
  }
  return seen;
}

/// Pictures (N, 2) of points of the world's frame; NaN where there is none.
Rows<2> ProjectOriented(const OrientedCamera& camera,
                        const Eigen::Ref<const Rows<3>>& points_in_world) {
  Rows<2> pixels(points_in_world.rows(), 2);
  for (Eigen::Index i = 0; i < points_in_world.rows(); ++i) {
    const auto pixel = ProjectFromWorld(camera, points_in_world.row(i).transpose());
    pixels.row(i) = pixel ? pixel->transpose() : Eigen::RowVector2d(kNan, kNan);
  }
  return pixels;
}

/// Pictures (N, 2), by the point (N, 2, 3), by the camera (N, 2, 16).
py::tuple ProjectOrientedWithJacobians(const OrientedCamera& camera,
                                       const Eigen::Ref<const Rows<3>>& points_in_world) {
  const Eigen::Index n = points_in_world.rows();
  Rows<2> pixels = Rows<2>::Constant(n, 2, kNan);
  py::array_t<double> by_point({n, Eigen::Index{2}, Eigen::Index{3}});
  py::array_t<double> by_camera({n, Eigen::Index{2}, Eigen::Index{kNumCameraParameters}});
  std::fill_n(by_point.mutable_data(), by_point.size(), kNan);
  std::fill_n(by_camera.mutable_data(), by_camera.size(), kNan);
  for (Eigen::Index i = 0; i < n; ++i) {
    OrientedJacobians j;
    const auto pixel = ProjectFromWorld(camera, points_in_world.row(i).transpose(), &j);
    if (!pixel) continue;
    pixels.row(i) = pixel->transpose();
    Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(by_point.mutable_data(i, 0, 0)) =
        j.by_point;
    Eigen::Map<Eigen::Matrix<double, 2, kNumCameraParameters, Eigen::RowMajor>>(
        by_camera.mutable_data(i, 0, 0)) = j.by_camera;
  }
  return py::make_tuple(pixels, by_point, by_camera);
}

/// Origins and unit directions (N, 3) of the rays through pixels, in the world's frame.
py::tuple OrientedRays(const OrientedCamera& camera, const Eigen::Ref<const Rows<2>>& pixels) {
  Rows<3> origin = Rows<3>::Constant(pixels.rows(), 3, kNan), direction = origin;
  for (Eigen::Index i = 0; i < pixels.rows(); ++i) {
    const auto ray = RayFromPixel(camera, pixels.row(i).transpose());
    if (!ray) continue;
    origin.row(i) = ray->origin_mm.transpose();
    direction.row(i) = ray->direction.transpose();
  }
  return py::make_tuple(origin, direction);
}

void BindRefraction(py::module_& m) {
  py::class_<FlatInterface>(m, "FlatInterface")
      .def(py::init([](const Eigen::Vector3d& normal, double distance_mm, double fluid_index,
                       double glass_index, double glass_thickness_mm) {
             const FlatInterface interface{normal, distance_mm, fluid_index, glass_index,
                                           glass_thickness_mm};
             interface.Check("interface");
             return interface;
           }),
           "normal"_a, "distance_mm"_a, "fluid_index"_a, "glass_index"_a, "glass_thickness_mm"_a)
      .def_readonly("normal", &FlatInterface::normal)
      .def_readonly("distance_mm", &FlatInterface::distance_mm)
      .def_readonly("fluid_index", &FlatInterface::fluid_index)
      .def_readonly("glass_index", &FlatInterface::glass_index)
      .def_readonly("glass_thickness_mm", &FlatInterface::glass_thickness_mm);
  m.def("seen_through", &SeenThroughMany, "interface"_a, "points_mm"_a, "center_mm"_a);
  m.def("project_from_world", &ProjectOriented, "camera"_a, "points_in_world"_a,
        py::call_guard<py::gil_scoped_release>());
  m.def("project_from_world_with_jacobians", &ProjectOrientedWithJacobians, "camera"_a,
        "points_in_world"_a);
  m.def("rays_from_pixels", &OrientedRays, "camera"_a, "pixels"_a);
}

void BindGeometry(py::module_& parent) {
  py::module_ m = parent.def_submodule("geometry");
  BindRefraction(m);
  py::class_<Camera>(m, "Camera")
      .def(py::init([](int width_px, int height_px,
                       const Eigen::Matrix<double, kNumInterior, 1>& interior, double r0_px,
                       bool measured) {
             return Camera{width_px, height_px, interior, r0_px,
                           measured ? DistortionDirection::kMeasured : DistortionDirection::kIdeal};
           }),
           "width_px"_a, "height_px"_a, "interior"_a, "r0_px"_a, "measured"_a = true)
      .def_readonly("width_px", &Camera::width_px)
      .def_readonly("height_px", &Camera::height_px)
      .def_readonly("interior", &Camera::interior)
      .def_readonly("r0_px", &Camera::r0_px)
      .def_property_readonly("measured", [](const Camera& c) {
        return c.direction == DistortionDirection::kMeasured;
      });
  py::class_<OrientedCamera>(m, "OrientedCamera")
      .def(py::init([](const Camera& camera, const Eigen::Matrix3d& rotation,
                       const Eigen::Vector3d& translation_mm,
                       const std::optional<FlatInterface>& interface) {
             return OrientedCamera{camera, Rigid3{rotation, translation_mm}, interface};
           }),
           "camera"_a, "rotation"_a, "translation_mm"_a, "interface"_a = std::nullopt);
  m.def("default_r0_px", &DefaultR0Px, "width_px"_a, "height_px"_a);
  m.def("project", &ProjectPoints, "camera"_a, "points_in_cam"_a,
        py::call_guard<py::gil_scoped_release>());
  m.def("project_with_jacobians", &ProjectWithJacobians, "camera"_a, "points_in_cam"_a);
  m.def("rays", &Rays, "camera"_a, "pixels"_a, py::call_guard<py::gil_scoped_release>());
  m.def("ellipse_centers", &EllipseCenters, "camera"_a, "centers_in_cam"_a, "normals"_a,
        "diameter_mm"_a);
  m.def("estimate_normals", &EstimateNormals, "rig"_a, "offsets"_a, "camera"_a, "ellipse"_a,
        "cov"_a, "position_mm"_a);
  m.def("rotation_from_vector", &RotationFromVector, "rotation_rad"_a);
  m.def("vector_from_rotation", &VectorFromRotation, "rotation"_a);
  py::enum_<Interpolation>(m, "Interpolation")
      .value("linear", Interpolation::kLinear)
      .value("cubic", Interpolation::kCubic)
      .value("lanczos", Interpolation::kLanczos);
  BindRemap<std::uint8_t>(m);
  BindRemap<std::uint16_t>(m);
  m.def("inside_half_spaces", &Inside, "points"_a.noconvert(), "planes"_a.noconvert(), "border"_a);
  m.def("nearest_rotation", &NearestRotation, "matrix"_a);
}

}  // namespace videogrammetry::bindings
