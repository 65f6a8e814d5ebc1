#pragma once

#include <kys_slam/prior_file.h>  // moved; this file goes soon
