# Language, optimisation, warnings and sanitizers for every target.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "Build type" FORCE)
endif()
# Line tables are enough for backtraces and profiles, and keep Pinocchio's templates quick to compile.
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g1 -DNDEBUG")

# The wheels' Eigen is built for baseline alignment: with AVX (native, x86-64-v3) its objects would differ in
# layout between our code and theirs, and crash.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  add_compile_options(-march=x86-64-v2)
endif()

find_program(CCACHE ccache)
if(CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE})
endif()

add_compile_options(-Wall -Wextra -Wpedantic)
# Collects garbage only where there is much: most of the larger files are compiled a tenth to a fifth sooner.
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  add_compile_options(--param=ggc-min-heapsize=4194304)
endif()

# Compiles Eigen's expressions sooner, with the same layout of its objects.
set(WITHOUT_SIMD EIGEN_DONT_VECTORIZE EIGEN_MAX_ALIGN_BYTES=16 EIGEN_MAX_STATIC_ALIGN_BYTES=16)

set(SANITIZE "" CACHE STRING "Sanitizers for the whole build: empty, address,undefined or thread")
set(PLAIN_BUILD "" CACHE PATH "Build without sanitizers, from which a sanitized one takes what it need not compile; may be empty")
if(SANITIZE)
  # What takes longest to compile is left out: optimisation, SIMD, and checks that the address sanitizer makes as well.
  set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O1 -g1 -DNDEBUG")
  add_compile_definitions(${WITHOUT_SIMD})
  add_compile_options(-fsanitize=${SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer
                      -fno-sanitize=null,object-size)
  add_link_options(-fsanitize=${SANITIZE})
  # Half of the time where Eigen's expressions are many, which take no bytes apart: for the rooms of those.
  if(SANITIZE MATCHES undefined)
    set(bytes alignment,pointer-overflow,vptr)
    set(WITHOUT_BYTES -fno-sanitize=${bytes})
    set(WITH_BYTES -fsanitize=${bytes})
    # Calls instead of checks in line: 5 to 17 % sooner compiled.
    add_compile_options(--param=asan-instrumentation-with-call-threshold=0)
  endif()
  # With the address sanitizer Eigen would align its memory by hand, and could not free what the wheels' Eigen took with
  # malloc, nor they ours. The sanitizer's malloc is aligned enough.
  add_compile_definitions(EIGEN_MALLOC_ALREADY_ALIGNED=1)
endif()
