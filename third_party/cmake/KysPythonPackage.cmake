# SPDX-License-Identifier: BSD-3-Clause
# python3-kys-slam: the Python package for Debian's own Python, where the module was built for it.
set(version ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR})
math(EXPR next "${Python3_VERSION_MINOR} + 1")
set(packages lib/python3/dist-packages)
set(folder ${PROJECT_BINARY_DIR}/debian/python3-kys-slam)
file(WRITE ${folder}/METADATA "Metadata-Version: 2.1\nName: kys-slam\nVersion: ${PROJECT_VERSION}\n")
file(WRITE ${folder}/INSTALLER "debian\n")
file(WRITE ${folder}/kys-slam "#!/usr/bin/python3\nimport sys\n\nfrom kys_slam.cli import main\n\nsys.exit(main())\n")

file(GLOB modules CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/python/kys_slam/*.py
     ${PROJECT_SOURCE_DIR}/python/kys_slam/py.typed)
install(FILES ${modules} DESTINATION ${packages}/kys_slam COMPONENT python_module EXCLUDE_FROM_ALL)
install(TARGETS kys_slam_core LIBRARY DESTINATION ${packages}/kys_slam COMPONENT python_module EXCLUDE_FROM_ALL)
install(FILES ${PROJECT_BINARY_DIR}/python/kys_slam/_core.pyi DESTINATION ${packages}/kys_slam
        COMPONENT python_module EXCLUDE_FROM_ALL)
install(FILES ${folder}/METADATA ${folder}/INSTALLER
        DESTINATION ${packages}/kys_slam-${PROJECT_VERSION}.dist-info COMPONENT python_module EXCLUDE_FROM_ALL)
install(PROGRAMS ${folder}/kys-slam DESTINATION bin COMPONENT python_module EXCLUDE_FROM_ALL)

kys_debian_package(python3-kys-slam COMPONENTS python_module SECTION python
  DEPENDS "python3 (>= ${version}), python3 (<< 3.${next}), python3-numpy"
  RECOMMENDS "kys-slam"
  SUGGESTS "kys-slam-maps, python3-opencv, python3-matplotlib"
  CONTROL ${PROJECT_SOURCE_DIR}/third_party/debian/python/postinst
          ${PROJECT_SOURCE_DIR}/third_party/debian/python/prerm
  DESCRIPTION "stereo visual SLAM with semantic priors - Python
The Python package kys_slam and the command kys-slam: tracks recordings and
images from a camera, plots and evaluates runs.")
