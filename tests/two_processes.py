"""Trains a part in as many processes as it is launched with, and saves each process's gradients and weights.

torchrun --standalone --nproc_per_node 2 tests/two_processes.py PROPOSALS TRUTH OUTPUT BATCH_SIZE
"""

import os
import sys
from pathlib import Path

import torch
from accelerate import Accelerator

from nsdr.dynamics.propnet.patch_model import PatchPropNetConfig
from nsdr.dynamics.propnet.state_model import PropNetConfig
from nsdr.question_parser.model import QuestionParserConfig
from nsdr.training.dynamics import PropNetTask
from nsdr.training.loop import LoopConfig, Task, train
from nsdr.training.patch_dynamics import PatchPropNetTask
from nsdr.training.question_parser import QuestionParserTask, QuestionParserTraining
from nsdr.training.track_task import DynamicsTraining


def main(proposals: str, truth: str, output: str, batch_size: str) -> None:
    """Train three small networks and write `NETWORK_RANK.pt` for each."""
    rank = os.environ.get("RANK", "0")
    device = "cpu" if torch.cuda.is_available() else "auto"
    for name in ("propnet", "propnet_patches", "question_parser"):
        run = f"{output}/{name}"
        loop = LoopConfig(steps=2, batch_size=int(batch_size), optimizer="sgd", learning_rate=0.1, device=device)
        task: Task
        if name == "question_parser":
            small = QuestionParserConfig(embedding=8, hidden=16, max_tokens=5)
            task = QuestionParserTask(QuestionParserTraining(run, evaluation_texts=1, model=small, loop=loop))
        else:
            sizes = {"model": PropNetConfig(hidden=16), "patches": PatchPropNetConfig(hidden=16)}
            config = DynamicsTraining(
                proposals, truth, f"{run}_{rank}", network=name, rollout_steps=2, loop=loop, **sizes
            )
            task = PropNetTask(config) if name == "propnet" else PatchPropNetTask(config)
        gradients = []

        def record(accelerator, parameters, norm, gradients=gradients, clip=Accelerator.clip_grad_norm_):
            parameters = list(parameters)
            gradients.append([None if p.grad is None else p.grad.clone() for p in parameters])
            return clip(accelerator, parameters, norm)

        plain, Accelerator.clip_grad_norm_ = Accelerator.clip_grad_norm_, record
        try:
            train(task, loop, run, {})
        finally:
            Accelerator.clip_grad_norm_ = plain
        Path(output).mkdir(exist_ok=True)
        torch.save({"gradients": gradients, "weights": task.model.state_dict()}, f"{output}/{name}_{rank}.pt")


if __name__ == "__main__":
    main(*sys.argv[1:])
