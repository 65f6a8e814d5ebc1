// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace kys {

/// One class of a label space.
struct LabelClass {
  std::int32_t id = 0;  ///< the number of the class in the data set's annotation files
  std::string name;
  std::string text;        ///< words whose vectors make its semantic vector
  bool thing = false;      ///< countable object; false: stuff
  bool surrogate = false;  ///< its distances are estimates, not computed from word vectors
};

/// The classes a prior file's labels refer to, and their semantic distances S (Eq. 1).
///
/// Priors carry the dense index of a class, 0..size()-1, which is its row in the class file.
/// index_of() maps the data set's numbers to it. Immutable.
class LabelSpace {
 public:
  /// `table` is S, size x size, row by row, in bits. Throws Error for an empty or too long class
  /// list, repeated ids or names, a table of the wrong size, an entry that is not a number from 0
  /// to 10000, an asymmetric pair, a nonzero diagonal. `origin` starts the message.
  LabelSpace(std::string name, std::vector<LabelClass> classes, std::vector<float> table,
             const std::string& origin = "label space");

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::size_t size() const { return classes_.size(); }
  [[nodiscard]] const std::vector<LabelClass>& classes() const { return classes_; }
  /// Throws Error when the index is not in this label space.
  [[nodiscard]] const LabelClass& at(std::uint16_t index) const;

  /// Dense index of the class with that id of the data set. Throws Error when there is none.
  [[nodiscard]] std::uint16_t index_of(std::int32_t id) const;
  /// Dense index of the class of that name. Throws Error when there is none.
  [[nodiscard]] std::uint16_t index_of(std::string_view class_name) const;

  /// S of two classes by dense index, in bits. Throws Error when an index is not in this label
  /// space.
  [[nodiscard]] float distance(std::uint16_t a, std::uint16_t b) const;
  /// S, size x size, row by row.
  [[nodiscard]] const std::vector<float>& table() const { return table_; }

 private:
  std::string name_;
  std::vector<LabelClass> classes_;
  std::vector<float> table_;
  std::unordered_map<std::int32_t, std::uint16_t> index_of_id_;
};

/// Whether a label space may have this name: prior files, feature files and maps hold it. 1 to
/// `longest` characters from ! to ~.
bool is_label_space_name(std::string_view name, std::size_t longest = 32);

/// Names of the label spaces that are part of the library: "ade20k_150", "cityscapes_19",
/// "coco_panoptic_133", "vkitti2".
const std::vector<std::string>& builtin_label_spaces();

/// Reads a class file and a table file (formats: README.md). Throws Error naming file and line when
/// one is invalid.
LabelSpace load_label_space(const std::filesystem::path& class_file,
                            const std::filesystem::path& table_file);

/// A built-in label space by its name, or one of the user's by the common beginning of its two
/// files: "spaces/cityscapes" reads spaces/cityscapes.classes.csv and spaces/cityscapes.table.csv.
LabelSpace load_label_space(const std::string& name_or_prefix);

}  // namespace kys
