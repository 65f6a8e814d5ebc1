# SPDX-License-Identifier: BSD-3-Clause
# Debian packages: cpack -G DEB in the build folder. kys-slam: the programs; libkys-slam-dev: headers,
# static libraries and CMake packages of kys and kys_slam.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_VENDOR "KYS-SLAM authors")
set(KYS_PACKAGE_CONTACT "KYS-SLAM authors <kys-slam@packages.invalid>"
    CACHE STRING "Maintainer of the Debian packages: NAME <MAIL>")
set(CPACK_PACKAGE_CONTACT "${KYS_PACKAGE_CONTACT}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL programs kys kys_slam)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_DEBIAN_PROGRAMS_PACKAGE_NAME kys-slam)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SECTION science)
set(CPACK_COMPONENT_PROGRAMS_GROUP programs)
set(CPACK_DEBIAN_PROGRAMS_DESCRIPTION "Programs that track stereo recordings (KITTI, Virtual KITTI 2, EuRoC), build
and check prior files, render simulated worlds and evaluate trajectories.")
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libkys-slam-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
  "libeigen3-dev, libopencv-dev, libyaml-cpp-dev, libspdlog-dev, libfmt-dev, nlohmann-json3-dev, libspng-dev, libdeflate-dev, libturbojpeg0-dev, pkg-config")
set(CPACK_COMPONENT_KYS_GROUP dev)
set(CPACK_COMPONENT_KYS_SLAM_GROUP dev)
set(CPACK_DEBIAN_DEV_DESCRIPTION "Headers, static libraries and CMake packages of the SLAM library kys_slam and
of the matching library kys.")

# What Debian asks every package for: copyright, and a changelog that is compressed without a date.
foreach(package kys-slam libkys-slam-dev)
  if(package STREQUAL "kys-slam")
    set(component programs)
  else()
    set(component kys_slam)
  endif()
  install(FILES ${PROJECT_SOURCE_DIR}/third_party/debian/copyright
          DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package} COMPONENT ${component}
          EXCLUDE_FROM_ALL)
  set(changelog ${PROJECT_BINARY_DIR}/debian/${package}/changelog.Debian.gz)
  file(WRITE ${PROJECT_BINARY_DIR}/debian/${package}/changelog.Debian
"${package} (${PROJECT_VERSION}-1) unstable; urgency=medium

  * See CHANGELOG.md in the source.

 -- ${CPACK_PACKAGE_CONTACT}  Thu, 01 Jan 2026 00:00:00 +0000
")
  find_program(GZIP_PROGRAM gzip)
  if(GZIP_PROGRAM)
    execute_process(COMMAND ${GZIP_PROGRAM} -9nfk ${PROJECT_BINARY_DIR}/debian/${package}/changelog.Debian)
    install(FILES ${changelog} DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package}
            COMPONENT ${component} EXCLUDE_FROM_ALL)
  endif()
endforeach()
include(CPack)
cpack_add_component_group(programs)
cpack_add_component_group(dev)
