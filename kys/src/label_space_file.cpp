// SPDX-License-Identifier: BSD-3-Clause
#include <kys/error.h>
#include <kys/label_space.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <optional>
#include <sstream>
#include <system_error>

#include "builtin_label_spaces.h"

namespace kys {

namespace {

std::string quoted(std::string_view text) {
  return std::string(1, '\'').append(text).append(1, '\'');
}

/// Lines of a text that hold something, with their numbers, for messages.
class LineReader {
 public:
  LineReader(std::string_view text, std::string origin) : rest_(text), origin_(std::move(origin)) {}

  /// The next line that is neither empty nor a comment; nothing at the end.
  std::optional<std::string_view> next() {
    while (!rest_.empty()) {
      const std::size_t end = rest_.find('\n');
      std::string_view line = rest_.substr(0, end);
      rest_ = end == std::string_view::npos ? std::string_view{} : rest_.substr(end + 1);
      ++number_;
      if (!line.empty() && line.back() == '\r') {
        line.remove_suffix(1);
      }
      if (!line.empty() && line.front() != '#') {
        return line;
      }
    }
    return std::nullopt;
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw Error(origin_ + ":" + std::to_string(number_) + ": " + what);
  }

  [[nodiscard]] const std::string& origin() const { return origin_; }

 private:
  std::string_view rest_;
  std::string origin_;
  int number_ = 0;
};

/// Takes the text up to the next comma off the front.
std::string_view take_field(std::string_view& line) {
  const std::size_t comma = line.find(',');
  const std::string_view field = line.substr(0, comma);
  line = comma == std::string_view::npos ? std::string_view{} : line.substr(comma + 1);
  return field;
}

template <typename Number>
Number parse_number(std::string_view text, const LineReader& reader) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  Number value{};
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || error != std::errc() || stop != text.data() + text.size()) {
    reader.fail(quoted(text) + " is not a number that fits here");
  }
  return value;
}

/// The first line of either file: what it is, format version, name of the space, class count.
struct Header {
  std::string name;
  std::size_t count = 0;
};

Header read_header(LineReader& reader, std::string_view kind) {
  const auto line = reader.next();
  if (!line) {
    reader.fail("file is empty");
  }
  std::string_view rest = *line;
  if (take_field(rest) != kind) {
    reader.fail("does not begin with '" + std::string(kind) + ",1,NAME,COUNT'");
  }
  if (take_field(rest) != "1") {
    reader.fail("format version is not 1");
  }
  Header header;
  header.name = take_field(rest);
  header.count = parse_number<std::uint16_t>(rest, reader);
  if (header.name.empty() || header.count == 0) {
    reader.fail("needs the name of the label space and its number of classes");
  }
  if (!is_label_space_name(header.name)) {
    reader.fail("the name of the label space needs 1 to 32 characters from ! to ~");
  }
  return header;
}

LabelClass parse_class(std::string_view line, const LineReader& reader) {
  LabelClass c;
  c.id = parse_number<std::int32_t>(take_field(line), reader);
  const std::string_view thing = take_field(line);
  const std::string_view vector = take_field(line);
  if (thing != "0" && thing != "1") {
    reader.fail("thing must be 0 or 1, is " + quoted(thing));
  }
  if (vector != "fasttext" && vector != "surrogate") {
    reader.fail("vector must be fasttext or surrogate, is " + quoted(vector));
  }
  c.thing = thing == "1";
  c.surrogate = vector == "surrogate";
  c.text = take_field(line);
  c.name = line;
  if (c.name.empty()) {
    reader.fail("class without a name");
  }
  return c;
}

std::vector<LabelClass> parse_classes(LineReader& reader, const Header& header) {
  constexpr std::string_view kColumns = "id,thing,vector,text,name";
  const auto columns = reader.next();
  if (!columns || *columns != kColumns) {
    reader.fail("the second line must be '" + std::string(kColumns) + "'");
  }
  std::vector<LabelClass> classes;
  while (const auto line = reader.next()) {
    classes.push_back(parse_class(*line, reader));
  }
  if (classes.size() != header.count) {
    reader.fail("has " + std::to_string(classes.size()) + " classes, the first line says " +
                std::to_string(header.count));
  }
  return classes;
}

std::vector<float> parse_table(LineReader& reader, const Header& header) {
  std::vector<float> table;
  std::size_t rows = 0;
  while (const auto line = reader.next()) {
    std::string_view rest = *line;
    std::size_t columns = 0;
    for (; !rest.empty(); ++columns) {
      table.push_back(parse_number<float>(take_field(rest), reader));
    }
    if (columns != header.count) {
      reader.fail("row has " + std::to_string(columns) + " entries, the first line says " +
                  std::to_string(header.count));
    }
    ++rows;
  }
  if (rows != header.count) {
    reader.fail("has " + std::to_string(rows) + " rows, the first line says " +
                std::to_string(header.count));
  }
  return table;
}

LabelSpace parse_label_space(std::string_view class_text, const std::string& class_origin,
                             std::string_view table_text, const std::string& table_origin) {
  LineReader class_reader(class_text, class_origin);
  const Header class_header = read_header(class_reader, "kys-classes");
  std::vector<LabelClass> classes = parse_classes(class_reader, class_header);
  LineReader table_reader(table_text, table_origin);
  const Header table_header = read_header(table_reader, "kys-table");
  if (table_header.name != class_header.name || table_header.count != class_header.count) {
    table_reader.fail("is the table of " + table_header.name + " with " +
                      std::to_string(table_header.count) + " classes, " + class_origin +
                      " lists those of " + class_header.name + " with " +
                      std::to_string(class_header.count));
  }
  std::vector<float> table = parse_table(table_reader, table_header);
  return LabelSpace(class_header.name, std::move(classes), std::move(table), table_origin);
}

std::string read_text(const std::filesystem::path& file) {
  std::error_code error;
  const auto type = std::filesystem::status(file, error).type();
  if (type == std::filesystem::file_type::directory) {
    throw Error(file.string() + ": is a folder, not a file");
  }
  if (type != std::filesystem::file_type::regular) {
    throw Error(file.string() + ": cannot be read: not a regular file");
  }
  constexpr std::uintmax_t kMaxBytes = 16 << 20;
  if (!(std::filesystem::file_size(file, error) <= kMaxBytes)) {
    throw Error(file.string() + ": is larger than any label space");
  }
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  if (!stream || !(text << stream.rdbuf())) {
    throw Error(file.string() + ": cannot be read, or is empty");
  }
  return text.str();
}

}  // namespace

bool is_label_space_name(std::string_view name, std::size_t longest) {
  return !name.empty() && name.size() <= longest &&
         std::all_of(name.begin(), name.end(), [](char c) { return c > ' ' && c <= '~'; });
}

const std::vector<std::string>& builtin_label_spaces() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const auto& space : detail::builtin_label_space_files()) {
      names.emplace_back(space.name);
    }
    return names;
  }();
  return kNames;
}

LabelSpace load_label_space(const std::filesystem::path& class_file,
                            const std::filesystem::path& table_file) {
  return parse_label_space(read_text(class_file), class_file.string(), read_text(table_file),
                           table_file.string());
}

LabelSpace load_label_space(const std::string& name_or_prefix) {
  std::string known;
  for (const auto& space : detail::builtin_label_space_files()) {
    if (space.name == name_or_prefix) {
      return parse_label_space(space.classes, name_or_prefix + ".classes.csv", space.table,
                               name_or_prefix + ".table.csv");
    }
    known += (known.empty() ? "" : ", ") + std::string(space.name);
  }
  const std::filesystem::path class_file = name_or_prefix + ".classes.csv";
  std::error_code error;
  if (!std::filesystem::exists(class_file, error)) {
    throw Error("label space '" + name_or_prefix.substr(0, 200) + "' is not built in (" + known +
                ") and there is no " + class_file.string().substr(0, 200));
  }
  return load_label_space(class_file, name_or_prefix + ".table.csv");
}

}  // namespace kys
