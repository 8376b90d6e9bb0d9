#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <span>

#include "bindings.h"
#include "videogrammetry/sequence/packed12.h"

namespace py = pybind11;
using namespace pybind11::literals;

namespace videogrammetry::bindings {
namespace {

template <typename T>
using Array = py::array_t<T, py::array::c_style>;

PackedOrder Order(bool high_first) {
  return high_first ? PackedOrder::kHighFirst : PackedOrder::kLowFirst;
}

template <typename T>
std::span<const T> Input(const Array<T>& array) {
  return {array.data(), static_cast<std::size_t>(array.size())};
}

template <typename T>
std::span<T> Output(Array<T>& array) {
  return {array.mutable_data(), static_cast<std::size_t>(array.size())};
}

void UnpackInto(const Array<std::uint8_t>& packed, Array<std::uint16_t>& samples, bool high_first) {
  const auto from = Input(packed);
  const auto to = Output(samples);
  const py::gil_scoped_release release;
  Unpack12(from, Order(high_first), to);
}

void PackInto(const Array<std::uint16_t>& samples, Array<std::uint8_t>& packed, bool high_first) {
  const auto from = Input(samples);
  const auto to = Output(packed);
  const py::gil_scoped_release release;
  Pack12(from, Order(high_first), to);
}

}  // namespace

void BindSequence(py::module_& parent) {
  py::module_ m = parent.def_submodule("sequence");
  m.def("packed_12bit_bytes", &Packed12Bytes, "num_samples"_a);
  m.def("unpack_12bit", &UnpackInto, "packed"_a.noconvert(), "samples"_a.noconvert(),
        "high_first"_a = true);
  m.def("pack_12bit", &PackInto, "samples"_a.noconvert(), "packed"_a.noconvert(),
        "high_first"_a = true);
}

}  // namespace videogrammetry::bindings
