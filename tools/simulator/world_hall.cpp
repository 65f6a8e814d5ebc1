#include <kys_slam/error.h>

#include "world.h"

namespace kys_slam::simulator {
World make_hall(const WorldOptions&) { throw InputError("world 'hall' is not there yet"); }
}  // namespace kys_slam::simulator
