# SPDX-License-Identifier: BSD-3-Clause
# Debian packages: cpack -G DEB in the build folder. packaging/README.md says what is in each.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR "KYS-SLAM authors")
set(KYS_PACKAGE_CONTACT "KYS-SLAM authors <kys-slam@packages.invalid>"
    CACHE STRING "Maintainer of the Debian packages: NAME <MAIL>")
set(CPACK_PACKAGE_CONTACT "${KYS_PACKAGE_CONTACT}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL "")
find_package(Python3 QUIET COMPONENTS Interpreter)
find_program(GZIP_PROGRAM gzip)

# What Debian asks every package for: copyright, and a changelog that is compressed without a date. And
# the list of what is compiled in (packaging/sbom.py): kys_package_documents(PACKAGE COMPONENT COPYRIGHT)
function(kys_package_documents package component copyright)
  set(folder ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package})
  install(FILES ${PROJECT_SOURCE_DIR}/third_party/debian/${copyright} RENAME copyright
          DESTINATION ${folder} COMPONENT ${component} EXCLUDE_FROM_ALL)
  set(changelog ${PROJECT_BINARY_DIR}/debian/${package}/changelog.Debian)
  file(WRITE ${changelog}
"${package} (${PROJECT_VERSION}-1) unstable; urgency=medium

  * See CHANGELOG.md in the source.

 -- ${CPACK_PACKAGE_CONTACT}  Thu, 01 Jan 2026 00:00:00 +0000
")
  if(GZIP_PROGRAM)
    execute_process(COMMAND ${GZIP_PROGRAM} -9nfk ${changelog})
    install(FILES ${changelog}.gz DESTINATION ${folder} COMPONENT ${component} EXCLUDE_FROM_ALL)
  endif()
  if(Python3_Interpreter_FOUND)
    install(CODE "
      set(folder \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${folder}\")
      file(MAKE_DIRECTORY \"\${folder}\")
      execute_process(COMMAND \"${Python3_EXECUTABLE}\" \"${PROJECT_SOURCE_DIR}/packaging/sbom.py\"
                              package ${package} \"\${folder}\" COMMAND_ERROR_IS_FATAL ANY)"
      COMPONENT ${component} EXCLUDE_FROM_ALL)
  endif()
endfunction()

# kys_debian_package(NAME COMPONENTS names... SECTION name DESCRIPTION text [COPYRIGHT file]
#                    [DEPENDS list] [RECOMMENDS list] [SUGGESTS list] [CONTROL files...])
# A package of install components. The group of CPack is named like the first of them, with _package.
macro(kys_debian_package name)
  cmake_parse_arguments(ARG "" "SECTION;DESCRIPTION;COPYRIGHT;DEPENDS;RECOMMENDS;SUGGESTS" "COMPONENTS;CONTROL"
                        ${ARGN})
  list(GET ARG_COMPONENTS 0 first)
  set(group ${first}_package)
  string(TOUPPER ${group} upper)
  foreach(component IN LISTS ARG_COMPONENTS)
    string(TOUPPER ${component} upper_component)
    set(CPACK_COMPONENT_${upper_component}_GROUP ${group})
  endforeach()
  list(APPEND CPACK_COMPONENTS_ALL ${ARG_COMPONENTS})
  list(APPEND KYS_PACKAGE_GROUPS ${group})
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${name})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${ARG_SECTION})
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${ARG_DESCRIPTION}")
  foreach(relation DEPENDS RECOMMENDS SUGGESTS)
    if(ARG_${relation})
      set(CPACK_DEBIAN_${upper}_PACKAGE_${relation} "${ARG_${relation}}")
    endif()
  endforeach()
  if(ARG_CONTROL)
    set(CPACK_DEBIAN_${upper}_PACKAGE_CONTROL_EXTRA ${ARG_CONTROL})
  endif()
  if(NOT ARG_COPYRIGHT)
    set(ARG_COPYRIGHT copyright)
  endif()
  kys_package_documents(${name} ${first} ${ARG_COPYRIGHT})
endmacro()

kys_debian_package(kys-slam COMPONENTS programs SECTION science
  SUGGESTS "kys-slam-priors, kys-slam-maps, kys-slam-simulator, python3-kys-slam"
  DESCRIPTION "stereo visual SLAM with semantic priors
Programs that track stereo recordings (KITTI, Virtual KITTI 2, EuRoC), check
and compare prior files, show saved maps and evaluate trajectories.")

if(TARGET build_priors)
  kys_debian_package(kys-slam-priors COMPONENTS prior_programs SECTION science
    RECOMMENDS kys-slam
    DESCRIPTION "stereo visual SLAM with semantic priors - prior builder
The program that makes prior files for kys-slam from panoptic segmentation,
disparity and optical flow. It uses OpenCV.")
endif()

if(TARGET simulate_features)
  kys_debian_package(kys-slam-simulator COMPONENTS simulator_programs SECTION science
    RECOMMENDS kys-slam
    DESCRIPTION "stereo visual SLAM with semantic priors - simulator
Programs that render stereo recordings of simulated worlds, or simulate the
features that a camera sees, with exact ground truth.")
endif()

if(TARGET calibrate_rig)
  kys_debian_package(kys-slam-maps COMPONENTS map_programs SECTION science COPYRIGHT copyright.maps
    RECOMMENDS kys-slam
    DESCRIPTION "stereo visual SLAM with semantic priors - adjustment of maps
Programs that calibrate a stereo rig, and refine, merge and evaluate maps.
They are linked with SuiteSparse, of which parts are under the GNU General
Public License: this package, unlike the others, is distributed under the
terms of the GPL, version 3 or later.")
endif()

kys_debian_package(libkys-slam-dev COMPONENTS kys_slam kys SECTION libdevel
  DEPENDS "libeigen3-dev, libyaml-cpp-dev, libfmt-dev, nlohmann-json3-dev, libspng-dev, libdeflate-dev, libturbojpeg0-dev, pkg-config"
  RECOMMENDS "libopencv-dev"  # for kys_slam::prior_builder and kys_slam/opencv.h
  DESCRIPTION "stereo visual SLAM with semantic priors - development files
Headers, static libraries and CMake packages of the SLAM library kys_slam and
of the matching library kys.")
set(CPACK_DEBIAN_KYS_SLAM_PACKAGE_PACKAGE_SHLIBDEPS OFF)

if(TARGET kys_slam_core)
  include(KysPythonPackage)
endif()

include(CPack)
foreach(group IN LISTS KYS_PACKAGE_GROUPS)
  cpack_add_component_group(${group})
endforeach()
