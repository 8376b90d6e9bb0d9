#include <pybind11/pybind11.h>

#include "bindings.h"

namespace videogrammetry::bindings {

void BindReconstruction(pybind11::module_& parent) { parent.def_submodule("reconstruction"); }

}  // namespace videogrammetry::bindings
