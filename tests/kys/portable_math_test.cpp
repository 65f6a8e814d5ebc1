// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/portable_math.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

namespace kys {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// A function of one argument, the same in extended precision, and a range.
struct Function {
  std::string name;
  std::function<double(double)> portable;
  std::function<long double(long double)> exact;
  double from, to;
};

std::vector<Function> functions() {
  using Extended = long double;
  const auto sin = [](Extended x) { return std::sin(x); };
  const auto cos = [](Extended x) { return std::cos(x); };
  const auto tan = [](Extended x) { return std::tan(x); };
  const auto exp = [](Extended x) { return std::exp(x); };
  const auto log = [](Extended x) { return std::log(x); };
  const auto log1p = [](Extended x) { return std::log1p(x); };
  const auto one = [](double (*f)(double)) { return std::function<double(double)>(f); };
  return {
      {"sin", one(portable::sin), sin, -0.1, 0.1},
      {"sin", one(portable::sin), sin, -4, 4},
      {"sin", one(portable::sin), sin, -1e7, 1e7},
      {"cos", one(portable::cos), cos, -0.1, 0.1},
      {"cos", one(portable::cos), cos, -4, 4},
      {"cos", one(portable::cos), cos, -1e7, 1e7},
      {"tan", one(portable::tan), tan, -1.5, 1.5},
      {"exp", one(portable::exp), exp, -1, 1},
      {"exp", one(portable::exp), exp, -700, 700},
      {"log", one(portable::log), log, 0.9, 1.1},
      {"log", one(portable::log), log, 1e-9, 1e6},
      {"log1p", one(portable::log1p), log1p, -1e-3, 1e-3},
      {"log1p", one(portable::log1p), log1p, -0.9, 100},
      {"atan2(., 1)", [](double y) { return portable::atan2(y, 1.0); },
       [](Extended y) { return std::atan2(y, Extended{1}); }, -20, 20},
      {"atan2(., -0.25)", [](double y) { return portable::atan2(y, -0.25); },
       [](Extended y) { return std::atan2(y, Extended{-0.25}); }, -2, 2},
      {"hypot(., 0.75)", [](double x) { return portable::hypot(x, 0.75); },
       [](Extended x) { return std::hypot(x, Extended{0.75}); }, -2, 2},
      {"pow(101, .)", [](double y) { return portable::pow(101, y); },
       [](Extended y) { return std::pow(Extended{101}, y); }, -3, 3},
      {"power(., 3)", [](double x) { return portable::power(x, 3); },
       [](Extended x) { return x * x * x; }, -2, 2},
  };
}

/// Arguments in a range, the same with every C++ library.
class Arguments {
 public:
  double next(double from, double to) {
    return from + (to - from) * static_cast<double>(random_() >> 11U) * 0x1p-53;
  }

 private:
  std::mt19937_64 random_{7};
};

TEST(PortableMath, ResultsAreTheExactOnesRounded) {
  Arguments arguments;
  for (const Function& f : functions()) {
    for (int i = 0; i < 2000; ++i) {
      const double x = arguments.next(f.from, f.to);
      const long double exact = f.exact(x);
      const double size = std::abs(static_cast<double>(exact));
      const double unit = std::nextafter(size, kInf) - size;
      const auto error = static_cast<double>((f.portable(x) - exact) / unit);
      ASSERT_LT(std::abs(error), 0.502) << f.name << " of " << x;
    }
  }
}

TEST(PortableMath, FloatsAreTheExactOnesRounded) {
  Arguments arguments;
  const auto agrees = [](float ours, double exact) {
    const float size = std::abs(static_cast<float>(exact));
    const double unit = std::nextafter(size, std::numeric_limits<float>::infinity()) - size;
    return std::abs(ours - exact) / unit < 0.502;
  };
  for (int i = 0; i < 5000; ++i) {
    const auto x = static_cast<float>(arguments.next(-1, 1));
    const auto y = static_cast<float>(arguments.next(-1, 1));
    ASSERT_TRUE(agrees(portable::atan2(y, x), std::atan2(double{y}, double{x}))) << y << ' ' << x;
    ASSERT_TRUE(agrees(portable::exp(20 * x), std::exp(double{20 * x}))) << x;
    const float positive = std::abs(1000 * y);
    ASSERT_TRUE(agrees(portable::log(positive), std::log(double{positive}))) << positive;
  }
}

TEST(PortableMath, SpecialValuesAreThoseOfTheStandardLibrary) {
  const auto same = [](double a, double b) {
    return (std::isnan(a) && std::isnan(b)) || (a == b && std::signbit(a) == std::signbit(b));
  };
  const double values[] = {0.0,  -0.0,   1.0,     -1.0,  kInf,  -kInf,
                           kNan, 5e-324, -1e-310, 1e-20, 1e300, -1e300};
  for (const double x : values) {
    EXPECT_TRUE(same(portable::exp(x), std::exp(x))) << x;
    EXPECT_TRUE(same(portable::log(x), std::log(x))) << x;
    EXPECT_TRUE(same(portable::log1p(x), std::log1p(x))) << x;
    if (!(std::abs(x) > 1e8) || std::isinf(x)) {
      EXPECT_TRUE(same(portable::sin(x), std::sin(x))) << x;
      EXPECT_TRUE(same(portable::cos(x), std::cos(x))) << x;
      EXPECT_TRUE(same(portable::tan(x), std::tan(x))) << x;
    } else {
      EXPECT_LE(std::abs(portable::sin(x)), 1) << x;
    }
    for (const double y : values) {
      EXPECT_TRUE(same(portable::atan2(y, x), std::atan2(y, x))) << y << ' ' << x;
      if (!std::isnan(x) && !std::isnan(y)) {
        EXPECT_TRUE(same(portable::hypot(x, y), std::hypot(x, y))) << y << ' ' << x;
      }
    }
  }
  EXPECT_EQ(portable::pow(0, 3), 0);
  EXPECT_EQ(portable::pow(0, 0), 1);
  EXPECT_EQ(portable::pow(7, 0), 1);
  EXPECT_EQ(portable::pow(10, 400), kInf);
  EXPECT_EQ(portable::pow(10, -400), 0);
  EXPECT_TRUE(std::isnan(portable::pow(-2, 0.5)));
  EXPECT_EQ(portable::power(-3, 3), -27);
  EXPECT_EQ(portable::power(5, 0), 1);
}

// The number was printed by builds for x86-64 and for ARM64.
TEST(PortableMath, EveryMachineGivesTheSameBytes) {
  Arguments arguments;
  std::uint64_t sum = 0;
  const auto add = [&sum](double value) {
    sum = (sum ^ std::bit_cast<std::uint64_t>(value)) * 0x100000001b3U;
    sum ^= sum >> 29U;
  };
  for (const Function& f : functions()) {
    for (int i = 0; i < 2000; ++i) add(f.portable(arguments.next(f.from, f.to)));
  }
  for (int i = 0; i < 2000; ++i) {
    const auto x = static_cast<float>(arguments.next(-1, 1));
    const auto y = static_cast<float>(arguments.next(-1, 1));
    add(portable::atan2(y, x));
    add(portable::exp(20 * x));
    add(portable::log(std::abs(y)));
  }
  EXPECT_EQ(sum, 15734226329923884717U);
}

}  // namespace
}  // namespace kys
