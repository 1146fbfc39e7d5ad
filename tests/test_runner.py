"""The runner of long work: what is kept, what is done again."""

import copy
import os
import pickle
import shutil
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nsdr
from nsdr import DataError, Scene
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import Job, run_jobs
from nsdr.io.ledger import LEDGER


def write(item: str, output: Path) -> None:
    if item == "bad":
        raise ValueError("bad item")
    output.write_text(item)


def jobs(folder: Path, items: dict[str, str], settings: str = "") -> list[Job[str]]:
    return [Job(name, item, folder / name, fingerprint(inputs=[item], config=settings)) for name, item in items.items()]


def test_outputs_are_kept_under_their_fingerprint(tmp_path) -> None:
    first = run_jobs(write, jobs(tmp_path, {"a": "1", "b": "2", "c": "bad"}), tmp_path, workers=1)
    assert (first.done, first.skipped, dict(first.failed)) == (("a", "b"), (), {"c": "ValueError: bad item"})
    assert "bad item" in (tmp_path / "failures.json").read_text()
    second = run_jobs(write, jobs(tmp_path, {"a": "1", "b": "changed", "c": "3"}), tmp_path, workers=1)
    assert (second.done, second.skipped, dict(second.failed)) == (("b", "c"), ("a",), {})
    assert (tmp_path / "b").read_text() == "changed"
    assert not (tmp_path / "failures.json").exists()
    third = run_jobs(write, jobs(tmp_path, {"a": "1", "b": "changed"}, "other settings"), tmp_path, workers=1)
    assert third.done == ("a", "b")


def test_an_output_without_its_line_is_done_again(tmp_path) -> None:
    run_jobs(write, jobs(tmp_path, {"a": "1", "b": "2"}), tmp_path, workers=1)
    lines = (tmp_path / LEDGER).read_text()
    (tmp_path / LEDGER).write_text(lines[:-5])  # killed while the last line was written
    assert run_jobs(write, jobs(tmp_path, {"a": "1", "b": "2"}), tmp_path, workers=1).done == ("b",)
    assert run_jobs(write, jobs(tmp_path, {"a": "1", "b": "2"}), tmp_path, workers=1).skipped == ("a", "b")


def test_a_failure_leaves_the_earlier_output_which_is_not_taken_for_a_new_one(tmp_path) -> None:
    run_jobs(write, jobs(tmp_path, {"a": "1"}), tmp_path, workers=1)
    assert "a" in run_jobs(write, jobs(tmp_path, {"a": "bad"}), tmp_path, workers=1).failed
    assert (tmp_path / "a").read_text() == "1"
    (tmp_path / "a").write_text("as if killed after writing, before the ledger")
    assert run_jobs(write, jobs(tmp_path, {"a": "1"}), tmp_path, workers=1).done == ("a",)
    assert (tmp_path / "a").read_text() == "1"


def test_fingerprints_read_large_files_piece_by_piece(tmp_path) -> None:
    file = tmp_path / "large.mp4"
    with file.open("wb") as opened:
        opened.truncate(1 << 26)  # 64 MiB of zeros
    small = fingerprint(inputs=[b"a" * 10])
    tracemalloc.start()
    found = fingerprint(inputs=[file])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 23
    assert found == fingerprint(inputs=[bytes(1 << 26)]) != small


def test_fingerprints_depend_on_content_settings_and_weights(tmp_path) -> None:
    file, weights = tmp_path / "input", tmp_path / "weights"
    file.write_text("one")
    weights.mkdir()
    (weights / "a.safetensors").write_bytes(b"1")
    before = fingerprint(inputs=[file], config={"x": 1}, weights=[weights])
    assert before == fingerprint(inputs=[file], config={"x": 1}, weights=[weights])
    assert before != fingerprint(inputs=[file], config={"x": 2}, weights=[weights])
    file.write_text("two")
    assert before != (changed := fingerprint(inputs=[file], config={"x": 1}, weights=[weights]))
    (weights / "a.safetensors").write_bytes(b"2")
    assert changed != fingerprint(inputs=[file], config={"x": 1}, weights=[weights])
    with pytest.raises(DataError, match=r"nowhere: no such file"):
        fingerprint(inputs=[tmp_path / "nowhere"])


def test_equal_values_have_one_fingerprint_and_others_another(small_scene: Scene) -> None:
    other = pickle.loads(pickle.dumps(small_scene))
    visible = np.asfortranarray(small_scene.visible)
    as_fortran = replace(
        copy.copy(small_scene), visible=visible, counterfactual=dict(reversed(other.counterfactual.items()))
    )
    values = [small_scene, other, as_fortran]
    assert len({fingerprint(inputs=[value]) for value in values}) == 1
    assert fingerprint(inputs=[replace(small_scene, events=())]) != fingerprint(inputs=[small_scene])
    assert len({fingerprint(inputs=[v]) for v in (1, 2, "1", None, True, (1,), [(1,)], b"1", {"1": 1})}) == 9
    with pytest.raises(DataError, match="object has no fingerprint"):
        fingerprint(inputs=[object()])


def test_the_output_of_another_source_is_not_replaced(tmp_path: Path) -> None:
    """Two folders hold videos of the same numbers; a moved or changed video, or other settings, are no other source."""

    def run(source: Path, settings: str = "") -> tuple[str, ...]:
        value = fingerprint(inputs=[source], config=settings)
        job = Job("1", source.read_text(), tmp_path / "out" / "scene_1.json", value, source)
        return run_jobs(write, [job], tmp_path / "out", workers=1).done

    first, second, moved = (tmp_path / name / "video_1.mp4" for name in ("a", "b", "moved"))
    for path, content in ((first, "one"), (second, "two")):
        path.parent.mkdir()
        path.write_text(content)
    assert run(first) == ("1",)
    for settings in ("", "other"):
        with pytest.raises(
            DataError, match=r"a/video_1\.mp4; .*b/video_1\.mp4 would replace it: choose another folder"
        ):
            run(second, settings)
    assert (tmp_path / "out" / "scene_1.json").read_text() == "one"
    first.write_text("changed")
    assert run(first) == ("1",)
    shutil.move(first.parent, moved.parent)
    assert run(moved) == ()
    assert run(moved, "other") == ("1",)


@pytest.mark.parametrize("name", ["failures.json", ".fingerprints.jsonl", "a"])
def test_no_two_things_are_written_to_one_file(name: str, tmp_path: Path) -> None:
    listed = [Job("a", "1", tmp_path / "a", "x"), Job("b", "2", tmp_path / name, "x")]
    with pytest.raises(DataError, match=f"{name}: would be written by"):
        run_jobs(write, listed, tmp_path, workers=1)
    assert not (tmp_path / "a").exists()


def test_the_revision_is_that_of_the_package_and_not_of_a_repository_around_it(tmp_path: Path) -> None:
    package = tmp_path / ".venv" / "nsdr"
    shutil.copytree(Path(nsdr.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__", "checkpoints"))
    (tmp_path / "mine.txt").write_text("")
    (tmp_path / ".gitignore").write_text(".venv\n")
    who = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
    for command in (["init", "-q"], ["add", "."], [*who, "commit", "-q", "-m", "mine"]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    code = "from nsdr.io.fingerprint import code_revision, __file__ as f; print(f, code_revision())"
    run = [sys.executable, "-c", code]
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    path, revision = subprocess.check_output(run, env=environment, cwd=tmp_path, text=True).split()
    assert Path(path).is_relative_to(package)
    assert revision[0].isdigit()
    assert "." in revision
