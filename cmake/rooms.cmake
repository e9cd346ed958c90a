# add_room(<name> [<library>...])
#
# The library of one room: every .cpp below the current folder except main.cpp, or an interface library while there
# is none. It publishes the include roots (repository and src/) and the libraries it is built on.
function(add_room name)
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS *.cpp)
  list(FILTER sources EXCLUDE REGEX "/main\\.cpp$")
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
