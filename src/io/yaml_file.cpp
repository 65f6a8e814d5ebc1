#include "io/yaml_file.h"

#include <kys_slam/error.h>
#include <kys_slam/util/read_bytes.h>
#include <yaml-cpp/eventhandler.h>

#include <algorithm>
#include <sstream>

namespace kys_slam {
namespace {

constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
constexpr int kMaxDepth = 16;
constexpr int kMaxValues = 20000;

/// Goes through a document without making anything of it.
class PlainTree : public YAML::EventHandler {
 public:
  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { value(mark, "", anchor); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override {
    throw YAML::ParserException(mark, "aliases are not allowed");
  }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string&) override {
    value(mark, tag, anchor);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    enter(mark, tag, anchor);
  }
  void OnSequenceEnd() override { --depth_; }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    enter(mark, tag, anchor);
  }
  void OnMapEnd() override { --depth_; }

 private:
  void value(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) {
    if (anchor != 0) throw YAML::ParserException(mark, "anchors are not allowed");
    // "?" and "!" stand for values without a tag, plain and quoted; OpenCV marks its matrices.
    if (!tag.empty() && tag != "?" && tag != "!" && !tag.ends_with("opencv-matrix")) {
      throw YAML::ParserException(mark, "the tag '" + tag + "' is not allowed");
    }
    if (++values_ > kMaxValues) throw YAML::ParserException(mark, "too many values");
  }
  void enter(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) {
    value(mark, tag, anchor);
    if (++depth_ > kMaxDepth) throw YAML::ParserException(mark, "nested too deeply");
  }

  int depth_ = 0;
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

}  // namespace kys_slam
