#include <pybind11/pybind11.h>

#include "bindings.h"

namespace videogrammetry::bindings {

void BindMatching(pybind11::module_& parent) { parent.def_submodule("matching"); }

}  // namespace videogrammetry::bindings
