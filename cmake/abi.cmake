# Writes OUTPUT: what VERSION and the bytes of HEADERS make together.
set(all "")
foreach(header IN LISTS HEADERS)
  file(SHA256 ${header} hash)
  string(APPEND all ${hash})
endforeach()
string(SHA256 hash "${all}")
string(SUBSTRING ${hash} 0 16 hash)
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT "#pragma once\n\n#define FRANKA_INTERFACE_ABI \"${VERSION}, headers ${hash}\"\n")
