// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace kys_slam {

/// One line of a text file, split into fields.
struct TextRow {
  std::size_t line = 0;  ///< from 1
  std::vector<std::string_view> fields;
};

/// Tables of other programs, such as spreadsheets: the first line may name the columns and is left
/// out then, fields may be between quotes, and separated by semicolons where the file has any.
enum class TableStyle : std::uint8_t { kPlain, kSpreadsheet };

/// A text file as rows of fields separated by blanks, tabs or commas. Empty lines and lines that
/// begin with '#' are skipped, and so is a byte order mark. Line ends are LF or CR LF.
class TextTable {
 public:
  /// \throws InputError when the file cannot be read.
  explicit TextTable(const std::filesystem::path& path, TableStyle style = TableStyle::kPlain);
  // Rows point into text_, which must not move.
  TextTable(const TextTable&) = delete;
  TextTable& operator=(const TextTable&) = delete;

  [[nodiscard]] const std::vector<TextRow>& rows() const { return rows_; }
  /// The first line that begins with '#', or "".
  [[nodiscard]] std::string_view header() const { return header_; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

  /// Field `column` as a finite number. \throws InputError naming file and line.
  [[nodiscard]] double number(const TextRow& row, std::size_t column) const;
  [[nodiscard]] std::int64_t integer(const TextRow& row, std::size_t column) const;
  /// All fields of a row from `first` on as finite numbers.
  [[nodiscard]] std::vector<double> numbers(const TextRow& row, std::size_t first = 0) const;
  [[noreturn]] void fail(const TextRow& row, const std::string& what) const;

 private:
  std::filesystem::path path_;
  std::string text_;
  std::string_view header_;
  std::vector<TextRow> rows_;
};

}  // namespace kys_slam
