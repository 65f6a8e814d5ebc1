// SPDX-License-Identifier: BSD-3-Clause
#pragma once

/// Elementary functions with the same result on every machine. Those of a C library are chosen by
/// processor and differ in the last bit; these use additions, multiplications, divisions and square
/// roots only, in two doubles per number, and are not contracted. Domains and special values are
/// those of the C library. Nearly every result is the exact one, rounded (error below 0.51 units in
/// the last place; pow() with a result outside 1e-100 to 1e100: below 1). Doubles take 0.1 to 0.3
/// us per call.
namespace kys::portable {

double exp(double x);
double log(double x);
double log1p(double x);
/// NaN for a negative base.
double pow(double base, double exponent);
/// Any base, exponent >= 0.
double power(double base, int exponent);

/// Beyond 1e8 rad the argument is first reduced by the double next to 2 pi.
double sin(double x);
double cos(double x);
double tan(double x);
double atan2(double y, double x);
double hypot(double x, double y);

/// Computed in double precision and rounded.
float exp(float x);
float log(float x);
float atan2(float y, float x);

}  // namespace kys::portable
