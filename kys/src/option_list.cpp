// SPDX-License-Identifier: BSD-3-Clause
#include <kys/option_list.h>

#include <array>
#include <charconv>
#include <cmath>
#include <system_error>
#include <type_traits>

namespace kys {

namespace {

template <typename T>
constexpr bool kIsNumber = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;

/// Without an exponent from 0.0001 to 1e16.
template <typename T>
std::string number_text(T value) {
  std::array<char, 64> buffer;
  std::to_chars_result end{};
  if constexpr (std::is_floating_point_v<T>) {
    const double size = std::abs(static_cast<double>(value));
    const bool plain = size == 0 || (size >= 1e-4 && size < 1e16);
    const auto format = plain ? std::chars_format::fixed : std::chars_format::general;
    end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, format);
  } else {
    end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  }
  return std::string(buffer.data(), end.ptr);
}

std::string text_of(bool value) {
  return value ? "true" : "false";
}
std::string text_of(const std::string& value) {
  return value;
}
template <typename T>
std::string text_of(T value) {
  return number_text(value);
}

bool parse_to(std::string_view text, bool& value) {
  if (text != "true" && text != "false") return false;
  value = text == "true";
  return true;
}
bool parse_to(std::string_view text, std::string& value) {
  value = text;
  return true;
}
template <typename T>
bool parse_to(std::string_view text, T& value) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  T parsed{};
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, parsed);
  if (text.empty() || error != std::errc() || stop != end) return false;
  if (!std::isfinite(static_cast<double>(parsed))) return false;
  value = parsed;
  return true;
}

std::string listed(const std::vector<std::string_view>& names) {
  std::string all;
  for (std::size_t i = 0; i < names.size(); ++i) {
    all += (i == 0 ? "" : i + 1 == names.size() ? " or " : ", ") + std::string(names[i]);
  }
  return all;
}

bool in_range(const OptionChoice& choice, const OptionRange&) {
  return choice.get(choice.place) < choice.names.size();
}
/// The ends count as the type holds them: 0.01 as a float is less than 0.01.
template <typename T>
bool in_range(const T* place, const OptionRange& range) {
  if constexpr (kIsNumber<T>) {
    using Number = std::conditional_t<std::is_floating_point_v<T>, T, double>;
    const auto number = static_cast<Number>(*place);
    return number >= static_cast<Number>(range.least) && number <= static_cast<Number>(range.most);
  }
  return true;
}

template <typename... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <typename... F>
Overloaded(F...) -> Overloaded<F...>;  // for clang before 17

}  // namespace

std::string Option::text() const {
  return std::visit(Overloaded{[](const OptionChoice& choice) {
                                 const std::size_t index = choice.get(choice.place);
                                 return index < choice.names.size()
                                            ? std::string(choice.names[index])
                                            : number_text(index);
                               },
                               [](const auto* place) { return text_of(*place); }},
                    value);
}

bool Option::parse(std::string_view text) const {
  return std::visit(Overloaded{[&](const OptionChoice& choice) {
                                 for (std::size_t i = 0; i < choice.names.size(); ++i) {
                                   if (choice.names[i] != text) continue;
                                   choice.set(choice.place, i);
                                   return true;
                                 }
                                 return false;
                               },
                               [&](auto* place) { return parse_to(text, *place); }},
                    value);
}

std::string Option::expected() const {
  return std::visit(
      Overloaded{[](const OptionChoice& choice) { return listed(choice.names); },
                 [](const bool*) { return std::string("true or false"); },
                 [](const std::string*) { return std::string("a text"); },
                 []<typename T>(const T*) {
                   return std::string(std::is_integral_v<T> ? "a whole number" : "a finite number");
                 }},
      value);
}

std::string Option::range_text() const {
  return is_number() ? number_text(range.least) + " to " + number_text(range.most) : "";
}

std::string Option::complaint() const {
  if (std::visit([this](const auto& place) { return in_range(place, range); }, value)) return "";
  const std::string wanted =
      is_number() ? "between " + number_text(range.least) + " and " + number_text(range.most)
                  : expected();
  return key + " must be " + wanted + ", is " + text();
}

void OptionList::require(bool holds, std::string_view complaint) {
  if (!holds && broken_requirement_.empty()) broken_requirement_ = complaint;
}

std::string OptionList::complaint() const {
  for (const Option& option : options_) {
    std::string text = option.complaint();
    if (!text.empty()) return text;
  }
  return broken_requirement_;
}

}  // namespace kys
