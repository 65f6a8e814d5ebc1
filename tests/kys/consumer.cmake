# SPDX-License-Identifier: BSD-3-Clause
# Builds kys alone, installs it, and builds and runs a project that uses it.
include(${CMAKE_CURRENT_LIST_DIR}/../support/installed_consumer.cmake)
run(${CMAKE_COMMAND} -S ${KYS_FOLDER} -B ${WORK}/kys -G ${GENERATOR} -DCMAKE_CXX_COMPILER=${COMPILER}
    -DCMAKE_BUILD_TYPE=Release -DCMAKE_INSTALL_PREFIX=${WORK}/first)
run(${CMAKE_COMMAND} --build ${WORK}/kys)
run(${CMAKE_COMMAND} --install ${WORK}/kys)
build_and_run_consumer()
foreach(standard 11 14 17 20)
  run(${WORK}/build/old_consumer_${standard})
endforeach()
