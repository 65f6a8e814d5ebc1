# SPDX-License-Identifier: BSD-3-Clause
"""Limits of files, memory, threads and descriptors."""
import os
import resource
import shutil

from harness import (FRAMES, HEIGHT, WIDTH, as_nobody, case, expect, lines, png, refused, saved,
                     write_calibration)


def limit(kind, value):
    return lambda: resource.setrlimit(kind, (value, value))


@case
def limits_file_size(f, programs):
    result = programs.kitti(f, "--save-map", f("m.map"), before=limit(resource.RLIMIT_FSIZE, 8192))
    expect(result.status == 2, f"status {result.status}")
    expect("File too large" in result.err, result.err)
    expect(lines(os.path.join(f.output, "trajectory.kitti")) == FRAMES, "frames are lost")
    expect(not [n for n in os.listdir(f.output) if n.startswith(".")], "left files")


@case
def limits_memory(f, programs):
    for megabytes in [*range(80, 140, 4), *range(140, 420, 20)]:
        shutil.rmtree(f.output, ignore_errors=True)
        result = programs.kitti(f, before=limit(resource.RLIMIT_AS, megabytes << 20))
        # 127: the loader itself had no room.
        expect(result.status in (0, 2, 127), f"{megabytes} MB: {result.status}: {result.err}")
        expect(result.status != 2 or "memory" in result.err or "thread" in result.err or
               "resource" in result.err.lower(), f"{megabytes} MB: {result.err}")


@case
def limits_threads(f, programs):
    os.chmod(f.path, 0o777)
    # The search for leaks would need a thread of its own.
    result = programs.kitti(f, before=as_nobody(limit(resource.RLIMIT_NPROC, 1)),
                            env=dict(os.environ, ASAN_OPTIONS="detect_leaks=0"))
    expect(result.status in (0, 2), f"status {result.status}: {result.err}")
    expect(result.status == 0 or "cannot start a thread" in result.err, result.err)


def with_memory(megabytes):
    return dict(os.environ, KYS_MEMORY_MB=str(megabytes))


@case
def limits_memory_of_an_input(f, programs):
    """Refused by what it says it needs, before the machine finds out."""
    for camera in (0, 1):
        png(f.image(0, camera), [bytes(WIDTH)] * 8, 16384, 16384)
    write_calibration(f.sequence)
    big = programs.kitti(f)
    refused(big, "000000.png")
    side = 9000
    rows = [bytes(side)] * side
    png(f.image(0, 0), rows)
    refused(programs.kitti(f, env=with_memory(100)), "000000.png", "needs 162 MB of memory",
            "the limit is 100 MB", "KYS_MEMORY_MB")
    refused(programs.kitti(f, env=with_memory("much")), "KYS_MEMORY_MB", "'much'")


@case
def limits_memory_of_short_lines(f, programs):
    f.write("seq/times.txt", "1\n" * 1000000)
    refused(programs.kitti(f, env=with_memory(60)), "times.txt: needs 96 MB of memory",
            "the limit is 60 MB")


@case
def limits_memory_of_pairs_of_objects(f, programs):
    f.write("run/objects.csv", "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,"
            "vz,sigma_v\n" + "".join(f"0,0,0,{i},car,1,30,0,0,9,0,0,0,1\n" for i in range(2000)))
    f.write("run/frames.csv", "index,name,timestamp,status,submap\n0,0,0,tracked,0\n")
    f.write("run/trajectory.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n")
    f.write("run/ground_truth.tum", "0 0 0 0 0 0 0 1\n")
    f.write("truth.txt", "".join(f"0 {i} Car 0 0 0 1 2 3 4 1.5 1.8 4.2 0 0 9 0\n"
                                 for i in range(2000)))
    refused(programs.run("evaluate_objects", f("run"), "--truth", f("truth.txt"),
                         env=with_memory(100)), "frame 0", "needs 384 MB of memory")


@case
def limits_memory_in_use(f, programs):
    """The trajectory so far is saved when the limit is passed while tracking."""
    result = programs.kitti(f, env=with_memory(10))
    refused(result, "out of memory", "the limit is 10 MB")
    summary = saved(f, 1)
    expect("out of memory" in summary["end_reason"], summary)


@case
def limits_descriptors(f, programs):
    for count in range(3, 16):
        shutil.rmtree(f.output, ignore_errors=True)
        result = programs.kitti(f, before=limit(resource.RLIMIT_NOFILE, count))
        expect(result.status in (0, 2, 127), f"{count} descriptors: {result.status}: {result.err}")


@case
def limits_a_huge_image_in_the_middle(f, programs):
    png(f.image(7), [bytes(WIDTH)] * HEIGHT, 16384, 16384)
    refused(programs.kitti(f, before=limit(resource.RLIMIT_AS, 700 << 20)), "000007.png")
    saved(f, 7)
