#pragma once

#include <kys_slam/prior_format.h>  // moved; this file goes soon
