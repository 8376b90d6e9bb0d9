#pragma once

#include <pybind11/pybind11.h>

// One function a room; each adds the submodule _core.<room>.
namespace videogrammetry::bindings {

void BindGeometry(pybind11::module_& m);

}  // namespace videogrammetry::bindings
