# A room is one static library videogrammetry_<name> (alias
# videogrammetry::<name>) that names its links, and one GoogleTest binary
# <name>_test. `docs/architecture.toml` says which rooms may know which.

include_guard(GLOBAL)

# Interface target that carries what every room shares: warnings, sanitizers,
# the include root. Baseline x86-64 only: a file that needs more is compiled
# with its own flags by the room that owns it and is called through run-time
# dispatch (core/cpu.h).
add_library(videogrammetry_common INTERFACE)
target_include_directories(videogrammetry_common INTERFACE "${CMAKE_CURRENT_SOURCE_DIR}/cpp")
target_compile_features(videogrammetry_common INTERFACE cxx_std_20)
if(MSVC)
  target_compile_options(videogrammetry_common INTERFACE /W4 /permissive- /bigobj)
  target_compile_definitions(videogrammetry_common INTERFACE _USE_MATH_DEFINES NOMINMAX)
else()
  target_compile_options(videogrammetry_common INTERFACE -Wall -Wextra -Wshadow -Wnon-virtual-dtor
    -Woverloaded-virtual -Wcast-align -Wunused -fvisibility=hidden -fvisibility-inlines-hidden)
endif()
if(VIDEOGRAMMETRY_WERROR)
  target_compile_options(videogrammetry_common INTERFACE $<IF:$<BOOL:${MSVC}>,/WX,-Werror>)
endif()
if(VIDEOGRAMMETRY_SANITIZE)
  target_compile_options(videogrammetry_common INTERFACE
    -fsanitize=${VIDEOGRAMMETRY_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(videogrammetry_common INTERFACE -fsanitize=${VIDEOGRAMMETRY_SANITIZE})
  # GCC's manual (Instrumentation Options): sanitizers make its flow warnings
  # report what does not happen, here a copied std::optional that is empty.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    target_compile_options(videogrammetry_common INTERFACE -Wno-maybe-uninitialized)
  endif()
endif()

# vg_add_room(<name> SOURCES <files...> [LINKS <public targets...>] [PRIVATE_LINKS <targets...>])
function(vg_add_room name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINKS;PRIVATE_LINKS" ${ARGN})
  add_library(videogrammetry_${name} STATIC ${ARG_SOURCES})
  add_library(videogrammetry::${name} ALIAS videogrammetry_${name})
  target_link_libraries(videogrammetry_${name} PUBLIC videogrammetry_common ${ARG_LINKS}
    PRIVATE ${ARG_PRIVATE_LINKS})
endfunction()

# vg_add_room_test(<name> SOURCES <files...> [LINKS <targets...>])
function(vg_add_room_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINKS" ${ARGN})
  add_executable(${name}_test ${ARG_SOURCES})
  target_link_libraries(${name}_test PRIVATE videogrammetry::${name} ${ARG_LINKS}
    GTest::gtest_main)
  gtest_discover_tests(${name}_test TEST_PREFIX "${name}." DISCOVERY_TIMEOUT 60)
endfunction()

# vg_avx2_kernels(<files...> OUT <variable>)
# Files compiled for AVX2, chosen at run time (core/cpu.h); none on other processors.
function(vg_avx2_kernels)
  cmake_parse_arguments(ARG "" "OUT" "" ${ARGN})
  set(${ARG_OUT} "" PARENT_SCOPE)
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64|amd64")
    set_source_files_properties(${ARG_UNPARSED_ARGUMENTS} PROPERTIES COMPILE_OPTIONS
      "$<IF:$<BOOL:${MSVC}>,/arch:AVX2,-mavx2>")
    set(${ARG_OUT} ${ARG_UNPARSED_ARGUMENTS} PARENT_SCOPE)
  endif()
endfunction()
