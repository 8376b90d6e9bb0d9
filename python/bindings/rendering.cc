#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <limits>

#include "bindings.h"
#include "videogrammetry/core/thread_pool.h"
#include "videogrammetry/rendering/render.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;
using Targets = std::vector<SceneTarget>;
/// A vector that Python holds and does not convert.
struct Held {
  Targets targets;
};
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Eigen::Vector3d Row3(const Array<double>& array, py::ssize_t i) {
  return Eigen::Map<const Eigen::Vector3d>(array.data(i, 0));
}

std::vector<TargetPose> PosesOf(const Array<double>& center, const Array<double>& normal,
                                const Array<double>& x_axis) {
  std::vector<TargetPose> poses;
  for (py::ssize_t i = 0; i < center.shape(0); ++i) {
    poses.push_back({Row3(center, i), Row3(normal, i), Row3(x_axis, i)});
  }
  return poses;
}

/// Poses (each a tuple of three (N, 3) arrays; `end` may be empty), the columns
/// of doubles (N, 8): radius, ring's two, sticker, white, black, gradient's two,
/// and of integers (N, 5): id, bits, code, square, white on black.
Targets MakeTargets(const std::vector<TargetPose>& begin, const std::vector<TargetPose>& end,
                    const Array<double>& numbers, const Array<std::int64_t>& integers) {
  Targets targets(begin.size());
  for (std::size_t k = 0; k < begin.size(); ++k) {
    const double* d = numbers.data(static_cast<py::ssize_t>(k), 0);
    const std::int64_t* n = integers.data(static_cast<py::ssize_t>(k), 0);
    SceneTarget& t = targets[k];
    t.pose = begin[k];
    if (!end.empty()) t.end_pose = end[k];
    t.radius_mm = d[0];
    t.ring = {d[1], d[2]};
    t.sticker_mm = d[3];
    t.white = d[4];
    t.black = d[5];
    t.gradient = {d[6], d[7]};
    t.id = static_cast<int>(n[0]);
    t.num_bits = static_cast<int>(n[1]);
    t.code = static_cast<std::uint32_t>(n[2]);
    t.sticker = n[3] != 0 ? StickerShape::kSquare : StickerShape::kDisc;
    t.white_on_black = n[4] != 0;
    t.Check();
  }
  return targets;
}

py::dict ToArrays(const std::vector<TargetTruth>& truths) {
  const auto n = static_cast<py::ssize_t>(truths.size());
  py::array_t<std::uint8_t> visibility(n);
  py::array_t<double> circle({n, py::ssize_t{2}}), center({n, py::ssize_t{2}}),
      axes({n, py::ssize_t{2}}), angle(n), error(n);
  for (py::ssize_t i = 0; i < n; ++i) {
    const TargetTruth& t = truths[static_cast<std::size_t>(i)];
    const Eigen::Vector2d c = t.circle_center_px.value_or(Eigen::Vector2d(kNan, kNan));
    const Ellipse e = t.ellipse.value_or(Ellipse{kNan, kNan, kNan, kNan, kNan});
    visibility.mutable_at(i) = static_cast<std::uint8_t>(t.visibility);
    circle.mutable_at(i, 0) = c.x();
    circle.mutable_at(i, 1) = c.y();
    center.mutable_at(i, 0) = e.x_px;
    center.mutable_at(i, 1) = e.y_px;
    axes.mutable_at(i, 0) = e.semi_major_px;
    axes.mutable_at(i, 1) = e.semi_minor_px;
    angle.mutable_at(i) = e.angle_rad;
    error.mutable_at(i) = t.ellipse ? t.ellipse_error_px : kNan;
  }
  return py::dict("visibility"_a = visibility, "circle_px"_a = circle, "centre_px"_a = center,
                  "semi_axes_px"_a = axes, "angle_rad"_a = angle, "ellipse_error_px"_a = error);
}

py::array NewPicture(const Renderer& renderer) {
  const std::vector<py::ssize_t> shape = {renderer.height(), renderer.width()};
  if (renderer.sensor().bit_depth == 8) return py::array_t<std::uint8_t>(shape);
  return py::array_t<std::uint16_t>(shape);
}

/// Pictures and truth of (renderer, targets, seed), each on its own slot.
py::tuple RenderFrames(const std::vector<const Renderer*>& renderers,
                       const std::vector<const Targets*>& targets,
                       const std::vector<std::uint64_t>& seeds, int num_threads) {
  if (targets.size() != renderers.size() || seeds.size() != renderers.size()) {
    throw std::invalid_argument("targets, seeds: expected one of each a renderer");
  }
  std::vector<py::array> pictures;
  std::vector<void*> data;
  for (const Renderer* renderer : renderers) {
    pictures.push_back(NewPicture(*renderer));
    data.push_back(pictures.back().mutable_data());
  }
  std::vector<std::vector<TargetTruth>> truths(renderers.size());
  {
    const py::gil_scoped_release release;
    ParallelFor(static_cast<int>(renderers.size()), num_threads, [&](int i) {
      const auto k = static_cast<std::size_t>(i);
      if (renderers[k]->sensor().bit_depth == 8) {
        renderers[k]->Render(*targets[k], seeds[k], static_cast<std::uint8_t*>(data[k]));
      } else {
        renderers[k]->Render(*targets[k], seeds[k], static_cast<std::uint16_t*>(data[k]));
      }
      truths[k] = renderers[k]->Truth(*targets[k]);
    });
  }
  py::list all;
  for (const auto& truth : truths) all.append(ToArrays(truth));
  return py::make_tuple(pictures, all);
}

py::array_t<float> Light(const Renderer& renderer, const Targets& targets) {
  std::vector<float> light;
  {
    const py::gil_scoped_release release;
    light = renderer.Light(targets);
  }
  py::array_t<float> picture({renderer.height(), renderer.width()});
  std::copy(light.begin(), light.end(), picture.mutable_data());
  return picture;
}

void BindOptions(py::module_& m) {
  const Background background;
  py::class_<SpecularSpot>(m, "SpecularSpot")
      .def(py::init<double, double, double, double>(), "x_px"_a = 0.0, "y_px"_a = 0.0,
           "sigma_px"_a = SpecularSpot{}.sigma_px, "amplitude"_a = SpecularSpot{}.amplitude)
      .def_readonly("x_px", &SpecularSpot::x_px)
      .def_readonly("y_px", &SpecularSpot::y_px)
      .def_readonly("sigma_px", &SpecularSpot::sigma_px)
      .def_readonly("amplitude", &SpecularSpot::amplitude);
  py::class_<Background>(m, "Background")
      .def(py::init<double, double, int, int, int, std::uint64_t, std::vector<SpecularSpot>>(),
           "level"_a = background.level, "clutter"_a = background.clutter,
           "num_discs"_a = background.num_discs, "num_lines"_a = background.num_lines,
           "num_patches"_a = background.num_patches, "seed"_a = background.seed,
           "spots"_a = background.spots)
      .def_readonly("level", &Background::level)
      .def_readonly("clutter", &Background::clutter)
      .def_readonly("num_discs", &Background::num_discs)
      .def_readonly("num_lines", &Background::num_lines)
      .def_readonly("num_patches", &Background::num_patches)
      .def_readonly("seed", &Background::seed)
      .def_readonly("spots", &Background::spots);
  py::class_<Illumination>(m, "Illumination")
      .def(py::init<double, std::array<double, 2>>(), "level"_a = Illumination{}.level,
           "gradient"_a = Illumination{}.gradient)
      .def_readonly("level", &Illumination::level)
      .def_readonly("gradient", &Illumination::gradient);
  py::class_<Sensor>(m, "Sensor")
      .def(py::init<double, double, double, int>(), "psf_sigma_px"_a = Sensor{}.psf_sigma_px,
           "read_noise"_a = Sensor{}.read_noise, "shot_noise_gain"_a = Sensor{}.shot_noise_gain,
           "bit_depth"_a = Sensor{}.bit_depth)
      .def_readonly("psf_sigma_px", &Sensor::psf_sigma_px)
      .def_readonly("read_noise", &Sensor::read_noise)
      .def_readonly("shot_noise_gain", &Sensor::shot_noise_gain)
      .def_readonly("bit_depth", &Sensor::bit_depth);
}

}  // namespace

void BindRendering(py::module_& parent) {
  py::module_ m = parent.def_submodule("rendering");
  BindOptions(m);
  py::class_<Held>(m, "Targets")
      .def(py::init([](const Array<double>& center, const Array<double>& normal,
                       const Array<double>& x_axis, const Array<double>& end_center,
                       const Array<double>& end_normal, const Array<double>& end_x_axis,
                       const Array<double>& numbers, const Array<std::int64_t>& integers) {
             return Held{MakeTargets(PosesOf(center, normal, x_axis),
                                     PosesOf(end_center, end_normal, end_x_axis), numbers,
                                     integers)};
           }),
           "center"_a, "normal"_a, "x_axis"_a, "end_center"_a, "end_normal"_a, "end_x_axis"_a,
           "numbers"_a, "integers"_a);
  py::class_<Renderer>(m, "Renderer")
      .def(py::init<const OrientedCamera&, const Background&, const Illumination&, const Sensor&>(),
           "camera"_a, "background"_a, "illumination"_a, "sensor"_a,
           py::call_guard<py::gil_scoped_release>())
      .def(
          "light", [](const Renderer& r, const Held& held) { return Light(r, held.targets); },
          "targets"_a)
      .def(
          "truth",
          [](const Renderer& r, const Held& held) { return ToArrays(r.Truth(held.targets)); },
          "targets"_a);
  m.def(
      "render_frames",
      [](const std::vector<const Renderer*>& renderers, const std::vector<const Held*>& held,
         const std::vector<std::uint64_t>& seeds, int num_threads) {
        std::vector<const Targets*> targets;
        for (const Held* h : held) targets.push_back(&h->targets);
        return RenderFrames(renderers, targets, seeds, num_threads);
      },
      "renderers"_a, "targets"_a, "seeds"_a, "num_threads"_a);
}

}  // namespace videogrammetry::bindings
