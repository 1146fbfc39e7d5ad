"""Full disks: at every single write of a run, and at any size of a file; and too many open files."""

import builtins
import errno
import io
import json
import os
import re
import resource
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file

from nsdr import DataError, Scene, load, save
from nsdr.baselines.features.files import MANIFEST, FeatureCache, feature_file
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.cli.main import main
from nsdr.errors import MachineError
from nsdr.evaluation import runner
from nsdr.evaluation.experiments import run_experiment
from nsdr.frame_parser.dataset import FrameDataset
from nsdr.io.checkpoint import save_checkpoint
from nsdr.io.files import atomic_path, locked, write_json
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.video import write_video
from nsdr.training import run_folder
from nsdr.training.loop import LoopConfig, train
from nsdr.visualize.figures import figure_png, new_figure
from tests.test_training import Line


class Disk:
    """Counts writes, and fails the one of number `full`, which leaves half of what was to be written."""

    def __init__(self, monkeypatch, full: int) -> None:
        self.writes, self.full = 0, full
        for module, name in ((os, "fsync"), (os, "replace"), (os, "mkdir"), (os, "write")):
            monkeypatch.setattr(module, name, self.failing(getattr(module, name)))
        opened = io.open

        def open_(file, mode="r", *rest, **more):
            if set(mode) & set("wax+") and self.is_full():
                with opened(file, mode, *rest, **more) as half:
                    half.write(b'{"st' if "b" in mode else '{"st')
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), file)
            return opened(file, mode, *rest, **more)

        monkeypatch.setattr(io, "open", open_)
        monkeypatch.setattr(builtins, "open", open_)

    def is_full(self) -> bool:
        self.writes += 1
        return self.writes == self.full

    def failing(self, function: Callable) -> Callable:
        def call(*args, **options):
            if self.is_full():
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return function(*args, **options)

        return call


def contents(folder: Path) -> dict[str, bytes]:
    """All files but TensorBoard's, of which each start has one, and the ledger; without the times that trainings took."""
    files = (p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(("events", ".fingerprints")))
    return {str(p.relative_to(folder)): re.sub(rb'"(cpu_)?seconds": [\d.]+', b"", p.read_bytes()) for p in files}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # the thread of `SummaryWriter`
def test_a_training_survives_a_full_disk_at_every_write(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(run_folder, "KEPT_CHECKPOINTS", 1)
    config = LoopConfig(steps=2, log_every=1, save_every=1, device="cpu")
    train(Line(), config, tmp_path / "whole", {})
    expected, full, is_over = contents(tmp_path / "whole"), 0, False
    assert [name for name in expected if name.startswith("step")] == ["step_0000002.json", "step_0000002.safetensors"]
    while not is_over:
        full += 1
        run = tmp_path / str(full)
        with pytest.MonkeyPatch.context() as patch:
            disk = Disk(patch, full)
            try:
                train(Line(), config, run, {})
            except MachineError as e:
                assert "cannot be written (No space left on device)" in str(e)  # noqa: PT017
                assert str(run) in str(e)  # noqa: PT017
            is_over = disk.writes < full
        train(Line(), config, run, {})
        assert contents(run) == expected, full
    assert full > 30


def work(item: str, output: Path) -> None:
    write_json(output, item * 1000)


def test_jobs_survive_a_full_disk_at_every_write(tmp_path) -> None:
    old, new = (
        [(name, letter, tmp_path / name, letter) for name, letter in zip("123", letters, strict=True)]
        for letters in ("abc", "ABC")
    )
    full, is_over = 0, False
    while not is_over:
        full += 1
        run_jobs(work, [Job(*values) for values in old], tmp_path, workers=1)
        with pytest.MonkeyPatch.context() as patch:
            disk = Disk(patch, full)
            try:
                run_jobs(work, [Job(*values) for values in new], tmp_path, workers=1)
            except MachineError as e:
                assert "cannot be written (No space left on device)" in str(e)  # noqa: PT017
            is_over = disk.writes < full
        for (_, before, output, _), (_, after, _, _) in zip(old, new, strict=True):
            assert json.loads(output.read_text()) in (before * 1000, after * 1000)
        again = run_jobs(work, [Job(*values) for values in new], tmp_path, workers=1)
        assert (len(again.done) + len(again.skipped), again.failed) == (3, {})
        assert [json.loads(v[2].read_text())[0] for v in new] == ["A", "B", "C"], full
        assert {p.name for p in tmp_path.iterdir()} == {"1", "2", "3", ".fingerprints.jsonl"}
    assert full > 20


def test_what_a_full_disk_left_of_the_ledgers_last_line_costs_one_job(tmp_path) -> None:
    run_jobs(work, [Job("1", "a", tmp_path / "1", "f")], tmp_path, workers=1)
    for torn in (b'\n["1", "f', b"\n5\n", b"\n\xff\xfe\n", b'\n[["1"], "f"]\n'):
        with (tmp_path / ".fingerprints.jsonl").open("ab") as ledger:
            ledger.write(torn)
        summary = run_jobs(work, [Job(n, "a", tmp_path / n, "f") for n in "12"], tmp_path, workers=1)
        assert "1" in summary.skipped
        assert run_jobs(work, [Job(n, "a", tmp_path / n, "f") for n in "12"], tmp_path, workers=1).done == ()


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Every file, by whatever library, can grow to this size only (bytes)."""
    before, stderr = resource.getrlimit(resource.RLIMIT_FSIZE), sys.stderr
    sys.stderr = io.StringIO()  # pytest's is a file, too
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.stderr = stderr


@dataclass(frozen=True)
class Config:
    size: int = 1


def _figure(path: Path, _) -> None:
    with atomic_path(path) as temporary:
        temporary.write_bytes(figure_png(new_figure(4, 3)))


def _video(path: Path, _) -> None:
    rng = np.random.default_rng(0)
    write_video(path, [rng.integers(0, 255, (80, 120, 3)).astype(np.uint8) for _ in range(12)])


WRITERS = {
    "scene.json": lambda path, scene: save(path, scene),
    "figure.png": _figure,
    "video.mp4": _video,
    "part.safetensors": lambda path, _: save_checkpoint(path.parent, "part", {"a": torch.arange(9000.0)}, Config(), {}),
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_kind_of_file_is_whole_or_as_before(name: str, small_scene, tmp_path) -> None:
    path, write = tmp_path / name, WRITERS[name]
    write(path, small_scene)
    whole = path.read_bytes()
    path.write_bytes(b"before")
    for size in sorted({0, 1, 100, 4096, len(whole) // 2, len(whole) - 1}):
        if size < len(whole):
            with largest_file(size), pytest.raises(MachineError, match=r"cannot be written \(File too large\)"):
                write(path, small_scene)
            assert path.read_bytes() == b"before", size
            assert not [p.name for p in tmp_path.iterdir() if p.name.startswith(".")]
    write(path, small_scene)
    assert path.read_bytes() == whole


def test_a_full_disk_takes_no_row_of_an_experiment(tmp_path) -> None:
    rows = "".join(f"  - {{name: r{k}, published: [1, 2, 3, 4, 5, 6, {k}]}}\n" for k in range(3))
    (tmp_path / "e.yaml").write_text(f"title: T\nrows:\n{rows}")
    run_experiment(tmp_path / "e.yaml", tmp_path / "results")
    expected, full, is_over = contents(tmp_path / "results"), 0, False
    changed = rows.replace("r1, published: [1", "r1, published: [9")
    while not is_over:
        full += 1
        (tmp_path / "e.yaml").write_text(f"title: T\nrows:\n{changed}")
        with pytest.MonkeyPatch.context() as patch:
            disk = Disk(patch, full)
            try:
                run_experiment(tmp_path / "e.yaml", tmp_path / "results")
            except MachineError as e:
                assert "cannot be written (No space left on device)" in str(e)  # noqa: PT017
            is_over = disk.writes < full
        kept = {row["settings"]["name"] for row in json.loads((tmp_path / "results" / "e.json").read_text())["rows"]}
        assert {"r0", "r2"} <= kept
        (tmp_path / "e.yaml").write_text(f"title: T\nrows:\n{rows}")
        run_experiment(tmp_path / "e.yaml", tmp_path / "results")
        assert contents(tmp_path / "results") == expected, full


class _Watched:
    """A pipeline that has seen the example, and may fail before it says what."""

    def __init__(self, error: Exception | None) -> None:
        self.error = error

    def perceive(self, **_) -> SimpleNamespace:
        if self.error:
            raise self.error
        return SimpleNamespace(scene=load(TRUTH, Scene))


@pytest.mark.parametrize(
    "error",
    [OSError(errno.EDQUOT, "Disk quota exceeded"), MemoryError(), MachineError("scene.json: cannot be written")],
)
def test_what_a_failing_machine_leaves_undone_is_not_scored(error, tmp_path, monkeypatch, capsys) -> None:
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "video_500002.mp4").write_bytes(VIDEO.read_bytes())
    common = {"questions": str(QUESTIONS), "data": str(tmp_path / "videos"), "source": "videos", "programs": "gold"}
    common["cache"] = str(tmp_path / "cache")
    (tmp_path / "e.yaml").write_text(json.dumps({"title": "T", "common": common, "rows": [{"name": "a"}]}))
    evaluation = ["evaluate", *(f"--{name}={value}" for name, value in common.items()), "--keep-going"]
    evaluation += ["--submission", str(tmp_path / "s.json"), "-o", str(tmp_path / "report.json")]
    experiment = ["experiment", str(tmp_path / "e.yaml"), "-o", str(tmp_path / "results"), "--keep-going"]
    written = [tmp_path / "s.json", tmp_path / "report.json", tmp_path / "results" / "e.json"]

    monkeypatch.setattr(runner, "worker_pipeline", lambda *_: _Watched(error))
    assert [main(evaluation), main(experiment)] == [2, 2]
    assert capsys.readouterr().err.splitlines()[-1].startswith("error: ")
    assert not any(path.exists() for path in written)
    monkeypatch.setattr(runner, "worker_pipeline", lambda *_: _Watched(None))
    assert [main(evaluation), main(experiment)] == [0, 0]
    assert all(path.exists() for path in written)
    assert json.loads(written[-1].read_text())["rows"][0]["table"]["descriptive"]["accuracy"] == 1


def test_the_lock_of_a_full_disk_holds(tmp_path) -> None:
    def take() -> None:
        with locked(tmp_path):
            pass

    with largest_file(0), locked(tmp_path), ThreadPoolExecutor(1) as pool:
        taken = pool.submit(take)
        with pytest.raises(DataError, match="another process writes to it"):
            taken.result()


@contextmanager
def no_more_files() -> Iterator[None]:
    """No further file can be opened."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    os.close(lowest := os.open(os.devnull, os.O_RDONLY))
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_files_that_the_system_does_not_open_are_not_damaged(tmp_path: Path, tiny_frames: Path) -> None:
    write_json(tmp_path / MANIFEST, {"features": {}, "shapes": {"pooled": [1, 2]}})
    save_file({"pooled": np.zeros((1, 2), np.float16)}, feature_file(tmp_path, 3))
    features = FeatureCache(tmp_path)
    frames = FrameDataset(tiny_frames, "all")
    for read in (lambda: features.get(3, {"pooled"}), lambda: frames[0]):
        with no_more_files(), pytest.raises(MachineError, match="Too many open files"):
            read()
        read()
