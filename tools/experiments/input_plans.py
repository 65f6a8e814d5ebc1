# SPDX-License-Identifier: BSD-3-Clause
"""The part of a plan about inputs (plan.py): recordings that are given, worlds and drives to simulate."""
import data_sets
from runs import InputError, digest

SEED_STEP = 1000  # from one seed of a substitute to the next


class InputPlans:
    """Inputs as jobs. The planner has `options`, `programs`, `substitutes`, `given`, `trajectories`,
    `lengths`, `states` and `add`."""

    def state_of(self, *places):
        if places not in self.states:
            self.states[places] = data_sets.state_of(*places)
        return self.states[places]

    def given_labels(self, name, experiment):
        """Labels of a recording: a part of it has another name and origin than the whole, and so never
        stands beside figures of the whole."""
        here = self.given[name].frames()
        total, ran = self.lengths.get(name, here), min(experiment.get("frames") or here, here)
        if ran >= total:
            return {"origin": "given", "input": name}
        part = f"{name} ({ran} of {total} frames)"
        return {"origin": "partial", "input": part}

    def input_of(self, name, seed, experiment):
        """Job id (None: given data), folder relative to the work folder or absolute, and labels."""
        if name in self.given:
            if seed != experiment["seeds"][0]:
                return None  # a recording has no seeds
            return None, self.given[name].folder, self.given_labels(name, experiment)
        spec, _, size = name.partition("@")
        if spec.startswith("world/"):
            substitute = {"world": spec.removeprefix("world/"), "seed": 0}
            what, steps = "simulated", 1
        else:
            if spec not in self.substitutes:
                raise InputError(f"{name}: no such sequence")
            substitute = self.substitutes[spec]
            if self.options.scale == "miniature":
                substitute = {**substitute, "seed": 1}  # few worlds for all experiments
            what, steps = "substitute", SEED_STEP
        size = size or experiment.get("size", "620x188")
        number = substitute["seed"] + (seed if steps == 1 else steps * (seed - 1))
        frames = experiment.get("frames", substitute.get("frames", 0))
        arguments = [substitute["world"], "--seed", str(number), "--size", size]
        if frames:
            arguments += ["--frames", str(frames)]
        width, height = (int(x) for x in size.split("x"))
        cost = (frames or 250) * width * height / 480e3
        job = self.add("input", [substitute["world"], number, size, frames or "all"],
                       {"program": self.programs.key("simulate_sequence"), "arguments": arguments},
                       [], 2, cost)
        label = f"{what}: {substitute['world']}, seed {number}"
        return job, f"inputs/{job}", {"origin": what, "input": name, "what": label}

    def drive_of(self, name, seed, experiment, perception):
        """The same of a drive: a feature file, whose priors have the errors of `perception`."""
        traffic, _, real = name.removeprefix("drive/").partition("@")
        frames = experiment.get("frames", 0)
        arguments = ["--traffic", traffic, "--perception", perception, "--seed", str(seed)]
        spec = {"program": self.programs.key("simulate_features"), "arguments": arguments}
        if real:
            spec.update(trajectory=self.trajectories[real], state=digest(self.trajectories[real]))
            arguments += ["--frame-rate", "20"]
            arguments += ["--frames", str(frames)] if frames else []
        else:
            spec["path"] = [frames or 2000, seed]
        job = self.add("drive", [name.removeprefix("drive/"), seed, perception], spec, [], 1,
                       0.02 * (frames or 2000))
        where = f"real trajectory {real}" if real else "round a block"
        return job, f"inputs/{job}/drive.features", {
            "origin": "drive", "input": name, "what": f"drive: {where}, traffic {traffic}, seed {seed}"}
