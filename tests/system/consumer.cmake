# SPDX-License-Identifier: BSD-3-Clause
# Installs the core and kys from the build folder, and builds and runs a project that uses them.
include(${CMAKE_CURRENT_LIST_DIR}/../support/installed_consumer.cmake)
if(INSTALLED)  # where packaging/check_clean_root.sh unpacked libkys-slam-dev
  file(COPY ${INSTALLED}/ DESTINATION ${WORK}/first)
else()
  foreach(component kys kys_slam)
    run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first --component ${component})
  endforeach()
endif()
build_and_run_consumer()
if(NOT INSTALLED)  # there without OpenCV, which the builder needs
  run(${WORK}/build/builder)
endif()

# The examples as their users run them, with nothing in their environment.
function(run_example expected)
  execute_process(COMMAND env -i ${ARGN} WORKING_DIRECTORY ${WORK} RESULT_VARIABLE status
                  OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT status EQUAL 0 OR NOT out MATCHES "${expected}")
    message(FATAL_ERROR "${ARGN}\nstatus ${status}, and not \"${expected}\":\n${out}")
  endif()
  message(STATUS "${ARGN}: ${out}")
endfunction()

set(bin ${WORK}/build)
set(sequence ${WORK}/sequence)
run(${bin}/make_sequence ${sequence})
# Along the wall 8 frames lie 0.112 m apart; the poses are right to 3 cm.
run_example("^ATE 0\\.0[0-2][0-9]* m over 0\\.8 m\n$" ${bin}/track_sequence ${sequence} out.tum)
file(STRINGS ${WORK}/out.tum poses REGEX "^[^#]")
list(LENGTH poses count)
if(NOT count EQUAL 8)
  message(FATAL_ERROR "track_sequence wrote ${count} poses of 8")
endif()
set(tracked "8 frames with a pose; map of [1-9][0-9]* keyframes, [1-9][0-9][0-9]+ landmarks\n")
run_example("^sequence: ${tracked}sequence: ${tracked}$" ${bin}/reuse_map sequence sequence town.map)
set(frames)
foreach(i RANGE 7)
  list(APPEND frames ${sequence}/image_0/00000${i}.png ${sequence}/image_1/00000${i}.png)
endforeach()
set(frame "[a-z]+: [1-9][0-9]+ landmarks\n")
run_example("^\n${frame}${frame}${frame}${frame}${frame}${frame}${frame}${frame}$"
            ${bin}/own_camera ${sequence}/camchain.yaml ${frames})
set(late "frame 3: segments of frame 0\nframe 6: segments of frame 3\n8 frames tracked\n")
run_example("^${late}$" ${bin}/live_segmentation ${sequence})
if(EXISTS ${bin}/with_opencv_dnn)
  run_example("^${late}$" ${bin}/live_segmentation ${sequence} ${CONSUMER}/road_and_wall.onnx)
endif()
execute_process(COMMAND env -i ${bin}/live_segmentation ${sequence} none.onnx RESULT_VARIABLE status
                OUTPUT_QUIET ERROR_VARIABLE out)
if(NOT status EQUAL 2 OR NOT out MATCHES "none.onnx")
  message(FATAL_ERROR "a missing network: status ${status}, ${out}")
endif()
# What is not there is one line and status 2.
execute_process(COMMAND env -i ${bin}/track_sequence ${WORK}/nothing out.tum RESULT_VARIABLE status
                OUTPUT_QUIET ERROR_VARIABLE out)
if(NOT status EQUAL 2 OR NOT out MATCHES "^track_sequence: [^\n]*nothing[^\n]*\n$")
  message(FATAL_ERROR "a missing sequence: status ${status}, ${out}")
endif()
