# Libraries from the Python environment (PYTHON_ENV) and from the system.
# Gives: pinocchio::pinocchio, ruckig::ruckig, mujoco::mujoco; libzmq, libzstd as PkgConfig::*, the rest under
# their own names.

# --- from the Python environment -------------------------------------------------------------------------------

file(GLOB site_packages ${PYTHON_ENV}/lib/python3*/site-packages)
list(LENGTH site_packages count)
if(NOT count EQUAL 1)
  message(FATAL_ERROR "PYTHON_ENV=${PYTHON_ENV} should hold one lib/python3*/site-packages, and holds ${count}. "
                      "`make setup` makes .venv; pass -DPYTHON_ENV=... for another one.")
endif()

# First in the search path, so that a system-wide Eigen, Boost or urdfdom is not mixed in.
list(PREPEND CMAKE_PREFIX_PATH ${site_packages}/cmeel.prefix)
set(Boost_NO_WARN_NEW_VERSIONS ON)  # the wheel's Boost is newer than Debian's CMake
find_package(pinocchio REQUIRED)
# Its libraries take a symbol of newer libstdc++ from liboctomath, which they load but ld passes over as not needed.
set_property(TARGET pinocchio::pinocchio APPEND PROPERTY INTERFACE_LINK_OPTIONS LINKER:--allow-shlib-undefined)

find_package(ruckig REQUIRED PATHS ${site_packages}/lib64/cmake/ruckig ${site_packages}/lib/cmake/ruckig NO_DEFAULT_PATH)
# The wheel switches on a client for a cloud service, whose symbols the library lacks.
set_property(TARGET ruckig::ruckig PROPERTY INTERFACE_COMPILE_DEFINITIONS)

# The wheel has headers and the library under its exact version only.
file(GLOB mujoco_library ${site_packages}/mujoco/libmujoco.so.*)
list(LENGTH mujoco_library count)
if(NOT count EQUAL 1)
  message(FATAL_ERROR "${site_packages}/mujoco should hold one libmujoco.so.*, and holds ${count}: "
                      "install mujoco-core as pinned in requirements.lock, and no package `mujoco` beside it.")
endif()
add_library(mujoco::mujoco SHARED IMPORTED)
set_target_properties(mujoco::mujoco PROPERTIES
  IMPORTED_LOCATION ${mujoco_library}
  INTERFACE_INCLUDE_DIRECTORIES ${site_packages}/mujoco/include)

# --- from the system -------------------------------------------------------------------------------------------

find_package(Threads REQUIRED)
find_package(Protobuf REQUIRED)
find_package(GTest REQUIRED)
find_package(benchmark REQUIRED)
find_package(spdlog REQUIRED)
find_package(CLI11 REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(libzmq REQUIRED IMPORTED_TARGET libzmq)  # cppzmq: headers only, in the default include path
pkg_check_modules(libzstd REQUIRED IMPORTED_TARGET libzstd)
