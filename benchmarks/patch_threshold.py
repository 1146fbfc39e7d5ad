"""Scores of observed collisions by `collision_threshold`, of the paper's networks on patches.

`python -m benchmarks.patch_threshold --checkpoint runs/propnet_images/checkpoint --config configs/dynamics/propnet_images.yaml`

The scenes are those that the training of CONFIG leaves out. Patches of images are read from the run's folder, or made there.
Other options are those of `nsdr train dynamics`, such as `--proposals FILE --truth FILE --run-dir FOLDER`.
"""

from dataclasses import replace

from benchmarks.shared import parser_of
from nsdr.dynamics.metrics import collision_scores
from nsdr.dynamics.propnet.patch_predictor import ImagePropNetPredictor, PatchPropNetPredictor
from nsdr.training.patch_dynamics import ImagePropNetTask, PatchPropNetTask
from nsdr.training.run_folder import parse_training
from nsdr.training.track_task import DynamicsTraining

THRESHOLDS = [round(0.05 * k, 2) for k in range(1, 20)]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--checkpoint", required=True, help="folder of the trained network")
    options, others = parser.parse_known_args()
    config = parse_training(DynamicsTraining, others, "dynamics")
    on_images = config.network == "propnet_images"
    task = ImagePropNetTask(config) if on_images else PatchPropNetTask(config)
    predictor = (ImagePropNetPredictor if on_images else PatchPropNetPredictor).from_checkpoint(options.checkpoint)
    scenes = [task.states(i) for i in range(len(task.held_out))]
    print(f"{len(scenes)} scenes, {sum(len(events) for _, events in scenes)} collisions")
    for threshold in THRESHOLDS:
        predictor.config = replace(predictor.config, collision_threshold=threshold)
        scores = collision_scores([(predictor.observed_collisions(states), events) for states, events in scenes])
        print(
            f"{threshold:.2f}: " + ", ".join(f"{name.removeprefix('collision_')} {x:.3f}" for name, x in scores.items())
        )


if __name__ == "__main__":
    main()
