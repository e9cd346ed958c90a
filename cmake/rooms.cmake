# add_room(<name> [<library>...])
#
# The library of one room: every .cpp below the current folder except main.cpp and folders with a CMakeLists.txt of
# their own, or an interface library while there is none. It publishes the include roots (repository and src/) and the
# libraries it is built on.
function(add_room name)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS *.cpp)
  list(FILTER sources EXCLUDE REGEX "/main\\.cpp$")
  file(GLOB separate CONFIGURE_DEPENDS */CMakeLists.txt)
  foreach(list_file IN LISTS separate)
    cmake_path(GET list_file PARENT_PATH folder)
    list(FILTER sources EXCLUDE REGEX "^${folder}/")
  endforeach()
  if(sources)
    add_library(${name} STATIC ${sources})
    set(scope PUBLIC)
  else()
    add_library(${name} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(${name} ${scope} ${CMAKE_SOURCE_DIR} ${CMAKE_SOURCE_DIR}/src)
  target_link_libraries(${name} ${scope} ${ARGN})
endfunction()
