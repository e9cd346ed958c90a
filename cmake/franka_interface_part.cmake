# franka_interface_part(<name> <file.cpp> <file.proto>)
#
# Builds lib<name>.so, which franka-interface loads (--load), of a C++ file and its message; <name>_message, which a test of
# the part links; and the message's Python module in the build folder.
function(franka_interface_part name source proto)
  cmake_path(ABSOLUTE_PATH proto)
  cmake_path(GET proto PARENT_PATH folder)
  cmake_path(GET proto STEM stem)
  set(out ${CMAKE_CURRENT_BINARY_DIR})
  add_custom_command(
    OUTPUT ${out}/${stem}.pb.cc ${out}/${stem}.pb.h ${out}/${stem}_pb2.py
    COMMAND protobuf::protoc -I${folder} -Ifrankapy/proto=${franka-interface_PROTOS} --cpp_out=${out} --python_out=${out} ${proto}
    DEPENDS ${proto}
    VERBATIM)

  add_library(${name}_message STATIC ${out}/${stem}.pb.cc ${out}/${stem}.pb.h ${out}/${stem}_pb2.py)
  set_target_properties(${name}_message PROPERTIES POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden)
  target_include_directories(${name}_message PUBLIC ${out})
  target_link_libraries(${name}_message PUBLIC franka-interface::part)

  add_library(${name} MODULE ${source})
  set_target_properties(${name} PROPERTIES CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
  target_compile_options(${name} PRIVATE -Wall -Wextra)
  target_link_libraries(${name} PRIVATE ${name}_message)
  target_link_options(${name} PRIVATE LINKER:--no-undefined)  # here and not when the server starts
endfunction()
