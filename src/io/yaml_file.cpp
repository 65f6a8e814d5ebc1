// SPDX-License-Identifier: BSD-3-Clause
#include "io/yaml_file.h"

#include <kys_slam/error.h>
#include <kys_slam/util/read_bytes.h>
#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <set>
#include <sstream>
#include <vector>

namespace kys_slam {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
constexpr std::size_t kMaxDepth = 16;
constexpr int kMaxValues = 20000;

/// Goes through a document without making anything of it.
class PlainTree : public YAML::EventHandler {
 public:
  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    value(mark, "", anchor);
    next();
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override {
    throw YAML::ParserException(mark, "aliases are not allowed");
  }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string& text) override {
    value(mark, tag, anchor);
    if (at_key() && !levels_.back().keys.insert(text).second) {
      throw YAML::ParserException(mark, "the key '" + text + "' is there twice");
    }
    next();
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    enter(mark, tag, anchor, false);
  }
  void OnSequenceEnd() override { leave(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    enter(mark, tag, anchor, true);
  }
  void OnMapEnd() override { leave(); }

 private:
  struct Level {
    bool map = false;
    bool value = false;  // of a map: after a key
    std::set<std::string> keys;
  };

  void value(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) {
    if (anchor != 0) throw YAML::ParserException(mark, "anchors are not allowed");
    // "?" and "!" stand for values without a tag, plain and quoted; OpenCV marks its matrices.
    if (!tag.empty() && tag != "?" && tag != "!" && !tag.ends_with("opencv-matrix")) {
      throw YAML::ParserException(mark, "the tag '" + tag + "' is not allowed");
    }
    if (++values_ > kMaxValues) throw YAML::ParserException(mark, "too many values");
  }
  void enter(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor, bool map) {
    value(mark, tag, anchor);
    if (levels_.size() >= kMaxDepth) throw YAML::ParserException(mark, "nested too deeply");
    levels_.push_back({map, false, {}});
  }
  void leave() {
    levels_.pop_back();
    next();
  }
  [[nodiscard]] bool at_key() const {
    return !levels_.empty() && levels_.back().map && !levels_.back().value;
  }
  void next() {
    if (!levels_.empty()) levels_.back().value = !levels_.back().value;
  }

  std::vector<Level> levels_;
  int values_ = 0;
};

}  // namespace

YAML::Node parse_yaml(std::string text, const std::string& name) {
  if (text.starts_with('%')) text.erase(0, std::min(text.find('\n'), text.size()));
  try {
    std::istringstream stream(text);
    YAML::Parser parser(stream);
    PlainTree check;
    if (parser.HandleNextDocument(check)) {
      PlainTree more;
      if (parser.HandleNextDocument(more)) throw InputError(name + ": more than one document");
    }
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    throw InputError(name + ": " + error.what());
  }
}

YAML::Node load_yaml(const std::filesystem::path& path) {
  return parse_yaml(read_text(path, kMaxBytes), path.string());
}

std::string yaml_number(double value) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

}  // namespace kys_slam
