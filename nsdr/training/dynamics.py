"""Train the dynamics predictor: `nsdr train dynamics --config configs/dynamics/state.yaml --run_dir runs/dynamics`."""

from collections.abc import Sequence

from nsdr.training.image_dynamics import ImageModelTask
from nsdr.training.loop import train_part
from nsdr.training.patch_dynamics import PatchModelTask
from nsdr.training.run_folder import parse_training
from nsdr.training.state_dynamics import StateModelTask
from nsdr.training.track_task import DynamicsTraining

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint.

    Raises:
        DataError: an unknown network, or unreadable training data.
    """
    config = parse_training(DynamicsTraining, argv, "dynamics")
    if config.network == "state":
        return train_part("dynamics", StateModelTask(config), config, config.model, {"network": config.network})
    task = PatchModelTask(config) if config.network == "paper" else ImageModelTask(config)
    inputs = {"scenes": [len(task.data), len(task.held_out)]}
    return train_part("dynamics", task, config, config.patches, {"network": config.network}, inputs)
