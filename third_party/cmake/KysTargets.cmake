# SPDX-License-Identifier: BSD-3-Clause
# How every target of this project is made: one warning level, one set of compile options.

set(KYS_WARNING_OPTIONS -Wall -Wextra -Wshadow -Wnon-virtual-dtor -Wno-psabi
    # GCC 12 sees overlapping copies in plain string concatenation (its bug 105329).
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
    # GCC 13 takes any reference returned by a call with a temporary argument for dangling.
    $<$<AND:$<CXX_COMPILER_ID:GNU>,$<VERSION_GREATER_EQUAL:$<CXX_COMPILER_VERSION>,13>>:-Wno-dangling-reference>)
if(KYS_WARNINGS_AS_ERRORS)
  list(APPEND KYS_WARNING_OPTIONS -Werror)
endif()

# Floating-point contraction depends on the target machine; without it a result does not.
set(KYS_COMPILE_OPTIONS -ffp-contract=off)
if(KYS_NATIVE)
  list(APPEND KYS_COMPILE_OPTIONS -march=native)
endif()
if(KYS_SANITIZE)
  list(APPEND KYS_COMPILE_OPTIONS -fsanitize=${KYS_SANITIZE} -fno-omit-frame-pointer -g1)
  if(KYS_SANITIZE MATCHES "undefined")
    # One check per member access: GCC takes minutes for a file of Eigen. AddressSanitizer sees what
    # comes of the first and the last. What is found ends the program, so that its test fails.
    list(APPEND KYS_COMPILE_OPTIONS -fno-sanitize=null,alignment,object-size
                                    -fno-sanitize-recover=undefined)
  endif()
  add_link_options(-fsanitize=${KYS_SANITIZE})
endif()

# Eigen as on x86-64: third_party/eigen/sse_on_arm64.h.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64|ARM64")
  find_path(SIMDE_INCLUDE_DIR simde/x86/sse2.h)
  if(NOT SIMDE_INCLUDE_DIR)
    message(FATAL_ERROR "SIMDe is missing, which the build for ARM64 needs (package libsimde-dev)")
  endif()
  if(NOT SIMDE_INCLUDE_DIR MATCHES "/usr/include$")  # where the compiler looks, behind its own folders
    list(APPEND KYS_COMPILE_OPTIONS "SHELL:-isystem ${SIMDE_INCLUDE_DIR}")
  endif()
  list(APPEND KYS_COMPILE_OPTIONS
    "SHELL:-include ${PROJECT_SOURCE_DIR}/third_party/eigen/sse_on_arm64.h")
endif()

# kys_add_library(NAME SOURCES... [DEPENDS targets...] [SYSTEM_DEPENDS imported targets...])
# A static library called kys_slam_NAME. Those who link it see the public headers; the headers of src
# are seen in src, priors and tests alone (include_directories there), not by tools and Python.
function(kys_add_library name)
  cmake_parse_arguments(ARG "" "" "DEPENDS" ${ARGN})
  set(target kys_slam_${name})
  if(ARG_UNPARSED_ARGUMENTS)
    add_library(${target} STATIC ${ARG_UNPARSED_ARGUMENTS})
    set(scope PUBLIC)
    target_compile_options(${target} PRIVATE ${KYS_WARNING_OPTIONS} ${KYS_COMPILE_OPTIONS})
    set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  target_include_directories(${target} ${scope}
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(${target} ${scope} ${ARG_DEPENDS})
endfunction()

# kys_add_program(NAME SOURCES... [COMPONENT name] DEPENDS targets...): an installed command line program.
# The component is the Debian package it goes into (KysPackage.cmake), by default `programs`.
function(kys_add_program name)
  cmake_parse_arguments(ARG "" "COMPONENT" "DEPENDS" ${ARGN})
  if(NOT ARG_COMPONENT)
    set(ARG_COMPONENT programs)
  endif()
  add_executable(${name} ${ARG_UNPARSED_ARGUMENTS})
  target_compile_options(${name} PRIVATE ${KYS_WARNING_OPTIONS} ${KYS_COMPILE_OPTIONS})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS})
  install(TARGETS ${name} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT ${ARG_COMPONENT})
endfunction()

# kys_add_test(NAME SOURCES... DEPENDS targets... [LABELS labels...]): a GoogleTest program, one
# ctest entry per TEST. Tests find data of the tree under KYS_SOURCE_DIR and real excerpts, when
# they are there, under KYS_SHARED_DATA_DIR (see tests/README.md).
function(kys_add_test name)
  if(NOT KYS_BUILD_TESTS)
    return()
  endif()
  cmake_parse_arguments(ARG "" "" "DEPENDS;LABELS" ${ARGN})
  if(NOT ARG_LABELS)
    set(ARG_LABELS unit)
  endif()
  add_executable(${name} ${ARG_UNPARSED_ARGUMENTS})
  target_compile_options(${name} PRIVATE ${KYS_WARNING_OPTIONS} ${KYS_COMPILE_OPTIONS})
  target_compile_definitions(${name} PRIVATE
    KYS_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    KYS_BINARY_DIR="${PROJECT_BINARY_DIR}"
    KYS_BIN_DIR="${CMAKE_RUNTIME_OUTPUT_DIRECTORY}"
    KYS_SHARED_DATA_DIR="${PROJECT_SOURCE_DIR}/../shared/data")
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} GTest::gtest GTest::gtest_main)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/tests)
  if(KYS_UNITY_TESTS)
    set_target_properties(${name} PROPERTIES UNITY_BUILD ON)
  endif()
  gtest_discover_tests(${name} TEST_PREFIX "${name}/" PROPERTIES LABELS "${ARG_LABELS}"
                       DISCOVERY_TIMEOUT 60)
endfunction()

# kys_add_benchmark(NAME SOURCES... DEPENDS targets...): a Google Benchmark program, run by hand.
function(kys_add_benchmark name)
  if(NOT KYS_BUILD_BENCHMARKS)
    return()
  endif()
  cmake_parse_arguments(ARG "" "" "DEPENDS" ${ARGN})
  add_executable(${name} ${ARG_UNPARSED_ARGUMENTS})
  target_compile_options(${name} PRIVATE ${KYS_WARNING_OPTIONS} ${KYS_COMPILE_OPTIONS})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} benchmark::benchmark)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/benchmarks)
endfunction()

# kys_add_kernels(NAME STEM [NEON])
# Inner loops of kys_slam_NAME, once per instruction set and chosen at run time: STEM_plain.cpp and,
# on x86, STEM_avx2.cpp and STEM_avx512.cpp. On ARM64 the vectoriser makes NEON of the plain ones; NEON
# says that there is STEM_neon.cpp with intrinsics too. They count on the vectoriser, so they are optimised in
# every build type but the sanitizers'.
function(kys_add_kernels name stem)
  set(options -fno-math-errno)
  if(NOT KYS_SANITIZE)
    list(APPEND options -O3)
  endif()
  target_sources(kys_slam_${name} PRIVATE ${stem}_plain.cpp)
  set_source_files_properties(${stem}_plain.cpp PROPERTIES COMPILE_OPTIONS "${options}")
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    target_sources(kys_slam_${name} PRIVATE ${stem}_avx2.cpp ${stem}_avx512.cpp)
    target_compile_definitions(kys_slam_${name} PRIVATE KYS_X86_KERNELS)
    set_source_files_properties(${stem}_avx2.cpp PROPERTIES
      COMPILE_OPTIONS "${options};-mavx2;-mno-fma")
    set_source_files_properties(${stem}_avx512.cpp PROPERTIES
      COMPILE_OPTIONS "${options};-mavx512bw;-mavx512vl;-mavx512dq;-mprefer-vector-width=512")
  elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64|ARM64" AND "NEON" IN_LIST ARGN)
    target_sources(kys_slam_${name} PRIVATE ${stem}_neon.cpp)
    target_compile_definitions(kys_slam_${name} PRIVATE KYS_NEON_KERNELS)
    set_source_files_properties(${stem}_neon.cpp PROPERTIES COMPILE_OPTIONS "${options}")
  endif()
endfunction()
