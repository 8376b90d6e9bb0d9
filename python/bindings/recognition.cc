#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings.h"
#include "videogrammetry/recognition/recognize.h"

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

template <typename T>
py::dict RecognizeArray(const py::array_t<T>& image, const RecognitionOptions& options,
                        const CodeFamily& family) {
  const ImageView<T> view = ViewOf(image);
  std::vector<Target> targets;
  {
    const py::gil_scoped_release release;
    targets = Recognize(view, options, family);
  }
  return ToArrays(targets);
}

FrameView FrameOf(const py::handle& frame) {
  if (py::isinstance<py::array_t<std::uint8_t>>(frame)) {
    return ViewOf(py::reinterpret_borrow<py::array_t<std::uint8_t>>(frame));
  }
  if (py::isinstance<py::array_t<std::uint16_t>>(frame)) {
    return ViewOf(py::reinterpret_borrow<py::array_t<std::uint16_t>>(frame));
  }
  throw py::value_error("frames: expected arrays of uint8 or uint16");
}

/// The targets of all frames in one set of arrays; those of frame i stand at
/// offsets[i] to offsets[i + 1].
py::dict RecognizeList(const Recognizer& recognizer, const py::list& frames, int num_threads) {
  // Holds the arrays while the lock is released and the list may be changed.
  const py::tuple held(frames);
  std::vector<FrameView> views;
  views.reserve(held.size());
  for (const py::handle frame : held) views.push_back(FrameOf(frame));
  py::array_t<std::int64_t> offsets(static_cast<py::ssize_t>(views.size()) + 1);
  std::int64_t* offset = offsets.mutable_data();
  *offset = 0;
  std::vector<Target> all;
  {
    const py::gil_scoped_release release;
    for (const auto& targets : recognizer.RecognizeFrames(views, num_threads)) {
      all.insert(all.end(), targets.begin(), targets.end());
      *++offset = static_cast<std::int64_t>(all.size());
    }
  }
  py::dict out = ToArrays(all);
  out["offsets"] = offsets;
  return out;
}

Estimator EstimatorOf(const std::string& name) {
  if (name == "mean-gradient") return Estimator::kMeanGradient;
  if (name == "dual-conic") return Estimator::kDualConic;
  if (name == "model") return Estimator::kModel;
  throw py::value_error("estimator: expected 'mean-gradient', 'dual-conic' or 'model', got '" +
                        name + "'");
}

const char* NameOf(Estimator estimator) {
  switch (estimator) {
    case Estimator::kDualConic:
      return "dual-conic";
    case Estimator::kModel:
      return "model";
    default:
      return "mean-gradient";
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
  m.def("recognize", &RecognizeArray<std::uint8_t>, "image"_a.noconvert(), "options"_a, "family"_a);
  m.def("recognize", &RecognizeArray<std::uint16_t>, "image"_a.noconvert(), "options"_a,
        "family"_a);
  py::class_<Recognizer>(m, "Recognizer")
      .def(py::init<const RecognitionOptions&, const CodeFamily&>(), "options"_a, "family"_a)
      .def("recognize_frames", &RecognizeList, "frames"_a, "num_threads"_a = 1);
}

}  // namespace videogrammetry::bindings
