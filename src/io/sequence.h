#pragma once

#include <kys_slam/sequence.h>  // moved; this file goes soon
