#pragma once

#include <kys_slam/trajectory_file.h>  // moved; this file goes soon
