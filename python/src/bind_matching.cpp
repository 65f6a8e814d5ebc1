// SPDX-License-Identifier: BSD-3-Clause
#include <kys/distance_model.h>
#include <kys/label_space.h>
#include <kys/mode_options.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <memory>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

template <typename T>
using Vector = nb::ndarray<const T, nb::ndim<1>, nb::device::cpu, nb::c_contig>;
using Descriptors =
    nb::ndarray<const std::uint8_t, nb::shape<-1, 32>, nb::device::cpu, nb::c_contig>;

struct Priors {
  std::vector<kys::Prior> values;
};

Priors make_priors(const Vector<std::uint16_t>& labels, const Vector<std::int32_t>& instances,
                   const Vector<float>& scales, const Vector<float>& motions,
                   const Vector<bool>& dynamic) {
  const std::size_t n = labels.shape(0);
  if (instances.shape(0) != n || scales.shape(0) != n || motions.shape(0) != n ||
      dynamic.shape(0) != n) {
    throw InputError("labels, instances, scales, motions and dynamic differ in length");
  }
  Priors priors;
  for (std::size_t i = 0; i < n; ++i) {
    priors.values.push_back(kys::make_prior(labels.data()[i], instances.data()[i], scales.data()[i],
                                            motions.data()[i], dynamic.data()[i]));
  }
  return priors;
}

std::vector<kys::Descriptor> to_descriptors(const Descriptors& array) {
  std::vector<kys::Descriptor> descriptors(array.shape(0));
  if (!descriptors.empty()) {
    std::memcpy(descriptors.data(), array.data(), descriptors.size() * sizeof(kys::Descriptor));
  }
  return descriptors;
}

nb::tuple distances(const kys::DistanceModel& model, const Descriptors& a, const Priors& pa,
                    const Descriptors& b, const Priors& pb, bool stereo) {
  const auto da = to_descriptors(a), db = to_descriptors(b);
  if (pa.values.size() != da.size() || pb.values.size() != db.size()) {
    throw InputError("one prior per descriptor is needed");
  }
  const std::size_t rows = da.size(), columns = db.size();
  std::vector<float> values(rows * columns);
  std::vector<std::uint8_t> tiers(rows * columns);
  {
    const nb::gil_scoped_release released;
    const kys::Context context = stereo ? kys::Context::kStereo : kys::Context::kTemporal;
    for (std::size_t i = 0; i < rows; ++i) {
      for (std::size_t j = 0; j < columns; ++j) {
        const kys::Distance d = model.evaluate(da[i], pa.values[i], db[j], pb.values[j], context);
        values[i * columns + j] = d.value;
        tiers[i * columns + j] = static_cast<std::uint8_t>(d.tier);
      }
    }
  }
  return nb::make_tuple(to_numpy(std::move(values), {rows, columns}),
                        to_numpy(std::move(tiers), {rows, columns}));
}

}  // namespace

void bind_matching(nb::module_& m) {
  nb::class_<kys::LabelSpace>(m, "LabelSpace", "Classes and their semantic distances S (Eq. 1).")
      .def(
          "__init__",
          [](kys::LabelSpace* self, const std::string& name) {
            new (self) kys::LabelSpace(kys::load_label_space(name));
          },
          "name_or_prefix"_a,
          "A built-in one (ade20k_150, cityscapes_19, coco_panoptic_133, vkitti2) or the common "
          "beginning of PREFIX.classes.csv and PREFIX.table.csv.")
      .def_prop_ro("name", &kys::LabelSpace::name, "e.g. coco_panoptic_133")
      .def("__len__", &kys::LabelSpace::size)
      .def_prop_ro(
          "names",
          [](const kys::LabelSpace& s) {
            std::vector<std::string> names;
            for (const kys::LabelClass& c : s.classes()) names.push_back(c.name);
            return names;
          },
          "of the classes, by index")
      .def_prop_ro(
          "ids",
          [](const kys::LabelSpace& s) {
            std::vector<int> ids;
            for (const kys::LabelClass& c : s.classes()) ids.push_back(c.id);
            return ids;
          },
          "of the classes in the data set, by index")
      .def_prop_ro(
          "things",
          [](const kys::LabelSpace& s) {
            std::vector<bool> things;
            for (const kys::LabelClass& c : s.classes()) things.push_back(c.thing);
            return things;
          },
          "whether a class is countable, by index")
      .def_prop_ro(
          "table",
          [](const kys::LabelSpace& s) {
            return to_numpy(s.table(), {s.size(), s.size()});
          },
          nb::rv_policy::move, "S, (n, n) float32, bits")
      .def(
          "index_of",
          [](const kys::LabelSpace& s, const std::string& name) { return s.index_of(name); },
          "name"_a, "Index of a class by its name.")
      .def(
          "index_of_id", [](const kys::LabelSpace& s, int id) { return s.index_of(id); }, "id"_a,
          "Index of a class by its id in the data set.");
  m.def("builtin_label_spaces", &kys::builtin_label_spaces, "Names of the built-in label spaces.");
  m.def(
      "mode_needs_priors",
      [](const std::string& mode) { return kys::needs_priors(kys::parse_mode(mode)); }, "mode"_a,
      "Whether a mode of matching is pointless without priors.");
  m.def(
      "modes",
      [] {
        std::vector<std::string> names;
        for (const kys::Mode mode : kys::all_modes()) {
          names.emplace_back(kys::mode_name(mode));
        }
        return names;
      },
      "Names of the modes of matching.");

  nb::class_<Priors>(m, "Priors", "Priors of N keypoints.")
      .def(
          "__init__",
          [](Priors* self, const Vector<std::uint16_t>& labels,
             const Vector<std::int32_t>& instances, const Vector<float>& scales,
             const Vector<float>& motions, const Vector<bool>& dynamic) {
            new (self) Priors(make_priors(labels, instances, scales, motions, dynamic));
          },
          "labels"_a, "instances"_a, "scales"_a, "motions"_a, "dynamic"_a,
          "(N,) each: uint16 index in the label space or 65535 (none), int32, float32 px^2 m^2, "
          "float32 0..100, bool.")
      .def("__len__", [](const Priors& p) { return p.values.size(); });

  nb::class_<kys::DistanceModel>(m, "DistanceModel",
                                 "The distance of two descriptors under a mode (Sec. 3).")
      .def(
          "__init__",
          [](kys::DistanceModel* self, const std::string& mode, const std::string& label_space,
             const std::map<std::string, std::string>& options) {
            kys::ModeOptions o;
            kys::set_option(o, "kys.mode", mode);
            for (const auto& [key, value] : options) kys::set_option(o, key, value);
            o.check();
            if (kys::needs_label_space(o)) {
              new (self) kys::DistanceModel(o, kys::load_label_space(label_space));
            } else {
              new (self) kys::DistanceModel(o);
            }
          },
          "mode"_a, "label_space"_a = "coco_panoptic_133",
          "options"_a = std::map<std::string, std::string>{},
          "`options`: settings by key, e.g. {\"kys.gamma\": \"0.8\"}.")
      .def(
          "distances", &distances, "a"_a, "priors_a"_a, "b"_a, "priors_b"_a, nb::kw_only(),
          "stereo"_a = false,
          "All pairs: descriptors (N, 32) and (M, 32) uint8 to distances (N, M) float32 in bits "
          "(inf: rejected) and tiers (N, M) uint8 (0 same instance, 1 cross instance, 2 cross "
          "class, 3 bypassed, 4 gated, 5 filtered). `stereo`: the motion gate of left-right pairs.")
      .def_prop_ro("uses_priors", &kys::DistanceModel::uses_priors, "False in mode `stock`");
}

}  // namespace kys_slam
