#pragma once

#include <pybind11/pybind11.h>

// One function a room; each adds the submodule _core.<room>.
namespace videogrammetry::bindings {

void BindGeometry(pybind11::module_& m);
void BindMatching(pybind11::module_& m);
void BindReconstruction(pybind11::module_& m);
void BindAdjustment(pybind11::module_& m);
void BindRecognition(pybind11::module_& m);
void BindRendering(pybind11::module_& m);
void BindSequence(pybind11::module_& m);
void BindTracking(pybind11::module_& m);

}  // namespace videogrammetry::bindings
