#include <pybind11/pybind11.h>

#include "bindings.h"
#include "videogrammetry/core/cpu.h"
#include "videogrammetry/core/errors.h"

namespace py = pybind11;

PYBIND11_MODULE(_core, m) {
  m.doc() = "C++ core of videogrammetry: private, each part imported by its namesake alone.";
  py::register_exception<videogrammetry::TaskError>(m, "TaskError", PyExc_RuntimeError);
  m.def("instruction_set",
        [] { return videogrammetry::InstructionSetName(videogrammetry::DetectInstructionSet()); });
  videogrammetry::bindings::BindGeometry(m);
  videogrammetry::bindings::BindMatching(m);
  videogrammetry::bindings::BindReconstruction(m);
  videogrammetry::bindings::BindAdjustment(m);
  videogrammetry::bindings::BindRecognition(m);
  videogrammetry::bindings::BindRendering(m);
  videogrammetry::bindings::BindSequence(m);
  videogrammetry::bindings::BindTracking(m);
}
