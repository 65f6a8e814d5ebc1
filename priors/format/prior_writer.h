#pragma once

#include <kys_slam/prior_writer.h>  // moved; this file goes soon
