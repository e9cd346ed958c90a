# What a library of parts is built against (docs/your-own-part.md): headers, messages, libraries, and the CMake package
# franka-interface; in the build tree, and where `cmake --install` puts it.

include(GNUInstallDirs)
set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/franka-interface)
set(package_include ${CMAKE_INSTALL_INCLUDEDIR}/franka-interface)
# Pinocchio stays in the Python environment.
set(CMAKE_INSTALL_RPATH "$ORIGIN/../${CMAKE_INSTALL_LIBDIR}" ${site_packages}/cmeel.prefix/lib)

# Headers that a part may be compiled with, below the repository or src/.
file(GLOB_RECURSE part_headers CONFIGURE_DEPENDS RELATIVE ${CMAKE_SOURCE_DIR}
  src/realtime/controllers/*.hpp src/realtime/terminations/*.hpp src/realtime/trajectories/*.hpp wire/fci/*.hpp)
list(APPEND part_headers
  models/arm.hpp models/joint_figures.hpp src/bridge/ring.hpp src/realtime/arm.hpp src/realtime/check.hpp src/realtime/cycle.hpp
  src/realtime/joint_range.hpp src/realtime/model.hpp src/realtime/part.hpp src/realtime/part_watch.hpp src/realtime/reference.hpp
  src/realtime/rotation.hpp src/realtime/ruckig_planner.hpp src/realtime/sensor_input.hpp src/realtime/slow.hpp
  src/realtime/soft_ending.hpp src/realtime/tick.hpp src/realtime/tool.hpp
  src/robot/collision_behavior.hpp src/robot/mode.hpp src/server/arm_at_home.hpp src/server/kinds/kind.hpp src/server/part.hpp
  wire/proto/rules.proto wire/proto/validation.hpp)

# Their hash, in build/generated/server/abi.hpp: a library that was compiled with others is refused.
file(STRINGS wire/proto/service.proto interface_version REGEX "CURRENT = [0-9]+;")
string(REGEX MATCH "[0-9]+" interface_version "${interface_version}")
set(abi_header ${CMAKE_BINARY_DIR}/generated/server/abi.hpp)
list(TRANSFORM part_headers PREPEND ${CMAKE_SOURCE_DIR}/ OUTPUT_VARIABLE part_header_files)
add_custom_command(
  OUTPUT ${abi_header}
  COMMAND ${CMAKE_COMMAND} -DOUTPUT=${abi_header} "-DHEADERS=${part_header_files}"
          "-DVERSION=franka-interface ${PROJECT_VERSION}, interface ${interface_version}" -P ${CMAKE_SOURCE_DIR}/cmake/abi.cmake
  DEPENDS ${part_header_files} ${CMAKE_SOURCE_DIR}/cmake/abi.cmake
  VERBATIM)
add_custom_target(part_abi DEPENDS ${abi_header})

function(export_package)
  get_target_property(eigen Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
  set(eigen_include ${eigen})
  set(part_options "")
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    set(part_options -march=x86-64-v2)  # as cmake/compiler.cmake
  endif()
  set(template ${CMAKE_SOURCE_DIR}/cmake/franka-interface-config.cmake.in)

  # In the build tree: the repository's own files.
  set(part_include "${CMAKE_SOURCE_DIR};${CMAKE_SOURCE_DIR}/src;${CMAKE_BINARY_DIR}/generated")
  set(part_protos ${CMAKE_SOURCE_DIR}/wire/proto)
  set(part_functions ${CMAKE_SOURCE_DIR}/cmake/franka_interface_part.cmake)
  set(part_libraries "$<TARGET_FILE:realtime>;$<TARGET_FILE:models>;$<TARGET_FILE:wire_proto>")
  set(client_libraries "$<TARGET_FILE:client>;$<TARGET_FILE:wire_proto>")
  configure_file(${template} ${CMAKE_BINARY_DIR}/package/build.cmake @ONLY)
  file(GENERATE OUTPUT ${CMAKE_BINARY_DIR}/franka-interface-config.cmake INPUT ${CMAKE_BINARY_DIR}/package/build.cmake)

  # Installed: what lies beside the package.
  set(root "\${CMAKE_CURRENT_LIST_DIR}/../../..")
  set(part_include "${root}/${package_include};${root}/${package_include}/src")
  set(part_protos ${root}/${package_include}/frankapy/proto)
  set(part_functions "\${CMAKE_CURRENT_LIST_DIR}/franka_interface_part.cmake")
  foreach(library realtime models wire_proto)
    list(APPEND installed ${root}/${CMAKE_INSTALL_LIBDIR}/$<TARGET_FILE_NAME:${library}>)
  endforeach()
  set(part_libraries "${installed}")
  set(client_libraries "")
  foreach(library client wire_proto)
    list(APPEND client_libraries ${root}/${CMAKE_INSTALL_LIBDIR}/$<TARGET_FILE_NAME:${library}>)
  endforeach()
  configure_file(${template} ${CMAKE_BINARY_DIR}/package/installed.cmake @ONLY)
  file(GENERATE OUTPUT ${CMAKE_BINARY_DIR}/package/franka-interface-config.cmake
    INPUT ${CMAKE_BINARY_DIR}/package/installed.cmake)

  install(TARGETS franka-interface realtime models wire_proto client)
  install(FILES ${CMAKE_SOURCE_DIR}/src/client/sensor_publisher.hpp DESTINATION ${package_include}/src/client)
  install(FILES ${CMAKE_BINARY_DIR}/package/franka-interface-config.cmake DESTINATION ${package_folder})
  install(FILES ${CMAKE_SOURCE_DIR}/cmake/franka_interface_part.cmake DESTINATION ${package_folder})
  foreach(header IN LISTS part_headers)
    cmake_path(GET header PARENT_PATH folder)
    install(FILES ${CMAKE_SOURCE_DIR}/${header} DESTINATION ${package_include}/${folder})
  endforeach()
  file(GLOB protos ${CMAKE_SOURCE_DIR}/wire/proto/*.proto)
  install(FILES ${protos} DESTINATION ${package_include}/frankapy/proto)
  foreach(name rules sensors)
    install(FILES ${CMAKE_BINARY_DIR}/generated/frankapy/proto/${name}.pb.h DESTINATION ${package_include}/frankapy/proto)
  endforeach()
  install(FILES ${abi_header} DESTINATION ${package_include}/server)
endfunction()
