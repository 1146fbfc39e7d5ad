"""The runner of long work: what is kept, what is done again."""

import tracemalloc
from pathlib import Path

import pytest

from nsdr import DataError
from nsdr.io.fingerprint import fingerprint
from nsdr.io.jobs import LEDGER, Job, run_jobs


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
