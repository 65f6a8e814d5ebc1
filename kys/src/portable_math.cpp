// SPDX-License-Identifier: BSD-3-Clause
#include <kys/portable_math.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

// Numbers in two doubles, T. J. Dekker, "A floating-point technique for extending the available
// precision", Numerische Mathematik 18, 1971. Every series below has its first terms in two doubles
// and the rest, which is less than 2^-27 of the sum, in one.

namespace kys::portable {

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// high + low, |low| at most half a unit in the last place of high.
struct Pair {
  double high = 0;
  double low = 0;
};

constexpr Pair kPi{0x1.921fb54442d18p+1, 0x1.1a62633145c07p-53};
constexpr Pair kHalfPi{0x1.921fb54442d18p+0, 0x1.1a62633145c07p-54};
// The first two parts have 33 bits: their products with whole numbers below 2^20 are exact.
constexpr std::array kHalfPiParts{0x1.921fb544p+0, 0x1.0b4611a6p-34, 0x1.3198a2ep-69,
                                  0x1.b839a252049c1p-104};
// 40 bits each but the last.
constexpr std::array kLn2Parts{0x1.62e42fefa2p-1, 0x1.9ef35793c6p-41, 0x1.673007e5ed5e8p-81};
/// atan(i / 8).
constexpr std::array kAtan{Pair{0, 0},
                           Pair{0x1.fd5ba9aac2f6ep-4, -0x1.cd37686760c17p-59},
                           Pair{0x1.f5b75f92c80ddp-3, 0x1.8ab6e3cf7afbdp-57},
                           Pair{0x1.6f61941e4def1p-2, -0x1.c63aae6f6e918p-56},
                           Pair{0x1.dac670561bb4fp-2, 0x1.a2b7f222f65e2p-56},
                           Pair{0x1.1e00babdefeb4p-1, -0x1.928df287a668fp-58},
                           Pair{0x1.4978fa3269ee1p-1, 0x1.2419a87f2a458p-56},
                           Pair{0x1.700a7c5784634p-1, -0x1.8c34d25aadef6p-56},
                           Pair{0x1.921fb54442d18p-1, 0x1.1a62633145c07p-55}};

/// |a| >= |b|, or a = 0.
Pair ordered_sum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

Pair exact_sum(double a, double b) {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
}

Pair halves(double a) {
  const double c = 134217729.0 * a;  // 2^27 + 1
  const double high = c - (c - a);
  return {high, a - high};
}

Pair exact_product(double a, double b) {
  const double product = a * b;
  const Pair s = halves(a), t = halves(b);
  const double error =
      ((s.high * t.high - product) + s.high * t.low + s.low * t.high) + s.low * t.low;
  return {product, error};
}

Pair operator-(const Pair& a) {
  return {-a.high, -a.low};
}
Pair operator+(const Pair& a, const Pair& b) {
  const Pair sum = exact_sum(a.high, b.high);
  return ordered_sum(sum.high, sum.low + (a.low + b.low));
}
Pair operator-(const Pair& a, const Pair& b) {
  return a + -b;
}
Pair operator*(const Pair& a, const Pair& b) {
  const Pair product = exact_product(a.high, b.high);
  return ordered_sum(product.high, product.low + (a.high * b.low + a.low * b.high));
}
Pair operator/(const Pair& a, const Pair& b) {
  const double first = a.high / b.high;
  const Pair rest = a - Pair{first, 0} * b;
  return ordered_sum(first, rest.high / b.high);
}
double rounded(const Pair& a) {
  return a.high + a.low;
}

/// Sum over n of x^n times the product of 1 / divisor(1..n), the terms from `pairs` on in doubles.
template <typename Divisor>
Pair series(const Pair& x, int pairs, int terms, const Divisor& divisor) {
  double rest = 1;
  for (int n = terms; n > pairs; --n) rest = 1 + x.high * rest / divisor(n);
  Pair sum{rest, 0};
  for (int n = pairs; n > 0; --n) sum = Pair{1, 0} + x * sum / Pair{divisor(n), 0};
  return sum;
}

/// Sum over n of x^n / (2 n + 1), the first `pairs` terms in pairs.
Pair odd_series(const Pair& x, int pairs, int terms) {
  double rest = 1.0 / (2 * terms + 1);
  for (int n = terms - 1; n >= pairs; --n) rest = 1.0 / (2 * n + 1) + x.high * rest;
  Pair sum{rest, 0};
  for (int n = pairs - 1; n >= 0; --n) sum = Pair{1, 0} / Pair{2.0 * n + 1, 0} + x * sum;
  return sum;
}

/// An angle as a multiple of pi/2 and what is left, at most pi/4 (and a little).
struct Reduced {
  int quadrant = 0;
  Pair rest;
};

Reduced reduce(double x) {
  if (std::abs(x) > 1e8) x = std::remainder(x, 2 * std::numbers::pi);
  double turns = std::nearbyint(x * (2 / std::numbers::pi));
  const int quadrant = static_cast<int>(static_cast<std::int64_t>(turns) & 3);
  // In two steps, each of a whole number below 2^20.
  const double coarse = std::nearbyint(turns / 1024) * 1024;
  Pair rest{x, 0};
  for (const double part : {coarse, turns - coarse}) {
    if (part == 0) continue;
    for (const double piece : kHalfPiParts) rest = rest - exact_product(part, piece);
  }
  return {quadrant, rest};
}

struct SineCosine {
  Pair sine, cosine;
};

SineCosine sine_cosine(double x) {
  const Reduced r = reduce(x);
  const Pair square = -(r.rest * r.rest);
  const Pair s = r.rest * series(square, 3, 11, [](int n) { return 2.0 * n * (2.0 * n + 1); });
  const Pair c = series(square, 4, 12, [](int n) { return 2.0 * n * (2.0 * n - 1); });
  switch (r.quadrant) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case 2:
      return {-s, -c};
    default:
      return {-c, s};
  }
}

double exp_of(const Pair& x) {
  if (x.high > 709.8) return kInfinity;
  if (x.high < -745.2) return 0;
  const double k = std::nearbyint(x.high * std::numbers::log2e);
  Pair rest = x;
  for (const double part : kLn2Parts) rest = rest - exact_product(k, part);
  const Pair e = series(rest, 9, 22, [](int n) { return static_cast<double>(n); });
  // A result below the normal numbers is rounded once more.
  return std::ldexp(rounded(e), static_cast<int>(k));
}

/// Of a positive finite number.
Pair log_of(const Pair& x) {
  int k = 0;
  const double fraction = std::frexp(x.high, &k);  // in [0.5, 1)
  if (fraction < std::numbers::sqrt2 / 2) --k;
  const Pair m{std::ldexp(x.high, -k), std::ldexp(x.low, -k)};
  const Pair s = (m + Pair{-1, 0}) / (m + Pair{1, 0});
  Pair result = s * odd_series(s * s, 5, 16) * Pair{2, 0};
  for (const double part : kLn2Parts) {
    if (k != 0) result = result + exact_product(k, part);
  }
  return result;
}

/// Of y / x >= 0, both scaled to at most 1.
Pair atan_of(double y, double x) {
  const bool steep = y > x;
  const Pair t = steep ? Pair{x, 0} / Pair{y, 0} : Pair{y, 0} / Pair{x, 0};
  const auto i = static_cast<std::size_t>(std::nearbyint(t.high * 8));
  const Pair c{static_cast<double>(i) / 8, 0};
  const Pair u = i == 0 ? t : (t - c) / (Pair{1, 0} + c * t);
  const Pair a = kAtan[i] + u * odd_series(-(u * u), 3, 11);
  return steep ? kHalfPi - a : a;
}

}  // namespace

double exp(double x) {
  if (std::isnan(x)) return x;
  if (std::abs(x) < 0x1p-54) return 1 + x;
  return exp_of({x, 0});
}

double log(double x) {
  if (std::isnan(x) || x == kInfinity) return x;
  if (x <= 0) return x == 0 ? -kInfinity : kNan;
  return rounded(log_of({x, 0}));
}

double log1p(double x) {
  if (std::isnan(x) || x == kInfinity || std::abs(x) < 0x1p-54) return x;
  if (x <= -1) return x == -1 ? -kInfinity : kNan;
  return rounded(log_of(exact_sum(1, x)));
}

double pow(double base, double exponent) {
  if (base == 1 || exponent == 0) return 1;
  if (!(base >= 0) || std::isnan(exponent)) return kNan;
  if (base == 0) return exponent > 0 ? 0 : kInfinity;
  if (std::isinf(base) || std::isinf(exponent)) {
    return (base > 1) == (exponent > 0) ? kInfinity : 0;
  }
  const Pair l = log_of({base, 0});
  const double size = l.high * exponent;
  if (std::abs(size) > 800) return size > 0 ? kInfinity : 0;
  return exp_of(l * Pair{exponent, 0});
}

double power(double base, int exponent) {
  Pair result{1, 0};
  for (int i = 0; i < exponent; ++i) result = result * Pair{base, 0};
  return rounded(result);
}

double sin(double x) {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  return rounded(sine_cosine(x).sine);
}

double cos(double x) {
  if (!std::isfinite(x)) return kNan;
  return rounded(sine_cosine(x).cosine);
}

double tan(double x) {
  if (!std::isfinite(x)) return kNan;
  if (std::abs(x) < 0x1p-27) return x;
  const SineCosine r = sine_cosine(x);
  return rounded(r.sine / r.cosine);
}

double atan2(double y, double x) {
  if (std::isnan(x) || std::isnan(y)) return kNan;
  const bool left = std::signbit(x);
  double a = std::abs(y), b = std::abs(x);
  if (std::isinf(a) && std::isinf(b)) a = b = 1;
  Pair angle;
  if (a == 0 || b == kInfinity) {
    angle = {};
  } else if (b == 0 || a == kInfinity) {
    angle = kHalfPi;
  } else {
    const int scale = -std::max(std::ilogb(a), std::ilogb(b));
    const double small = a / b;
    if (small < 0x1p-60) {
      if (!left) return std::copysign(small, y);
      angle = {small, 0};
    } else {
      angle = atan_of(std::ldexp(a, scale), std::ldexp(b, scale));
    }
  }
  return std::copysign(rounded(left ? kPi - angle : angle), y);
}

double hypot(double x, double y) {
  const double a = std::abs(x), b = std::abs(y);
  if (std::isinf(a) || std::isinf(b)) return kInfinity;
  if (std::isnan(a) || std::isnan(b)) return kNan;
  const double most = std::max(a, b);
  if (most == 0) return 0;
  const int scale = std::ilogb(most);
  const double s = std::ldexp(a, -scale), t = std::ldexp(b, -scale);
  const Pair sum = exact_product(s, s) + exact_product(t, t);
  const double root = std::sqrt(sum.high);
  const Pair rest = sum - exact_product(root, root);
  return std::ldexp(root + rest.high / (2 * root), scale);
}

float exp(float x) {
  return static_cast<float>(exp(static_cast<double>(x)));
}

float log(float x) {
  if (!(x > 0) || std::isinf(x)) return static_cast<float>(log(static_cast<double>(x)));
  int k = 0;
  double m = std::frexp(static_cast<double>(x), &k);
  if (m < std::numbers::sqrt2 / 2) {
    m *= 2;
    --k;
  }
  const double s = (m - 1) / (m + 1);
  const double of_m = 2 * s * odd_series({s * s, 0}, 0, 9).high;
  return static_cast<float>(of_m + k * std::numbers::ln2);
}

float atan2(float y, float x) {
  const double a = std::abs(y), b = std::abs(x);
  const double most = std::max(a, b);
  if (!(most > 0) || !std::isfinite(a + b)) {
    return static_cast<float>(atan2(static_cast<double>(y), static_cast<double>(x)));
  }
  const double t = std::min(a, b) / most;
  const auto i = static_cast<std::size_t>(t * 8 + 0.5);
  const double c = static_cast<double>(i) / 8;
  const double u = (t - c) / (1 + c * t);
  double angle = kAtan[i].high + u * odd_series({-(u * u), 0}, 0, 6).high;
  if (a > b) angle = kHalfPi.high - angle;
  if (std::signbit(x)) angle = kPi.high - angle;
  return std::copysign(static_cast<float>(angle), y);
}

}  // namespace kys::portable
