#include <kys/hamming.h>

namespace kys::detail {

#if KYS_POPCNT_AT_RUN_TIME
namespace {

bool detect_popcnt() {
  __builtin_cpu_init();
  return __builtin_cpu_supports("popcnt") != 0;
}

}  // namespace

const bool has_popcnt = detect_popcnt();
#endif

}  // namespace kys::detail
