# SPDX-License-Identifier: BSD-3-Clause
"""The part of a plan that is about priors: what a recording has of them, the jobs that make perception
outputs by networks, prior files, and prior files of inputs that lose images.
"""
import os

import data_sets
import networks
from runs import digest

SOURCE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
CONFIGS = os.path.join(SOURCE, "configs")
NO_PRIORS = ("stock", "scaled")  # modes that use none
LOST_IMAGES = {"missing", "repeated", "late"}  # keys of a case about images, not perception


class PriorPlans:
    """Of a Planner, whose data and jobs these methods use."""

    networks = None  # that make perception outputs of recordings

    def given_perception(self, name):
        """Parts of a spec: a recording, its prior files and perception outputs, where they are and in
        what state."""
        sequence = self.given[name]
        prior_files = data_sets.prior_files_of(sequence, self.options.data)
        perception = data_sets.perception_of(sequence, self.options.data)
        return {"state": self.state_of(*sequence.places), "prior_files": prior_files,
                "prior_files_state": prior_files and self.state_of(prior_files), "perception": perception,
                "perception_state": perception and self.state_of(perception[1])}

    def perceived(self, name, frames, prior_files_fit):
        """The same with the outputs of networks where nothing is given that fits, and the jobs it
        needs."""
        spec = {"label_space": self.given[name].label_space, **self.given_perception(name)}
        if (spec["perception"] or (spec["prior_files"] and prior_files_fit) or self.networks is None
                or not networks.reads(name)):
            return spec, []
        job = self.networks_of(name, frames)
        spec.update(perception=["networks", f"perception/{job}"], label_space=self.networks.label_space,
                    frames=self.jobs[job]["spec"]["frames"])
        return spec, [job]

    def networks_of(self, name, frames):
        """Job id of the perception outputs of a recording, of its first `frames` (0: all)."""
        sequence = self.given[name]
        here = sequence.frames()
        frames = frames if 0 < frames < here else 0
        spec = {"input": sequence.folder, "state": self.state_of(*sequence.places), "frames": frames,
                "arguments": self.networks.arguments, "networks": self.networks.state}
        return self.add("networks", [name.replace("/", ""), frames or "all"], spec, [], self.options.cores,
                        2 * (frames or here))

    def why_no_priors(self, name, case, config):
        """None where a recording has prior files for this case, or they can be made; else a sentence."""
        spec, recipe = self.given_perception(name), self.cases[case]
        fit = spec["prior_files"] and not config and (not recipe or "decision" in recipe)
        if fit or spec["perception"] or (self.networks is not None and networks.reads(name)):
            return None
        return networks.WITHOUT if networks.reads(name) else networks.OTHER_LAYOUT

    def priors_of(self, source, name, case, config, seed, frames=0):
        """Job id of prior files of an input; of its first `frames` where networks make them (0: all)."""
        job, folder, labels = source
        recipe = dict(self.cases[case])
        perturbed = "decision" in recipe
        given, needs = {}, [job] if job else []
        if job is None:
            given, needs = self.perceived(name, frames, prior_files_fit=perturbed or not (config or recipe))
            if needs and not perturbed:
                config = config or networks.CONFIG
        if perturbed:
            needs = [n for n in (job,) if n]
            needs.append(self.priors_of(source, name, "exact", config, seed, frames))
        spec = {"program": self.programs.key("build_priors"), "input": folder, "case": recipe,
                "config": config, "seed": seed}
        if config:
            spec["config_digest"] = digest(os.path.join(CONFIGS, config))
        spec.update(given)
        if recipe:
            spec["perturb"] = self.programs.key("perturb_priors")
        if "relabel" in recipe or "flow_relative" in recipe:  # step.py measures the exposure
            spec["compare"] = self.programs.key("compare_priors")
        words = [labels["input"].replace("/", ""), seed, case, (config or "").replace(".yaml", "")]
        return self.add("priors", words, spec, needs, 1, 4 if not recipe.get("disparity") else 60)

    def with_lost_images(self, source, case, priors, seed):
        """Job id of an input without some of its images, and of the prior files of the others."""
        job, folder, labels = source
        return self.add("lost", [labels["input"].replace("/", ""), seed, case],
                        {"input": folder, "priors": priors, "case": dict(self.cases[case]), "seed": seed},
                        [j for j in (job, priors) if j], 1, 1)
