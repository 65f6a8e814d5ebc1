# Installs the core and kys from the build folder, and builds and runs a project that uses them.
include(${CMAKE_CURRENT_LIST_DIR}/../support/installed_consumer.cmake)
foreach(component kys kys_slam)
  run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first --component ${component})
endforeach()
build_and_run_consumer()
