import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import ANY

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from nsdr import DataError, FrameParser, PropNetPredictor, QuestionParser
from nsdr.dynamics.propnet.patch_predictor import PatchPropNetPredictor
from nsdr.errors import MachineError
from nsdr.io.checkpoint import save_checkpoint
from nsdr.io.device import CPU_CHECK
from nsdr.training import dynamics, frame_parser, question_parser
from nsdr.training.loop import LoopConfig, LossTerm, Task, _accelerator, learning_rate_at, train, train_part
from nsdr.training.run_folder import RunFolder, TrainingState

LOOP = ["--loop.batch-size", "2", "--loop.log-every", "1", "--loop.device", "cpu"]


def parser_arguments(frames: Path, run: Path, steps: int) -> list[str]:
    model = (
        "{widths: [16, 16, 16, 32], blocks: 1, fpn_channels: 16, box_features: 32, mask_channels: 16, mask_layers: 1}"
    )
    return [
        *("--frames", str(frames), "--run-dir", str(run), "--model", model, "--evaluation-frames", "2"),
        *(*LOOP, "--loop.steps", str(steps), "--loop.save-every", "2", "--loop.optimizer", "sgd"),
    ]


def lines(run: Path) -> list[dict]:
    found = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    for line in found:
        assert line.pop("cpu_seconds") >= 0
    return found


def test_frame_parser_trains_and_its_checkpoint_loads(tiny_frames, tmp_path) -> None:
    output = frame_parser.main(parser_arguments(tiny_frames, tmp_path / "run", 2))
    FrameParser.from_checkpoint(output)
    assert [r["step"] for r in lines(tmp_path / "run")] == [1, 2]
    assert "f1" in lines(tmp_path / "run")[-1]
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert config["config"]["loop"]["steps"] == 2
    assert config["revision"]
    card = json.loads((Path(output) / "frame_parser.json").read_text())
    assert card["training"]["frames"] == "frames"  # no absolute path
    assert list((tmp_path / "run").glob("events.out.tfevents*"))


def test_dynamics_trains_and_its_checkpoint_loads(tiny_motion, tmp_path) -> None:
    arguments = ["--proposals", str(tiny_motion[0]), "--truth", str(tiny_motion[1]), "--run-dir", str(tmp_path / "run")]
    output = dynamics.main([*arguments, *LOOP, "--loop.steps", "3", "--model.hidden", "16"])
    PropNetPredictor.from_checkpoint(output)
    assert {"loss/motion", "loss/collision", "loss/observed", "collision_f1"} <= set(lines(tmp_path / "run")[-1])


def test_the_papers_dynamics_trains_and_its_checkpoint_loads(tiny_motion, tmp_path) -> None:
    arguments = ["--proposals", str(tiny_motion[0]), "--truth", str(tiny_motion[1]), "--run-dir", str(tmp_path / "run")]
    small = ["--network", "propnet_patches", "--patches.hidden", "16", "--rollout-steps", "2"]
    output = dynamics.main([*arguments, *LOOP, "--loop.steps", "3", *small])
    PatchPropNetPredictor.from_checkpoint(output)
    assert {"loss/motion", "loss/collision", "collision_f1", "rollout_error_25_p90"} <= set(lines(tmp_path / "run")[-1])
    with pytest.raises(DataError, match=r"--network: expected .*propnet_images, got big"):
        dynamics.main([*arguments, "--network", "big"])


@pytest.mark.parametrize(("network", "most"), [("propnet", 127 // 2), ("propnet_patches", 127 // 5)])
def test_rollouts_are_as_long_as_the_videos_at_most(tiny_motion, tmp_path, network, most) -> None:
    arguments = ["--proposals", str(tiny_motion[0]), "--truth", str(tiny_motion[1]), "--run-dir", str(tmp_path / "run")]
    with pytest.raises(DataError, match=f"rollout_steps: expected {most} or less, .* got {most + 1}"):
        dynamics.main([*arguments, "--network", network, "--rollout-steps", str(most + 1)])


def question_arguments(run: Path, *more: str) -> list[str]:
    small = ["--model.embedding", "8", "--model.hidden", "16", "--evaluation-texts", "5"]
    return ["--run-dir", str(run), *small, *LOOP, "--loop.save-every", "2", *more]


def test_question_parser_trains_and_its_checkpoint_loads(tmp_path) -> None:
    output = question_parser.main(question_arguments(tmp_path / "run", "--loop.steps", "3"))
    QuestionParser.from_checkpoint(output)


def test_dynamics_network_learns_the_collision(tiny_motion, tmp_path) -> None:
    arguments = ["--proposals", str(tiny_motion[0]), "--truth", str(tiny_motion[1]), "--run-dir", str(tmp_path / "run")]
    loop = ["--loop.steps", "60", "--loop.batch-size", "8", "--loop.log-every", "1", "--loop.learning-rate", "3e-3"]
    dynamics.main([*arguments, *loop, "--model.hidden", "32"])
    rows = lines(tmp_path / "run")
    assert np.mean([r["loss/observed"] for r in rows[-10:]]) < 0.5 * np.mean([r["loss/observed"] for r in rows[:5]])


class _Killed(Exception):
    pass


def test_a_killed_run_resumes_to_the_same_result(tmp_path, monkeypatch) -> None:
    """Killed after step 3 with a checkpoint of step 2: the resumed run equals the uninterrupted one."""
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    steps = ["--loop.steps", "6"]
    question_parser.main(question_arguments(whole, *steps))

    losses = question_parser.QuestionParserTask.losses
    calls = []

    def failing(self, model, batch):
        calls.append(1)
        if len(calls) == 4:
            raise _Killed
        return losses(self, model, batch)

    monkeypatch.setattr(question_parser.QuestionParserTask, "losses", failing)
    with pytest.raises(_Killed):
        question_parser.main(question_arguments(broken, *steps))
    assert [p.name for p in broken.glob("step_*.json")] == ["step_0000002.json"]
    question_parser.main(question_arguments(broken, *steps))
    first, second = (load_file(run / "checkpoint" / "question_parser.safetensors") for run in (whole, broken))
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_an_incomplete_checkpoint_is_ignored(tmp_path) -> None:
    run = tmp_path / "run"
    question_parser.main(question_arguments(run, "--loop.steps", "2"))
    shutil.copy(run / "step_0000002.safetensors", run / "step_0000099.safetensors")
    question_parser.main(question_arguments(run, "--loop.steps", "2"))
    assert len(lines(run)) == 2


def test_more_processes_than_devices_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "2")
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    with pytest.raises(DataError, match="2 processes on this machine share 1 CUDA devices"):
        _accelerator(LoopConfig())


def test_without_cuda_the_cpu_trains_also_where_accelerate_finds_another_accelerator(monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr("accelerate.state.is_mps_available", lambda *_, **__: True)
    assert _accelerator(LoopConfig()).device == torch.device("cpu")


def test_an_optimizers_state_keeps_the_memory_format() -> None:
    def state() -> TrainingState:
        torch.manual_seed(0)
        model = torch.nn.Conv2d(3, 4, 3).to(memory_format=torch.channels_last)
        optimizer = torch.optim.AdamW(model.parameters())
        model(torch.ones(1, 3, 5, 5).to(memory_format=torch.channels_last)).sum().backward()
        optimizer.step()
        return TrainingState(model, optimizer)

    saved, loaded = state(), state()
    loaded.load(saved.tensors())
    for model, optimizer in ((s.model, s.optimizer) for s in (saved, loaded)):
        average = optimizer.state[model.weight]["exp_avg"]
        assert average.stride() == model.weight.stride() == (27, 1, 9, 3)
    assert torch.equal(*(s.optimizer.state[s.model.weight]["exp_avg"] for s in (saved, loaded)))


def test_unknown_keys_are_errors(tmp_path) -> None:
    (tmp_path / "c.yaml").write_text("run_dir: x\nlearning: 3\n")
    with pytest.raises(DataError, match=r"c\.yaml: learning: no such setting; known are"):
        question_parser.main(["--config", str(tmp_path / "c.yaml")])


class _ReachedError(Exception):
    """The configuration was read and the task is about to be made."""


@pytest.mark.parametrize(
    ("part", "tasks"),
    [
        (frame_parser, ["FrameParserTask"]),
        (dynamics, ["PropNetTask", "PatchPropNetTask", "ImagePropNetTask"]),
        (question_parser, ["QuestionParserTask"]),
    ],
)
def test_shipped_configurations_are_read(part, tasks, monkeypatch) -> None:

    def stop(config):
        raise _ReachedError

    name = part.__name__.rsplit(".", 1)[-1]
    for task in tasks:
        monkeypatch.setattr(part, task, stop)
    files = sorted((Path(__file__).parent.parent / "configs" / name).glob("*.yaml"))
    files = [f for f in files if f.name != "physics.yaml"]  # a backend without training
    assert files
    for path in files:
        with pytest.raises(_ReachedError):
            part.main(["--config", str(path)])


class Line(Task):
    """Fits y = w x; with `explode`, one of its losses is not finite."""

    def __init__(self, explode: bool = False) -> None:
        torch.manual_seed(0)
        self.model = torch.nn.Linear(1, 1)
        self.explode = explode

    def draw(self, count: int, rng: np.random.Generator, step: int) -> list[float]:
        return rng.normal(size=count).tolist()

    def collate(self, examples: Sequence[float]) -> torch.Tensor:
        return torch.tensor(examples)[:, None]

    def losses(self, model, batch):
        loss = LossTerm((model(batch) - 3 * batch).square().sum(), len(batch))
        return {"fit": loss, "bad": loss._replace(total=loss.total * float("nan"))} if self.explode else {"fit": loss}

    def evaluate(self, model):
        return {"weight": model.weight.item()}


def test_loop_fits_a_line(tmp_path) -> None:
    config = LoopConfig(steps=300, learning_rate=0.1, device="cpu", save_every=1000)
    assert train(Line(), config, tmp_path / "run", {})["weight"] == pytest.approx(3, abs=0.05)
    # A finished run is not repeated: its metrics are read.
    assert train(Line(), config, tmp_path / "run", {})["weight"] == pytest.approx(3, abs=0.05)


def test_worker_processes_make_the_same_batches(tmp_path) -> None:
    class Recorded(Line):
        def collate(self, examples):
            made.append(os.getpid())
            return super().collate(examples)

    found = []
    for workers in (0, 2):
        made: list[int] = []
        config = LoopConfig(steps=20, learning_rate=0.1, device="cpu", workers=workers)
        found.append(train(Recorded(), config, tmp_path / str(workers), {})["weight"])
        assert bool(made) == (workers == 0)
    assert found[0] == found[1]


@pytest.mark.parametrize("workers", [0, 1])
def test_an_error_in_a_batch_is_told_as_it_is(workers: int, tmp_path) -> None:
    class Broken(Line):
        def collate(self, examples):
            raise DataError("frame_3.png: corrupt")

    with pytest.raises(DataError, match=r"^frame_3\.png: corrupt$"):
        train(Broken(), LoopConfig(steps=2, device="cpu", workers=workers), tmp_path, {})


def test_metrics_without_a_value_are_null(tmp_path) -> None:
    class Unmeasured(Line):
        def evaluate(self, model):
            return {"error": float("nan")}

    assert train(Unmeasured(), LoopConfig(steps=1, device="cpu"), tmp_path, {}) == {"cpu_seconds": ANY, "error": None}
    assert '"error": null' in (tmp_path / "metrics.jsonl").read_text()


@dataclass(frozen=True)
class LineTraining:
    run_dir: str
    output: str = ""
    loop: LoopConfig = field(default_factory=lambda: LoopConfig(steps=1, device="cpu"))


def test_a_mean_with_counts_and_without_metrics_is_written(tmp_path) -> None:
    class Normalised(Line):
        def __init__(self) -> None:
            super().__init__()
            self.model = torch.nn.Sequential(self.model, torch.nn.BatchNorm1d(1))

        def evaluate(self, model):
            return {"error": float("nan")}

    task = Normalised()
    save_checkpoint(tmp_path / "initial", "dynamics", task.model.state_dict(), {}, {})
    output = train_part("dynamics", task, LineTraining(str(tmp_path / "run")), {}, mean_with=str(tmp_path / "initial"))
    assert json.loads((Path(output) / "dynamics.json").read_text())["metrics"] == {"error": None}


def test_two_processes_train_one_model_as_one_process_with_twice_the_batch(tiny_motion, tmp_path) -> None:
    script = str(Path(__file__).parent / "two_processes.py")
    data = [str(path) for path in tiny_motion]
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    two = subprocess.Popen([*launch, script, *data, str(tmp_path / "two"), "3"], env=environment)
    one = subprocess.run([sys.executable, script, *data, str(tmp_path / "one"), "6"], env=environment)
    assert (one.returncode, two.wait(300)) == (0, 0)
    for network in ("propnet", "propnet_patches", "question_parser"):
        files = [tmp_path / "two" / f"{network}_0.pt", tmp_path / "two" / f"{network}_1.pt"]
        first, second, alone = map(torch.load, [*files, tmp_path / "one" / f"{network}_0.pt"])
        torch.testing.assert_close(first, second, rtol=0, atol=0)
        torch.testing.assert_close(first["weights"], alone["weights"])
        assert any(g.abs().max() > 1e-4 for g in first["gradients"][0] if g is not None)
        for ours, expected in zip(first["gradients"], alone["gradients"], strict=True):
            for gradient, of_one in zip(ours, expected, strict=True):
                if of_one is None:  # a part of the network that no loss reads
                    assert gradient is None or not gradient.any()
                else:
                    torch.testing.assert_close(gradient, of_one, rtol=1e-3, atol=1e-5)


def test_a_loss_that_is_not_finite_names_the_term(tmp_path) -> None:
    with pytest.raises(FloatingPointError, match=r"step 0: loss is not finite \(bad\)"):
        train(Line(explode=True), LoopConfig(steps=3, device="cpu"), tmp_path, {})


def test_a_gradient_that_is_not_finite_spoils_no_weights(tmp_path, monkeypatch) -> None:
    """The square root of 0 is finite, and its slope is not."""
    config = LoopConfig(steps=6, save_every=1, device="cpu")
    task, healthy = Line(), Line().losses

    def steep(model, batch):
        loss = healthy(model, batch)
        return {"fit": loss["fit"], "steep": LossTerm((model.bias - model.bias.detach()).sum().abs().sqrt(), 1)}

    calls = iter(range(10))
    monkeypatch.setattr(task, "losses", lambda *given: (steep if next(calls) == 3 else healthy)(*given))
    with pytest.raises(FloatingPointError, match="step 3: the gradient is not finite"):
        train(task, config, tmp_path / "run", {})
    weights = [train(Line(), config, tmp_path / run, {})["weight"] for run in ("run", "whole")]
    assert weights[0] == weights[1]


def test_the_averaged_weights_are_kept_and_resume(tmp_path, monkeypatch) -> None:
    config = LoopConfig(steps=40, batch_size=8, learning_rate=0.05, ema=0.9, save_every=10, device="cpu")
    task = Line()
    metrics = train(task, config, tmp_path / "whole", {})
    assert metrics["weight"] == pytest.approx(task.model.weight.item())
    plain = Line()
    train(plain, replace(config, ema=0.0), tmp_path / "plain", {})
    assert plain.model.weight.item() != task.model.weight.item()
    interrupted = Line()
    collate = interrupted.collate
    calls = iter(range(100))

    def killed(examples):
        if next(calls) == 25:
            raise KeyboardInterrupt
        return collate(examples)

    interrupted.collate = killed
    with pytest.raises(KeyboardInterrupt):
        train(interrupted, config, tmp_path / "killed", {})
    resumed = Line()
    train(resumed, config, tmp_path / "killed", {})
    assert resumed.model.weight.item() == task.model.weight.item()


def test_metrics_are_those_of_the_averaged_weights(tmp_path) -> None:
    task = Line()
    config = LoopConfig(steps=5, learning_rate=0.5, ema=0.99, save_every=5, evaluate_every=5, device="cpu")
    metrics = train(task, config, tmp_path, {})
    saved = load_file(tmp_path / "step_0000005.safetensors")["model/weight"].item()
    assert metrics["weight"] == task.model.weight.item() != saved


class _KilledInEvaluation(Line):
    def evaluate(self, model):
        raise _Killed


def test_a_run_that_is_killed_in_an_evaluation_keeps_its_steps(tmp_path) -> None:
    config = LoopConfig(steps=4, log_every=1, save_every=2, device="cpu")
    with pytest.raises(_Killed):
        train(_KilledInEvaluation(), config, tmp_path, {})
    assert [line["step"] for line in lines(tmp_path)] == [1, 2, 3]
    task = Line()
    task.draw = None  # no step is repeated
    assert train(task, config, tmp_path, {}).keys() == {"weight", "cpu_seconds"}
    assert [line["step"] for line in lines(tmp_path)] == [1, 2, 3, 4]
    assert {"loss", "weight"} <= set(lines(tmp_path)[-1])
    whole = Line()
    train(whole, config, tmp_path / "whole", {})
    assert lines(tmp_path) == lines(tmp_path / "whole")


def test_a_resumed_run_repeats_no_line(tmp_path) -> None:
    """Killed after the lines of steps 3 and 4 were written, with a checkpoint of step 2 and a torn line at the end."""
    config = LoopConfig(steps=5, log_every=1, save_every=2, device="cpu")
    train(Line(), config, tmp_path / "whole", {})
    train(Line(), config, tmp_path / "broken", {})
    for path in (tmp_path / "broken").glob("step_*"):
        path.unlink()
    train(Line(), replace(config, steps=2), tmp_path / "short", {})
    for path in (tmp_path / "short").glob("step_*"):
        shutil.copy(path, tmp_path / "broken")
    metrics = tmp_path / "broken" / "metrics.jsonl"
    rows = [json.dumps(row | {"cpu_seconds": 1000.0}) for row in lines(tmp_path / "broken")]
    metrics.write_text("\n".join([*rows, '{"step": 6, "lo']))
    train(Line(), config, tmp_path / "broken", {})
    times = [json.loads(row)["cpu_seconds"] for row in (tmp_path / "broken" / "metrics.jsonl").read_text().splitlines()]
    assert times[:2] == [1000.0, 1000.0]
    assert all(time >= 1000 for time in times[2:])  # what was spent before is counted
    short = {line["step"]: line for line in lines(tmp_path / "broken")}
    assert [line["step"] for line in lines(tmp_path / "broken")] == [1, 2, 3, 4, 5]
    assert short[1] == lines(tmp_path / "whole")[0]


def test_a_damaged_checkpoint_falls_back_to_the_one_before(tmp_path, caplog) -> None:
    config = LoopConfig(steps=6, log_every=1, save_every=2, device="cpu")
    task = Line()
    train(task, config, tmp_path, {})
    assert sorted(p.name for p in tmp_path.glob("step_*.json")) == ["step_0000004.json", "step_0000006.json"]
    newest = tmp_path / "step_0000006.safetensors"
    content = newest.read_bytes()
    for damaged in (content[:40], content[:-1] + bytes([content[-1] ^ 1])):  # torn; one bit flipped in a number
        newest.write_bytes(damaged)
        resumed = Line()
        caplog.clear()
        train(resumed, config, tmp_path, {})
        assert "step_0000006: damaged" in caplog.text
        assert resumed.model.weight.item() == task.model.weight.item()
        assert [line["step"] for line in lines(tmp_path)] == [1, 2, 3, 4, 5, 6]
        assert newest.read_bytes() == content
    for path in tmp_path.glob("step_*.safetensors"):
        path.write_bytes(b"")
    with pytest.raises(DataError, match="no checkpoint can be read; delete the folder to start again"):
        train(Line(), config, tmp_path, {})


def test_a_checkpoint_is_not_damaged_where_the_machine_fails(tmp_path) -> None:
    model = torch.nn.Linear(1, 1)
    state, run = TrainingState(model, torch.optim.SGD(model.parameters())), RunFolder(tmp_path, {})
    for step in (1, 2):
        run.save(state, step, {})

    def no_memory(tensors: object) -> None:
        raise RuntimeError("CUDA out of memory")

    with pytest.raises(MachineError, match=r"step_0000002.*out of memory"):
        run.restore(SimpleNamespace(load=no_memory))
    assert run.restore(state)[0] == 2


def test_what_a_kill_left_of_checkpoints_is_removed(tmp_path) -> None:
    """Killed while a new one was written, while an old one was deleted, and while a line was appended."""
    config = LoopConfig(steps=6, log_every=1, save_every=2, device="cpu")
    train(Line(), config, tmp_path, {})
    expected = {p.name for p in tmp_path.iterdir() if not p.name.startswith("events")}
    for suffix in ("json", "safetensors"):
        shutil.copy(tmp_path / f"step_0000004.{suffix}", tmp_path / f"step_0000002.{suffix}")
    (tmp_path / ".step_0000006.partial.safetensors").write_text("half")
    (tmp_path / ".metrics.partial.jsonl").write_text("half")
    train(Line(), config, tmp_path, {})
    assert {p.name for p in tmp_path.iterdir() if not p.name.startswith("events")} == expected
    assert [line["step"] for line in lines(tmp_path)] == [1, 2, 3, 4, 5, 6]


def test_events_are_written_as_they_happen(tmp_path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    config = LoopConfig(steps=4, log_every=1, save_every=2, device="cpu")
    with pytest.raises(_Killed):
        train(_KilledInEvaluation(), config, tmp_path, {})
    train(Line(), config, tmp_path, {})
    events = EventAccumulator(str(tmp_path)).Reload()
    assert [e.step for e in events.Scalars("loss")] == [1, 2, 3, 4]
    assert [e.step for e in events.Scalars("weight")] == [4]
    assert events.Scalars("loss")[2].value == pytest.approx(lines(tmp_path)[2]["loss"])


def test_a_run_that_never_got_to_a_checkpoint_does_not_refuse_another_configuration(tmp_path) -> None:
    with pytest.raises(FloatingPointError):
        train(Line(explode=True), LoopConfig(steps=3, device="cpu"), tmp_path, {"learning_rate": 100})
    train(Line(), LoopConfig(steps=3, device="cpu"), tmp_path, {"learning_rate": 1})
    assert json.loads((tmp_path / "config.json").read_text())["config"] == {"learning_rate": 1}


@pytest.mark.parametrize("fast", [True, False])
def test_automatic_precision_is_bfloat16_only_where_it_is_fast(fast: bool, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(torch.cpu, CPU_CHECK, lambda: fast)
    monkeypatch.setattr("nsdr.training.loop.has_bfloat16", lambda: True)
    task, casts = Line(), []
    task.model = torch.nn.Sequential(task.model)
    task.model[0].register_forward_pre_hook(lambda *_: casts.append(torch.is_autocast_enabled("cpu")))
    task.evaluate = lambda model: {}
    train(task, LoopConfig(steps=1, device="cpu", precision="auto"), tmp_path, {})
    assert casts == [fast]


def test_learning_rate_schedules() -> None:
    config = LoopConfig(steps=100, learning_rate=1.0, warmup_steps=10)
    assert learning_rate_at(0, config) == pytest.approx(0.1)
    assert learning_rate_at(10, config) == 1.0
    assert learning_rate_at(99, config) < 0.01
    steps = replace(config, schedule="step", step_size=30, step_factor=0.5, warmup_steps=0)
    assert [learning_rate_at(s, steps) for s in (0, 29, 30, 60)] == [1, 1, 0.5, 0.25]
