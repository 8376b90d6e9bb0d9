# OpenCV's core and imgproc alone, from libopencv-core-dev and
# libopencv-imgproc-dev (83 packages) instead of libopencv-dev, whose CMake
# configuration brings 421 packages. Where that configuration is installed
# anyway (vcpkg, Homebrew, conda), it is used.

find_package(OpenCV QUIET CONFIG COMPONENTS core imgproc)
if(OpenCV_FOUND)
  if(NOT TARGET OpenCVCore::imgproc)
    add_library(OpenCVCore::imgproc INTERFACE IMPORTED)
    target_include_directories(OpenCVCore::imgproc SYSTEM INTERFACE ${OpenCV_INCLUDE_DIRS})
    target_link_libraries(OpenCVCore::imgproc INTERFACE ${OpenCV_LIBS})
  endif()
  set(OpenCVCore_FOUND TRUE)
  return()
endif()

find_path(OpenCVCore_INCLUDE_DIR opencv2/imgproc.hpp PATH_SUFFIXES opencv4)
find_library(OpenCVCore_core_LIBRARY opencv_core)
find_library(OpenCVCore_imgproc_LIBRARY opencv_imgproc)
include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenCVCore
  REASON_FAILURE_MESSAGE "install libopencv-core-dev and libopencv-imgproc-dev (scripts/setup does)"
  REQUIRED_VARS OpenCVCore_core_LIBRARY OpenCVCore_imgproc_LIBRARY OpenCVCore_INCLUDE_DIR)
if(OpenCVCore_FOUND AND NOT TARGET OpenCVCore::imgproc)
  add_library(OpenCVCore::imgproc INTERFACE IMPORTED)
  target_include_directories(OpenCVCore::imgproc SYSTEM INTERFACE "${OpenCVCore_INCLUDE_DIR}")
  target_link_libraries(OpenCVCore::imgproc INTERFACE
    "${OpenCVCore_imgproc_LIBRARY}" "${OpenCVCore_core_LIBRARY}")
endif()
