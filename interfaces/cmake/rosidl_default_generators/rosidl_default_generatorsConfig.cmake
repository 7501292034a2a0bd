# SPDX-License-Identifier: Apache-2.0
#
# Generators of what rclpy loads: messages in C and Python, with their type supports in C.
# The genuine package adds four generators of C++ code, which take two thirds of the time to
# build and serve C++ nodes only. It is used where ROS is installed normally.
find_package(ament_cmake_core REQUIRED)
find_package(rosidl_cmake REQUIRED)
foreach(_generator IN ITEMS
    rosidl_generator_type_description
    rosidl_generator_c
    rosidl_typesupport_introspection_c
    rosidl_typesupport_fastrtps_c
    rosidl_typesupport_c
    rosidl_generator_py)
  find_package(${_generator} REQUIRED)
endforeach()

# Message packages that are found later register the generators of C++. CMake names the original
# macro with an underscore.
macro(rosidl_generate_interfaces)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
  _rosidl_generate_interfaces(${ARGN})
endmacro()
