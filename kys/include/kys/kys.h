// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// All headers of the library but matcher.h, which is for C++11, and option_list.h, which
// mode_options.h includes.
#include <kys/belief.h>
#include <kys/descriptor.h>
#include <kys/distance.h>
#include <kys/distance_model.h>
#include <kys/error.h>
#include <kys/hamming.h>
#include <kys/label_space.h>
#include <kys/mode_options.h>
#include <kys/prior.h>
#include <kys/statistics.h>
