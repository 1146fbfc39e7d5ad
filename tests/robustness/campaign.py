"""Run all cases and print what went wrong: `python -m tests.robustness.campaign [part of a rule ...]`."""

import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import local

from tests.robustness.case import Case
from tests.robustness.cases import all_cases
from tests.robustness.good import write_good
from tests.robustness.worker import Result, Worker

KINDS = {
    "crash": "a traceback, a signal, or Python's own exception as message",
    "silent": "accepted: status 0 and no complaint",
    "status 0": "a complaint, but status 0",
    "hang": "more than 10 s of CPU time, or killed",
    "memory": "more than 2.5 GB",
    "lines": "not one line on standard error that begins with error:",
    "unnamed": "the file or option is not named",
    "place": "the key, line or value is not named",
    "written": "a file was written, changed or removed",
}
"""What can go wrong with a case."""
CPU_SECONDS, MEMORY_BYTES = 10.0, 2_500_000_000
BUILTIN = re.compile(
    r"Traceback|a bug in nsdr|\b(Key|Type|Value|Index|Attribute|ZeroDivision|Runtime|Overflow|Assertion|Memory"
    r"|Recursion|OS|EOF|Import"
    r"|Unicode\w+|JSONDecode|FileNotFound|IsADirectory|NotADirectory|Permission|FileExists|NotImplemented)Error\b"
    r"|BadZipFile|StopIteration"
)


def run_case(case: Case, worker: Worker, folder: Path, good: Path) -> tuple[Result, dict[str, str]]:
    """Run a case in an empty folder; returns what the command did, and what is wrong with that by kind."""
    folder.mkdir(parents=True)
    case.write(folder, good)
    before = _content(folder)
    result = worker.run([a.replace("{good}", str(good)) for a in case.argv], folder)
    wrong = found_wrong(case, result)
    after = _content(folder)
    changed = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    if changed:
        wrong["written"] = ", ".join(changed)
    return result, wrong


def found_wrong(case: Case, result: Result) -> dict[str, str]:
    """What is wrong with a result, by the names in `KINDS`."""
    wrong = {}
    text = result.err + result.out
    lines = [line for line in result.err.splitlines() if line.strip() and not line.startswith(("warning: ", "note: "))]
    if result.ended.startswith("killed") or result.seconds > CPU_SECONDS:
        wrong["hang"] = f"{result.seconds:.1f} s"
    if result.memory > MEMORY_BYTES:
        wrong["memory"] = f"{result.memory / 1e9:.1f} GB"
    exception = BUILTIN.search(text)
    if exception or (result.ended and not result.ended.startswith("killed")):
        wrong["crash"] = exception[0] if exception else result.ended
    elif result.status == 0:
        wrong["status 0" if "error" in text or "failed" in text else "silent"] = ""
    elif not wrong:
        if len(lines) != 1 or not lines[0].startswith("error: "):
            wrong["lines"] = f"{len(lines)} lines"
        elif not any(name in lines[0] for name in case.named.split("|")):
            wrong["unnamed"] = case.named
        elif case.place not in lines[0]:
            wrong["place"] = case.place
    return wrong


def _content(folder: Path) -> dict[str, object]:
    """Everything below a folder but its locks: a file's time and size, by name."""
    found: dict[str, object] = {}
    for path in folder.rglob("*"):
        if path.name not in (".lock", ".lock_owner.json") and not path.is_dir():
            status = path.lstat()
            found[str(path.relative_to(folder))] = (status.st_size, status.st_mtime_ns)
    return found


def main(parts: Sequence[str]) -> int:
    """Run the cases whose rule holds one of `parts`, or all; prints the failures and the figures."""
    cases = [c for c in all_cases() if not parts or any(part in c.id for part in parts)]
    workers, kept = local(), []

    def run(number: int) -> tuple[Case, Result, dict[str, str]]:
        if not hasattr(workers, "worker"):
            workers.worker = Worker()
            kept.append(workers.worker)
        folder = base / f"case_{number}"
        result, wrong = run_case(cases[number], workers.worker, folder, good)
        shutil.rmtree(folder, ignore_errors=True)
        return cases[number], result, wrong

    with tempfile.TemporaryDirectory() as temporary:
        base, good = Path(temporary), Path(temporary) / "good"
        good.mkdir()
        write_good(good)
        counts: Counter[str] = Counter()
        worst = [0.0, 0.0]
        with ThreadPoolExecutor(2) as pool:
            for case, result, wrong in pool.map(run, range(len(cases))):
                counts.update(list(wrong))
                counts["bad"] += bool(wrong)
                worst = [max(worst[0], result.seconds), max(worst[1], result.memory / 1e9)]
                if wrong:
                    print(f"{case.id}\n  nsdr {' '.join(a[:80] for a in case.argv)}")
                    print("  " + "; ".join(f"{kind}: {detail}" if detail else kind for kind, detail in wrong.items()))
                    print("  " + " / ".join(result.err.strip().splitlines()[-2:])[:300], flush=True)
        for worker in kept:
            worker.close()
    print(f"\n| figure | |\n|---|---|\n| cases | {len(cases)} |\n| rules | {len({c.rule for c in cases})} |")
    for kind, meaning in KINDS.items():
        print(f"| {kind} ({meaning}) | {counts[kind]} |")
    print(f"| cases with any of these | {counts['bad']} |")
    print(f"| most CPU time | {worst[0]:.1f} s |\n| most memory | {worst[1]:.2f} GB |")
    return int(counts["bad"] > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
