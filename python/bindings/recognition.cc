#include <pybind11/pybind11.h>

#include "bindings.h"

namespace videogrammetry::bindings {

void BindRecognition(pybind11::module_& parent) { parent.def_submodule("recognition"); }

}  // namespace videogrammetry::bindings
