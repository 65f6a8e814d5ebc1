#include <kys_slam/error.h>

#include "world.h"

namespace kys_slam::simulator {
World make_block(const WorldOptions&) { throw InputError("world 'block' is not there yet"); }
}  // namespace kys_slam::simulator
