"""Task engines: failures, lost workers, a Ray cluster of two nodes."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from nsdr import CheckpointError, DataError
from nsdr.errors import MachineError
from nsdr.io import tasks
from nsdr.io.tasks import run_tasks


def double(number: int) -> int:
    if number == 3:
        raise ValueError("three")
    return 2 * number


def die_once(folder: str, number: int) -> int:
    """Kills its process the first time that it is asked for 2."""
    mark = Path(folder) / "died"
    if number == 2 and not mark.exists():
        mark.touch()
        os._exit(1)
    return number


def kill_at_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.4)  # others run when it dies
    return number


def die(number: int) -> int:
    os._exit(5)


def fail_at_one(error: Exception, number: int) -> int:
    """The machine fails at task 1; others take a while."""
    if number == 1:
        raise error
    time.sleep(0.1)
    return number


def unsendable(number: int) -> object:
    return threading.Lock()


def openmp_threads(number: int) -> str:
    return os.environ["OMP_NUM_THREADS"]


def wait_for(folder: str, number: int) -> int:
    """Says that it runs, and ends when it may."""
    (Path(folder) / f"started-{number}-{time.monotonic_ns()}").touch()
    while not (Path(folder) / "go").exists():
        time.sleep(0.05)
    return number


def sleep_under_own_name(folder: str, number: int) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)


def begin_and_end(folder: str, number: int) -> None:
    """Task 0 ends, others do not."""
    Path(folder).mkdir(exist_ok=True)
    (Path(folder) / f"begin-{number}").write_text(str(os.getpid()))
    while number:
        time.sleep(0.05)
    (Path(folder) / f"end-{number}").touch()


def refuse() -> None:
    raise ValueError("not here")


class Unreadable:
    """An item that can be sent, but not received."""

    def __reduce__(self) -> object:
        return refuse, ()


@pytest.mark.parametrize("workers", [1, 2])
def test_all_tasks_end_and_failures_are_told(workers: int) -> None:
    outcomes = {o.item: o for o in run_tasks(double, range(5), workers=workers)}
    assert {i: o.result for i, o in outcomes.items()} == {0: 0, 1: 2, 2: 4, 3: None, 4: 8}
    assert outcomes[3].error == "ValueError: three"


def test_a_lost_workers_tasks_are_done_again(tmp_path) -> None:
    outcomes = list(run_tasks(partial(die_once, str(tmp_path)), range(5), workers=2))
    assert sorted(o.result for o in outcomes) == [0, 1, 2, 3, 4]


def test_a_task_that_kills_its_worker_ends_the_work_after_the_others() -> None:
    results = []
    with pytest.raises(MachineError, match=r"^3: its worker process died \(exit code SIGKILL.*memory"):  # noqa: PT012
        for outcome in run_tasks(kill_at_three, range(1, 9), workers=2):
            results.append(outcome.result)
    assert sorted(results) == [1, 2, 4, 5, 6, 7, 8]


@pytest.mark.parametrize(("function", "how"), [(die, r"died \(exit code EXIT\(5\)\)"), (unsendable, "cannot be sent")])
def test_lost_tasks_end_the_work(function, how) -> None:
    with pytest.raises(MachineError, match=rf"^[01]: .*{how}.* \(2 tasks in all\)$"):
        list(run_tasks(function, range(2), workers=2))


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.ENOSPC, "No space left on device"),
        OSError(errno.EDQUOT, "Disk quota exceeded"),
        OSError(errno.EMFILE, "Too many open files"),
        MemoryError(),
        RuntimeError("CUDA out of memory. Tried to allocate 2.00 GiB"),
        MachineError("a.json: cannot be written"),
        CheckpointError("frame_parser.safetensors: damaged"),
    ],
)
def test_the_first_error_of_the_machine_ends_the_work(error, workers) -> None:
    seen = []
    with pytest.raises(CheckpointError if isinstance(error, CheckpointError) else MachineError, match=r"\w"):  # noqa: PT012
        for outcome in run_tasks(partial(fail_at_one, error), range(100), workers=workers):
            seen.append(outcome.item)
    assert len(seen) < 10


def test_programs_need_no_guard(tmp_path) -> None:
    program = tmp_path / "unguarded.py"
    program.write_text("from nsdr.io.tasks import run_tasks\nprint(len(list(run_tasks(abs, range(2), workers=2))))\n")
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("2\n", "")


@pytest.mark.parametrize(("own", "expected"), [(None, "4"), ("2", "2"), ("64", "4")])
def test_workers_share_the_cores(monkeypatch, own, expected) -> None:
    monkeypatch.setattr(tasks, "available_cores", lambda: 9)
    if own is None:
        monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    else:
        monkeypatch.setenv("OMP_NUM_THREADS", own)
    found = []
    for outcome in run_tasks(openmp_threads, range(3), workers=2):
        found.append(outcome.result)
        assert os.environ.get("OMP_NUM_THREADS") == own  # only the workers' environment differs
    assert found == [expected] * 3


def running(pid: int) -> bool:
    """Zombies, which nobody has waited for, do not count."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_killed_programs_workers_end(tmp_path) -> None:
    program = (
        f"import sys; from functools import partial; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_parallel import run_tasks, sleep_under_own_name\n"
        f"list(run_tasks(partial(sleep_under_own_name, {str(tmp_path)!r}), range(2), workers=2))"
    )
    with subprocess.Popen([sys.executable, "-c", program]) as parent:
        until = time.monotonic() + 50
        while len(workers := list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
            time.sleep(0.1)
        parent.kill()
    assert len(workers) == 2
    until = time.monotonic() + 10
    while any(running(int(w.name)) for w in workers) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(running(int(w.name)) for w in workers)


def test_unknown_engines_are_refused() -> None:
    with pytest.raises(DataError, match="engine is 'grid'; expected one of processes, ray"):
        list(run_tasks(double, [1], engine="grid"))


@pytest.mark.robustness
@pytest.mark.filterwarnings("ignore")
def test_ray_does_a_lost_nodes_tasks_again(tmp_path) -> None:
    import ray
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        second = cluster.add_node(num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False, runtime_env={"env_vars": {"PYTHONPATH": os.getcwd()}})
        assert len([n for n in ray.nodes() if n["Alive"]]) == 2
        removed = False
        results = []
        tasks = run_tasks(partial(wait_for, str(tmp_path)), range(4), engine="ray")

        def lose_a_node() -> None:
            nonlocal removed
            while len({p.name.split("-")[1] for p in tmp_path.glob("started-*")}) < 2:
                time.sleep(0.05)
            cluster.remove_node(second, allow_graceful=False)
            while len([n for n in ray.nodes() if n["Alive"]]) > 1:
                time.sleep(0.05)
            removed = True
            time.sleep(3)  # its workers end when they miss it
            (tmp_path / "go").touch()

        thread = threading.Thread(target=lose_a_node)
        thread.start()
        results = [o.result for o in tasks]
        thread.join()
        assert removed
        assert sorted(results) == [0, 1, 2, 3]
        assert len(list(tmp_path.glob("started-*"))) >= 5  # one was begun again
        assert [o.error for o in run_tasks(double, [3], engine="ray")] == ["ValueError: three"]
    finally:
        ray.shutdown()
        cluster.shutdown()


@pytest.mark.robustness
@pytest.mark.filterwarnings("ignore")
def test_ray_works_in_the_programs_folder_and_ends_what_nobody_waits_for(tmp_path, monkeypatch) -> None:
    import ray
    from ray.cluster_utils import Cluster

    package = os.getcwd()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")  # as `ray start` in another folder
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        monkeypatch.chdir(tmp_path)
        ray.init(address=cluster.address, log_to_driver=False, runtime_env={"env_vars": {"PYTHONPATH": package}})
        one_by_one = run_tasks(partial(begin_and_end, "tasks"), [0, 1], engine="ray", workers=1)
        assert next(one_by_one).error is None
        assert (tmp_path / "tasks" / "end-0").exists()
        time.sleep(0.5)
        assert not (tmp_path / "tasks" / "begin-1").exists()
        one_by_one.close()
        tasks = run_tasks(partial(begin_and_end, "tasks"), [0, 1], engine="ray")
        assert next(tasks).error is None
        begun = tmp_path / "tasks" / "begin-1"
        while not (begun.exists() and begun.read_text()):
            time.sleep(0.05)
        tasks.close()
        while running(int(begun.read_text())):
            time.sleep(0.05)
        with pytest.raises(
            MachineError, match=r"cannot be sent to or from its worker, or was lost \(ValueError: not here"
        ):
            list(run_tasks(double, [Unreadable()], engine="ray"))
    finally:
        ray.shutdown()
        cluster.shutdown()
