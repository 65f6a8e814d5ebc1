// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>

namespace kys_slam {
namespace {

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";

const char* separators_of(std::string_view text, TableStyle style) {
  if (style == TableStyle::kPlain) return " \t,\r";
  // Beside semicolons, commas belong to numbers, which are refused.
  return text.find(';') == std::string_view::npos ? " \t,\"\r" : " \t;\"\r";
}

std::vector<std::string_view> split(std::string_view line, std::string_view separators) {
  std::vector<std::string_view> fields;
  std::size_t begin = line.find_first_not_of(separators);
  while (begin != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(separators, begin), line.size());
    fields.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(separators, end);
  }
  return fields;
}

bool has_number(const TextRow& row) {
  return std::any_of(row.fields.begin(), row.fields.end(),
                     [](std::string_view field) { return parse_double(field).has_value(); });
}

/// Names a field in a message without passing on control characters or endless text.
std::string quoted(std::string_view field) {
  std::string text = "'";
  for (const char c : field.substr(0, 40)) text += c >= ' ' && c < 127 ? c : '?';
  return text + "'";
}

}  // namespace

TextTable::TextTable(const std::filesystem::path& path, TableStyle style)
    : path_(path), text_(read_text(path)) {
  std::string_view text = text_;
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  const std::string_view separators = separators_of(text, style);
  // A field takes at least two characters; room for fields doubles when it is used up.
  constexpr std::size_t kPerCharacter = sizeof(std::string_view);
  constexpr std::size_t kPerLine = sizeof(TextRow) + 2 * sizeof(std::string_view);
  const auto lines = static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n')) + 1;
  check_memory(path.string(), kPerCharacter * text.size() + kPerLine * lines);
  rows_.reserve(lines);
  std::size_t line = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view content = text.substr(begin, end - begin);
    begin = end + 1;
    ++line;
    if (content.starts_with('#')) {
      if (header_.empty()) header_ = content;
      continue;
    }
    std::vector<std::string_view> fields = split(content, separators);
    if (!fields.empty()) rows_.push_back({line, std::move(fields)});
  }
  if (style == TableStyle::kSpreadsheet && rows_.size() > 1 && !has_number(rows_[0]) &&
      has_number(rows_[1])) {
    rows_.erase(rows_.begin());
  }
}

double TextTable::number(const TextRow& row, std::size_t column) const {
  if (column >= row.fields.size()) fail(row, "too few columns");
  const auto value = parse_double(row.fields[column]);
  if (!value) fail(row, quoted(row.fields[column]) + " is not a finite number");
  return *value;
}

std::int64_t TextTable::integer(const TextRow& row, std::size_t column) const {
  if (column >= row.fields.size()) fail(row, "too few columns");
  const auto value = parse_int(row.fields[column]);
  if (!value) fail(row, quoted(row.fields[column]) + " is not an integer");
  return *value;
}

std::vector<double> TextTable::numbers(const TextRow& row, std::size_t first) const {
  std::vector<double> values;
  for (std::size_t i = first; i < row.fields.size(); ++i) values.push_back(number(row, i));
  return values;
}

void TextTable::fail(const TextRow& row, const std::string& what) const {
  throw InputError(path_.string() + ":" + std::to_string(row.line) + ": " + what);
}

}  // namespace kys_slam
