"""Train the dynamics predictor: `nsdr train dynamics --config configs/dynamics/state.yaml --run_dir runs/dynamics`."""

from collections.abc import Sequence

from nsdr.errors import DataError
from nsdr.io.checkpoint import save_checkpoint
from nsdr.io.configuration import described, parse_config, resolved
from nsdr.training.loop import train
from nsdr.training.patch_dynamics import PatchModelTask
from nsdr.training.state_dynamics import StateModelTask
from nsdr.training.track_task import DynamicsTraining

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint.

    Raises:
        DataError: an unknown network, or unreadable training data.
    """
    config = parse_config(DynamicsTraining, argv, "nsdr train dynamics")
    if config.network not in ("state", "paper"):
        raise DataError(f"network is {config.network!r}; expected state or paper")
    task = StateModelTask(config) if config.network == "state" else PatchModelTask(config)
    metrics = train(task, config.loop, config.run_dir, resolved(config))
    output = config.output or f"{config.run_dir}/checkpoint"
    details = {"network": config.network, "metrics": metrics, "training": described(config)}
    model = config.model if config.network == "state" else config.patches
    save_checkpoint(output, "dynamics", task.model.state_dict(), model, details, half=True)
    return output
