// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace kys {

/// Least and greatest value of a number, both allowed.
struct OptionRange {
  double least = 0;
  double most = 0;
};

/// A field that holds one of a few named values (an enumeration without gaps, from 0).
struct OptionChoice {
  std::vector<std::string_view> names;
  void* place = nullptr;
  std::size_t (*get)(const void* place) = nullptr;
  void (*set)(void* place, std::size_t index) = nullptr;
};

/// One field of an options struct: its key, its value and the allowed values.
struct Option {
  std::string key;           ///< "kys.alpha"
  std::string_view unit;     ///< "bits", or "" for a plain number, a truth value or a text
  std::string_view meaning;  ///< "" for a field that users cannot set; its struct documents it
  OptionRange range;         ///< of numbers
  bool settable = true;      ///< whether users may set it by its key
  std::variant<bool*, int*, long*, long long*, unsigned long*, unsigned long long*, float*, double*,
               std::string*, OptionChoice>
      value;

  [[nodiscard]] bool is_number() const { return range.most > range.least; }
  /// The value as text. Numbers in the shortest form that reads back as the same number.
  [[nodiscard]] std::string text() const;
  /// Sets the value without a check of its range. Returns false, without change, when the text is
  /// not of its type.
  [[nodiscard]] bool parse(std::string_view text) const;
  /// What parse() accepts: "a whole number", "true or false", ...
  [[nodiscard]] std::string expected() const;
  /// "1 to 60000"; "" when it is not a number.
  [[nodiscard]] std::string range_text() const;
  /// "KEY must be between 1 and 8, is 9"; "" when the value is in its range.
  [[nodiscard]] std::string complaint() const;
};

/// The fields of an options struct, collected by its `describe(OptionList&, Options&)`. Ranges are
/// stated there only: checks of the struct, text keys and lists of settings use them. Holds
/// pointers into the struct.
class OptionList {
 public:
  /// Adds a number. NaN is never in its range.
  template <typename T>
  requires(std::is_arithmetic_v<T> &&
           !std::is_same_v<T, bool>) void add(std::string_view key, T& value, OptionRange range,
                                              std::string_view unit = "",
                                              std::string_view meaning = "") {
    push(key, &value, range, unit, meaning);
  }
  void add(std::string_view key, bool& value, std::string_view meaning) {
    push(key, &value, {}, "", meaning);
  }
  void add(std::string_view key, std::string& value, std::string_view meaning) {
    push(key, &value, {}, "", meaning);
  }
  /// \param names of the enumerators, in their order
  template <typename Enum>
  requires std::is_enum_v<Enum>
  void add(std::string_view key, Enum& value, std::vector<std::string_view> names,
           std::string_view meaning) {
    push(key,
         OptionChoice{std::move(names), &value,
                      [](const void* place) {
                        return static_cast<std::size_t>(*static_cast<const Enum*>(place));
                      },
                      [](void* place, std::size_t index) {
                        *static_cast<Enum*>(place) = static_cast<Enum>(index);
                      }},
         {}, "", meaning);
  }
  /// A condition that joins several fields.
  /// \param complaint message when it does not hold, names the keys
  void require(bool holds, std::string_view complaint);

  /// During its lifetime, fields that are added cannot be set by users.
  class [[nodiscard]] Fixed {
   public:
    explicit Fixed(OptionList& list) : list_(&list), before_(list.settable_) {
      list.settable_ = false;
    }
    ~Fixed() { list_->settable_ = before_; }
    Fixed(const Fixed&) = delete;
    Fixed& operator=(const Fixed&) = delete;

   private:
    OptionList* list_;
    bool before_;
  };

  [[nodiscard]] const std::vector<Option>& options() const { return options_; }
  /// The first value out of its range, or else the first requirement that does not hold; "": none.
  [[nodiscard]] std::string complaint() const;

 private:
  void push(std::string_view key, decltype(Option::value) value, OptionRange range,
            std::string_view unit, std::string_view meaning) {
    options_.push_back({std::string(key), unit, meaning, range, settable_, std::move(value)});
  }

  std::vector<Option> options_;
  std::string broken_requirement_;
  bool settable_ = true;
};

/// Whether a struct has a describe().
template <typename Options>
concept Described = requires(OptionList& list, Options& options) {
  describe(list, options);
};

/// What is wrong with the options: OptionList::complaint().
template <Described Options>
std::string complaint_about(const Options& options) {
  Options copy = options;  // describe() collects pointers that could change it
  OptionList list;
  describe(list, copy);
  return list.complaint();
}

}  // namespace kys
