#pragma once

#include <kys_slam/image_file.h>  // moved; this file goes soon
