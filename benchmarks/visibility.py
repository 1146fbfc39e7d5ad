"""Accuracy of answers for values of the thresholds that decide which measured positions are trusted.

`python benchmarks/visibility.py --questions Q.json --proposals FILE.npz [--dynamics state] [--every 1] [--only NAME]`

The tracker's and the dynamics backend's thresholds are varied one at a time; all else is as shipped. True programs are run.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from nsdr import Executor
from nsdr.clevrer.files.proposals import read_compact_proposals
from nsdr.clevrer.files.questions import QUESTION_TYPES, read_questions
from nsdr.dynamics.motion_states import MeasurementConfig
from nsdr.dynamics.registry import BackendConfig, load_backend
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.dynamics.track_smoothing import SmoothingConfig
from nsdr.evaluation.score import evaluate
from nsdr.io.checkpoint import find_checkpoint
from nsdr.tracking.tracker import TrackerConfig, track
from nsdr.tracking.visibility import VisibilityConfig

VARIANTS: dict[str, dict[str, Any]] = {
    "as shipped": {},
    "cut_margin_px 2": {"visibility": VisibilityConfig(cut_margin_px=2)},
    "cut_margin_px 3": {"visibility": VisibilityConfig(cut_margin_px=3)},
    "cut_margin_px 6": {"visibility": VisibilityConfig(cut_margin_px=6)},
    "touch_px 1": {"visibility": VisibilityConfig(touch_px=1)},
    "rest_speed_world_per_s 0.4": {"rest_speed_world_per_s": 0.4},
    "rest_speed_world_per_s 1.5": {"rest_speed_world_per_s": 1.5},
    "unreliable_weight 0.02": {"unreliable_weight": 0.02},
    "unreliable_weight 0.03": {"unreliable_weight": 0.03},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--questions", type=Path, required=True)
    parser.add_argument("--proposals", type=Path, required=True)
    parser.add_argument("--dynamics", default="state")
    parser.add_argument("--types", nargs="+", default=list(QUESTION_TYPES))
    parser.add_argument("--every", type=int, default=1, help="measure every n-th scene")
    parser.add_argument("--only", nargs="*", default=list(VARIANTS), help="names of variants")
    options = parser.parse_args()
    scenes = [s for s in read_questions(options.questions) if any(q.type in options.types for q in s.questions)]
    scenes = scenes[:: options.every]
    wanted = {s.scene_index for s in scenes}
    proposals = {video: p for video, p in read_compact_proposals(options.proposals) if video in wanted}
    for name in options.only:
        change = VARIANTS[name]
        measurement = replace(MeasurementConfig(), **change)
        tracker = TrackerConfig(visibility=measurement.visibility)
        config = BackendConfig(options.dynamics, smoothing=SmoothingConfig(measurement=measurement))
        backend = load_backend(find_checkpoint(), config)

        def executor(video: int, backend: Any = backend, tracker: TrackerConfig = tracker) -> Executor:
            return Executor(scene_from_prediction(backend.predict(track(proposals[video], tracker))))

        report = evaluate(((s, executor(s.scene_index)) for s in tqdm(scenes, desc=name)), None, options.types)
        row = [f"{100 * report['descriptive']['accuracy']:.2f}"] if report["descriptive"]["n"] else ["-"]
        for kind in QUESTION_TYPES[1:]:
            r = report[kind]
            row.append(f"{100 * r['per_option']:.2f}/{100 * r['per_question']:.2f}" if r["n_questions"] else "-")
        print(f"{name}: {'; '.join(row)}", flush=True)


if __name__ == "__main__":
    main()
