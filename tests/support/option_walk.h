// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>
#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>

namespace kys_slam::test {

/// Converts to the type of any field.
struct AnyField {
  template <typename T>
  operator T() const;  // NOLINT(google-explicit-constructor)
};

template <typename Struct, std::size_t... I>
constexpr bool takes(std::index_sequence<I...>) {
  return requires {
    Struct{(static_cast<void>(I), AnyField{})...};
  };
}

/// How many fields a struct without constructors has.
template <typename Struct, std::size_t N = 64>
constexpr std::size_t field_count() {
  if constexpr (takes<Struct>(std::make_index_sequence<N>())) {
    return N;
  } else {
    return field_count<Struct, N - 1>();
  }
}

template <typename Options>
std::size_t listed() {
  Options options{};
  kys::OptionList list;
  describe(list, options);
  return list.options().size();
}

template <typename Options>
std::string complaint(const Options& options) {
  try {
    check_options(options);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// Whether the text begins with the key.
inline bool names(const std::string& text, const std::string& key) {
  return text.starts_with(key + " must be between ");
}

/// Sets number `index` of the struct; returns whether it took the value as it is.
template <typename Options>
bool set_number(Options& options, std::size_t index, double value) {
  kys::OptionList list;
  describe(list, options);
  return std::visit(
      [&]<typename T>(T& place) {
        if constexpr (std::is_pointer_v<T>) {
          using Value = std::remove_pointer_t<T>;
          if constexpr (std::is_arithmetic_v<Value>) {
            if (std::is_integral_v<Value> &&
                !(value >= static_cast<double>(std::numeric_limits<Value>::lowest()) &&
                  value < static_cast<double>(std::numeric_limits<Value>::max()))) {
              return false;  // the type has no such value
            }
            *place = static_cast<Value>(value);
            return static_cast<double>(*place) == value || std::is_same_v<Value, float>;
          }
        }
        return false;
      },
      const_cast<kys::Option&>(list.options()[index]).value);
}

/// Sets every number of the struct below and above its range, and to what is no number, and expects
/// that the check of the plain struct names the key.
template <typename Options>
void expect_numbers_checked(Options defaults) {
  ASSERT_EQ(complaint(defaults), "");
  kys::OptionList list;
  describe(list, defaults);
  for (std::size_t i = 0; i < list.options().size(); ++i) {
    const kys::Option& option = list.options()[i];
    if (!option.is_number()) continue;
    SCOPED_TRACE(option.key);
    const auto [least, most] = option.range;
    const double step = std::max(1.0, 0.01 * std::abs(most));
    for (const double bad :
         {least - 1, std::floor(most + step), -1e300, 1e300,
          std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
      Options options = defaults;
      const bool whole = std::isfinite(bad) && std::abs(bad) < 1e15;
      if (!set_number(options, i, bad) && whole && least > 0) {
        ADD_FAILURE() << "could not be set to " << bad;
      }
      kys::OptionList now;
      describe(now, options);
      if (now.options()[i].text() == option.text()) continue;  // the type has no such value
      EXPECT_TRUE(names(complaint(options), option.key)) << bad << ": " << complaint(options);
    }
    for (const double good : {least, most}) {
      Options options = defaults;
      set_number(options, i, good);
      EXPECT_FALSE(names(complaint(options), option.key)) << complaint(options);
    }
  }
}

/// The same, and that every field is listed: all but `unlisted` (pointers, seeds, truth values and
/// choices that no key sets).
/// \tparam Nested structs that it holds as fields and describes
template <typename Options, typename... Nested>
void expect_every_number_checked(std::size_t unlisted = 0, Options defaults = {}) {
  const std::size_t nested = (std::size_t{0} + ... + listed<Nested>());
  EXPECT_EQ(listed<Options>() - nested + sizeof...(Nested) + unlisted, field_count<Options>());
  expect_numbers_checked(defaults);
}

}  // namespace kys_slam::test
