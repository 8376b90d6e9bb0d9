#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings.h"
#include "videogrammetry/recognition/recognize.h"
#include "videogrammetry/recognition/tracked_recognition.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

/// A (H, W) array as a view; rows may lie apart, samples of a row may not.
template <typename T>
ImageView<T> ViewOf(const py::array_t<T>& image) {
  if (image.ndim() != 2) throw py::value_error("image: expected 2 dimensions");
  if (image.size() == 0) return {};
  const auto itemsize = static_cast<py::ssize_t>(sizeof(T));
  const py::ssize_t stride = image.strides(0) / itemsize;
  if (image.strides(1) != itemsize || image.strides(0) % itemsize != 0 || stride < image.shape(1)) {
    throw py::value_error("image: expected rows of contiguous samples");
  }
  return {image.data(), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0)), stride};
}

template <typename Value, typename Get>
py::array_t<Value> Column(const std::vector<Target>& targets, Get&& get) {
  py::array_t<Value> column(static_cast<py::ssize_t>(targets.size()));
  Value* data = column.mutable_data();
  for (const Target& target : targets) *data++ = get(target);
  return column;
}

py::dict ToArrays(const std::vector<Target>& targets) {
  const auto n = static_cast<py::ssize_t>(targets.size());
  py::array_t<double> center({n, py::ssize_t{2}}), axes({n, py::ssize_t{2}});
  py::array_t<double> cov({n, py::ssize_t{5}, py::ssize_t{5}});
  double* c = center.mutable_data();
  double* a = axes.mutable_data();
  double* v = cov.mutable_data();
  for (const Target& target : targets) {
    const Ellipse& e = target.edge.ellipse;
    *c++ = e.x_px;
    *c++ = e.y_px;
    *a++ = e.semi_major_px;
    *a++ = e.semi_minor_px;
    for (int i = 0; i < 5; ++i) {
      for (int j = 0; j < 5; ++j) *v++ = target.edge.cov(i, j);
    }
  }
  py::dict out;
  out["centre_px"] = center;
  out["semi_axes_px"] = axes;
  out["angle_rad"] =
      Column<double>(targets, [](const Target& t) { return t.edge.ellipse.angle_rad; });
  out["id"] = Column<std::int32_t>(targets, [](const Target& t) { return t.ring.id.value_or(-1); });
  out["cov"] = cov;
  out["edge_rms_px"] = Column<double>(targets, [](const Target& t) { return t.edge.edge_rms_px; });
  out["contrast"] =
      Column<double>(targets, [](const Target& t) { return t.edge.inside - t.edge.outside; });
  out["ring_status"] = Column<std::uint8_t>(
      targets, [](const Target& t) { return static_cast<std::uint8_t>(t.ring.status); });
  out["id_confidence"] = Column<double>(targets, [](const Target& t) {
    return t.ring.id ? t.ring.confidence : std::numeric_limits<double>::quiet_NaN();
  });
  return out;
}

/// Packed samples of one picture in memory that someone else owns, held alive here.
struct PackedFrame {
  py::array_t<std::uint8_t> data;
  Packed12View view;
};

PackedFrame MakePacked(const py::array_t<std::uint8_t>& data, int height, int width,
                       bool high_first) {
  const auto order = high_first ? PackedOrder::kHighFirst : PackedOrder::kLowFirst;
  const Packed12View view(data.data(), width, height, order);
  const auto bytes =
      Packed12Bytes(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  const bool flat = data.ndim() == 1 && (data.size() == 0 || data.strides(0) == 1);
  if (!flat || static_cast<std::size_t>(data.size()) != bytes) {
    throw py::value_error("data: expected " + std::to_string(bytes) + " contiguous bytes");
  }
  return {data, view};
}

py::array_t<std::uint16_t> Unpack(const PackedFrame& frame) {
  const Packed12View& view = frame.view;
  py::array_t<std::uint16_t> samples({view.height(), view.width()});
  std::uint16_t* out = samples.mutable_data();
  const py::gil_scoped_release release;
  for (int y = 0; y < view.height(); ++y) {
    for (int x = 0; x < view.width(); ++x) *out++ = static_cast<std::uint16_t>(view(x, y));
  }
  return samples;
}

FrameView FrameOf(const py::handle& frame) {
  if (py::isinstance<py::array_t<std::uint8_t>>(frame)) {
    return ViewOf(py::reinterpret_borrow<py::array_t<std::uint8_t>>(frame));
  }
  if (py::isinstance<py::array_t<std::uint16_t>>(frame)) {
    return ViewOf(py::reinterpret_borrow<py::array_t<std::uint16_t>>(frame));
  }
  if (py::isinstance<PackedFrame>(frame)) return frame.cast<const PackedFrame&>().view;
  throw py::value_error("frames: expected arrays of uint8 or uint16, or packed frames");
}

py::dict RecognizeOne(const Recognizer& recognizer, const py::object& frame,
                      const CameraModel* camera) {
  const std::vector<FrameView> views = {FrameOf(frame)};
  std::vector<std::vector<Target>> targets;
  {
    const py::gil_scoped_release release;
    targets = recognizer.RecognizeFrames(views, 1, camera);
  }
  return ToArrays(targets.front());
}

std::vector<FrameView> FramesOf(const py::tuple& frames) {
  std::vector<FrameView> views;
  views.reserve(frames.size());
  for (const py::handle frame : frames) views.push_back(FrameOf(frame));
  return views;
}

/// The targets of all frames in one set of arrays; those of frame i stand at
/// offsets[i] to offsets[i + 1].
py::dict RecognizeList(const Recognizer& recognizer, const py::list& frames, int num_threads,
                       const CameraModel* camera) {
  // Holds the arrays while the lock is released and the list may be changed.
  const py::tuple held(frames);
  const std::vector<FrameView> views = FramesOf(held);
  py::array_t<std::int64_t> offsets(static_cast<py::ssize_t>(views.size()) + 1);
  std::int64_t* offset = offsets.mutable_data();
  *offset = 0;
  std::vector<Target> all;
  {
    const py::gil_scoped_release release;
    for (const auto& targets : recognizer.RecognizeFrames(views, num_threads, camera)) {
      all.insert(all.end(), targets.begin(), targets.end());
      *++offset = static_cast<std::int64_t>(all.size());
    }
  }
  py::dict out = ToArrays(all);
  out["offsets"] = offsets;
  return out;
}

/// One frame comes after the other, whichever thread it comes from.
class Tracker {
 public:
  Tracker(const RecognitionOptions& options, const CodeFamily& family, int full_every,
          double margin_px, const std::optional<CameraModel>& camera)
      : recognizer_(options, family, {full_every, margin_px}, camera) {}

  py::dict Next(const py::object& frame) {
    const FrameView view = FrameOf(frame);
    TrackedFrame found;
    {
      const py::gil_scoped_release release;
      const std::lock_guard<std::mutex> lock(mutex_);
      found = recognizer_.Next(view);
    }
    py::dict out = ToArrays(found.targets);
    out["full"] = found.full;
    out["lost"] = found.lost;
    return out;
  }

  /// The next frames, in arrays as RecognizeList has them.
  py::dict Follow(const py::list& frames) {
    const py::tuple held(frames);
    const std::vector<FrameView> views = FramesOf(held);
    const auto count = static_cast<py::ssize_t>(views.size());
    py::array_t<std::int64_t> offsets(count + 1);
    py::array_t<bool> full(count);
    py::array_t<std::int32_t> lost(count);
    std::int64_t* offset = offsets.mutable_data();
    bool* is_full = full.mutable_data();
    std::int32_t* num_lost = lost.mutable_data();
    *offset = 0;
    std::vector<Target> all;
    {
      const py::gil_scoped_release release;
      const std::lock_guard<std::mutex> lock(mutex_);
      for (const FrameView& view : views) {
        const TrackedFrame found = recognizer_.Next(view);
        all.insert(all.end(), found.targets.begin(), found.targets.end());
        *++offset = static_cast<std::int64_t>(all.size());
        *is_full++ = found.full;
        *num_lost++ = found.lost;
      }
    }
    py::dict out = ToArrays(all);
    out["offsets"] = offsets;
    out["full"] = full;
    out["lost"] = lost;
    return out;
  }

  std::optional<CameraModel> camera() {
    const py::gil_scoped_release release;
    const std::lock_guard<std::mutex> lock(mutex_);
    return recognizer_.camera();
  }

 private:
  TrackedRecognizer recognizer_;
  std::mutex mutex_;
};

std::optional<CameraModel> Learn(const Recognizer& recognizer, const py::object& frame) {
  const FrameView view = FrameOf(frame);
  const py::gil_scoped_release release;
  return recognizer.Learn(view);
}

CameraModel MakeCamera(int gradient_threshold, int second_threshold, double blur_px,
                       double blur_sigma_px, double noise_at_zero, double noise_per_grey,
                       double noise_least, double light_gradient, double flare) {
  CameraModel camera;
  camera.gradient_threshold = gradient_threshold;
  camera.second_threshold = second_threshold;
  camera.picture.blur_px = blur_px;
  camera.picture.blur_sigma_px = blur_sigma_px;
  camera.picture.noise = {noise_at_zero, noise_per_grey, noise_least};
  camera.picture.gradient = light_gradient;
  camera.picture.flare = flare;
  return camera;
}

Estimator EstimatorOf(const std::string& name) {
  if (name == "auto") return Estimator::kOfMethod;
  if (name == "mean-gradient") return Estimator::kMeanGradient;
  if (name == "dual-conic") return Estimator::kDualConic;
  if (name == "model") return Estimator::kModel;
  throw py::value_error(
      "estimator: expected 'auto', 'mean-gradient', 'dual-conic' or 'model', got '" + name + "'");
}

const char* NameOf(Estimator estimator) {
  switch (estimator) {
    case Estimator::kDualConic:
      return "dual-conic";
    case Estimator::kModel:
      return "model";
    case Estimator::kMeanGradient:
      return "mean-gradient";
    default:
      return "auto";
  }
}

RecognitionOptions MakeOptions(const std::string& codes, bool clockwise, bool white_on_black,
                               std::array<double, 2> diameter_px, const std::string& method,
                               const std::string& estimator) {
  RecognitionOptions options;
  options.codes = codes;
  options.direction =
      clockwise ? ReadingDirection::kClockwise : ReadingDirection::kCounterClockwise;
  options.polarity = white_on_black ? Polarity::kWhiteOnBlack : Polarity::kBlackOnWhite;
  options.diameter_px = diameter_px;
  options.method = method;
  options.estimator = EstimatorOf(estimator);
  options.Check();
  return options;
}

CodeFamily MakeFamily(const std::string& name, int num_bits, double ring_inner, double ring_outer,
                      const std::vector<std::uint32_t>& codes) {
  CodeFamily family;
  family.name = name;
  family.num_bits = num_bits;
  family.ring_inner = ring_inner;
  family.ring_outer = ring_outer;
  family.codes = codes;
  family.Index();
  family.Check();
  return family;
}

}  // namespace

void BindRecognition(py::module_& parent) {
  py::module_ m = parent.def_submodule("recognition");
  const RecognitionOptions defaults;
  py::class_<RecognitionOptions>(m, "RecognitionOptions")
      .def(py::init(&MakeOptions), py::kw_only(), "codes"_a = defaults.codes, "clockwise"_a = true,
           "white_on_black"_a = true, "diameter_px"_a = defaults.diameter_px,
           "method"_a = defaults.method, "estimator"_a = NameOf(defaults.estimator))
      .def_readonly("codes", &RecognitionOptions::codes)
      .def_property_readonly(
          "direction",
          [](const RecognitionOptions& o) {
            return o.direction == ReadingDirection::kClockwise ? "clockwise" : "counter-clockwise";
          })
      .def_property_readonly("polarity",
                             [](const RecognitionOptions& o) {
                               return o.polarity == Polarity::kWhiteOnBlack ? "white-on-black"
                                                                            : "black-on-white";
                             })
      .def_readonly("diameter_px", &RecognitionOptions::diameter_px)
      .def_readonly("method", &RecognitionOptions::method)
      .def_property_readonly("estimator",
                             [](const RecognitionOptions& o) { return NameOf(o.estimator); });
  py::class_<CodeFamily>(m, "CodeFamily")
      .def(py::init(&MakeFamily), "name"_a, "num_bits"_a, "ring_inner"_a, "ring_outer"_a, "codes"_a)
      .def_readonly("name", &CodeFamily::name)
      .def_readonly("num_bits", &CodeFamily::num_bits)
      .def_readonly("ring_inner", &CodeFamily::ring_inner)
      .def_readonly("ring_outer", &CodeFamily::ring_outer)
      .def_readonly("codes", &CodeFamily::codes);
  m.def("one_sector_apart", &OneSectorApart, "family"_a);
  m.def("code_family_names", &CodeFamilyNames);
  m.def("named_code_family", &NamedCodeFamily, "name"_a);
  py::class_<CameraModel>(m, "CameraModel")
      .def(py::init(&MakeCamera), py::kw_only(), "gradient_threshold"_a, "second_threshold"_a,
           "blur_px"_a, "blur_sigma_px"_a, "noise_at_zero"_a, "noise_per_grey"_a, "noise_least"_a,
           "light_gradient"_a, "flare"_a)
      .def_readonly("gradient_threshold", &CameraModel::gradient_threshold)
      .def_readonly("second_threshold", &CameraModel::second_threshold)
      .def_property_readonly("blur_px", [](const CameraModel& c) { return c.picture.blur_px; })
      .def_property_readonly("blur_sigma_px",
                             [](const CameraModel& c) { return c.picture.blur_sigma_px; })
      .def_property_readonly("noise_at_zero",
                             [](const CameraModel& c) { return c.picture.noise.at_zero; })
      .def_property_readonly("noise_per_grey",
                             [](const CameraModel& c) { return c.picture.noise.per_grey; })
      .def_property_readonly("noise_least",
                             [](const CameraModel& c) { return c.picture.noise.least; })
      .def_property_readonly("light_gradient",
                             [](const CameraModel& c) { return c.picture.gradient; })
      .def_property_readonly("flare", [](const CameraModel& c) { return c.picture.flare; });
  py::class_<PackedFrame>(m, "PackedFrame")
      .def(py::init(&MakePacked), "data"_a.noconvert(), "height"_a, "width"_a, "high_first"_a)
      .def("unpack", &Unpack);
  py::class_<Recognizer>(m, "Recognizer")
      .def(py::init<const RecognitionOptions&, const CodeFamily&>(), "options"_a, "family"_a)
      .def("recognize", &RecognizeOne, "frame"_a, "camera"_a = nullptr)
      .def("recognize_frames", &RecognizeList, "frames"_a, "num_threads"_a = 1,
           "camera"_a = nullptr)
      .def("learn", &Learn, "frame"_a);
  py::class_<TrackedOptions>(m, "TrackedOptions")
      .def(py::init<>())
      .def_readonly("full_every", &TrackedOptions::full_every)
      .def_readonly("margin_px", &TrackedOptions::margin_px);
  const TrackedOptions tracked;
  py::class_<Tracker>(m, "TrackedRecognizer")
      .def(py::init<const RecognitionOptions&, const CodeFamily&, int, double,
                    const std::optional<CameraModel>&>(),
           "options"_a, "family"_a, "full_every"_a = tracked.full_every,
           "margin_px"_a = tracked.margin_px, "camera"_a = py::none())
      .def("next", &Tracker::Next, "frame"_a)
      .def("follow", &Tracker::Follow, "frames"_a)
      .def_property_readonly("camera", &Tracker::camera);
}

}  // namespace videogrammetry::bindings
