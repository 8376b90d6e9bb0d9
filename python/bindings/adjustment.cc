#include <pybind11/pybind11.h>

#include "bindings.h"

namespace videogrammetry::bindings {

void BindAdjustment(pybind11::module_& parent) { parent.def_submodule("adjustment"); }

}  // namespace videogrammetry::bindings
