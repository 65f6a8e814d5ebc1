#pragma once

// The whole library.
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
