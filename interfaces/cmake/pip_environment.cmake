# SPDX-License-Identifier: Apache-2.0
#
# What an interface package needs when ROS 2 comes from Python wheels in a virtual environment
# instead of from apt. Include it before project(). With a normal ROS installation it only
# checks for a compiler.

set(_pip_env_missing "")  # what the machine lacks, one sentence each

# --- 1. Find the environment ----------------------------------------------------------------
# Under pip (scikit-build-core sets SKBUILD) it is the running Python's, whatever ROS the shell
# has sourced. Under colcon it is a prefix in AMENT_PREFIX_PATH that is a virtual environment;
# there is none on a machine with a normal ROS installation.
set(_pip_env_prefix "")
if(DEFINED SKBUILD OR "$ENV{AMENT_PREFIX_PATH}" STREQUAL "")
  find_program(Python3_EXECUTABLE python3)
  # The package is <prefix>/lib/python3.x/site-packages/ament_package/__init__.py.
  execute_process(
    COMMAND "${Python3_EXECUTABLE}" -c
      "import ament_package, pathlib; print(pathlib.Path(ament_package.__file__).parents[4])"
    OUTPUT_VARIABLE _pip_env_prefix OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  if(NOT _pip_env_prefix)
    list(APPEND _pip_env_missing "the ROS 2 build tools: source a ROS 2 installation, or pip install -r interfaces/requirements-build.txt")
  endif()
  # rosidl looks for its type supports in the ament index.
  set(ENV{AMENT_PREFIX_PATH} "${_pip_env_prefix}")
else()
  string(REPLACE ":" ";" _pip_env_candidates "$ENV{AMENT_PREFIX_PATH}")
  foreach(_pip_env_candidate IN LISTS _pip_env_candidates)
    if(EXISTS "${_pip_env_candidate}/pyvenv.cfg")
      set(_pip_env_prefix "${_pip_env_candidate}")
      # The generators run in this Python; the first in PATH may be another one.
      find_program(Python3_EXECUTABLE python3 PATHS "${_pip_env_prefix}/bin" NO_DEFAULT_PATH)
      break()
    endif()
  endforeach()
endif()

# --- 2. Say in one message what is missing ----------------------------------------------------
# CMake's own words for a missing compiler are long, once per language, and do not name a package.
function(_pip_env_require_compiler title language variable)
  set(names ${ARGN})
  if(CMAKE_${language}_COMPILER)
    set(names "${CMAKE_${language}_COMPILER}")
  elseif(DEFINED ENV{${variable}})
    separate_arguments(names UNIX_COMMAND "$ENV{${variable}}")  # may be "gcc -m64"
    list(GET names 0 names)
  endif()
  find_program(compiler NAMES ${names} NO_CACHE)
  if(NOT compiler)
    list(JOIN names ", " names)
    list(APPEND _pip_env_missing "a ${title} compiler (looked for: ${names}). On Debian and Ubuntu: apt install build-essential")
    set(_pip_env_missing "${_pip_env_missing}" PARENT_SCOPE)
  endif()
endfunction()
if(CMAKE_HOST_UNIX AND NOT CMAKE_TOOLCHAIN_FILE)
  _pip_env_require_compiler("C" C CC cc gcc clang)
  _pip_env_require_compiler("C++" CXX CXX c++ g++ clang++)
endif()

if(_pip_env_prefix)
  execute_process(
    COMMAND "${Python3_EXECUTABLE}" -c
      "import sysconfig; print(sysconfig.get_path('include') + '/Python.h')"
    OUTPUT_VARIABLE _pip_env_header OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(NOT EXISTS "${_pip_env_header}")
    list(APPEND _pip_env_missing "Python's C headers (${_pip_env_header}). On Debian and Ubuntu: apt install python3-dev")
  endif()
endif()

if(_pip_env_missing)
  list(JOIN _pip_env_missing "\n  * " _pip_env_missing)
  message(FATAL_ERROR "To build ROS 2 interfaces this machine lacks:\n  * ${_pip_env_missing}")
endif()

# --- 3. Use the environment -----------------------------------------------------------------
if(NOT _pip_env_prefix)
  return()
endif()
list(PREPEND CMAKE_PREFIX_PATH "${_pip_env_prefix}")
set(rosidl_default_generators_DIR "${CMAKE_CURRENT_LIST_DIR}/rosidl_default_generators")

# The message wheels' imported targets name include directories of the machine that built them,
# and CMake refuses directories that do not exist.
function(_pip_env_drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(existing "")
    foreach(directory IN LISTS directories)
      if(directory MATCHES "\\$<" OR EXISTS "${directory}")
        list(APPEND existing "${directory}")
      endif()
    endforeach()
    set_property(TARGET ${target} PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${existing}")
  endforeach()
endfunction()
# Runs at the end of the CMakeLists.txt, after every find_package().
cmake_language(DEFER CALL _pip_env_drop_missing_include_directories)
