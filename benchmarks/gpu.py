"""Everything that runs on a GPU, once: `python -m benchmarks.gpu -o results/gpu.md [--device cuda] [--small]` (`make gpu`).

Each part's results and a step of every training, compared with the CPU's; a resumed run of every training, compared with an
uninterrupted one; frames per second from video to answer (`benchmarks.gpu_rows`). Without a GPU, results and single steps are
those of a simulated second device, and the rest runs on the CPU.

The table is written after each row, so that what is done stays when the rest is killed. A row that fails is in the table with
its reason. After it a new process goes on, because an error of CUDA spoils its process.

Making the data needs the extra `generate`. Where that is missing, `--data` takes the folder `data` that another machine made in
its `--work`.
"""

import json
import platform
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from threading import local

import torch
from msgspec.structs import replace
from tqdm import tqdm

from benchmarks import gpu_rows
from benchmarks.gpu_rows import SIMULATED, Result, Setting, nsdr
from benchmarks.shared import parser_of, table
from nsdr.clevrer.example import VIDEO
from nsdr.clevrer.files.questions import write_questions
from nsdr.errors import DataError
from nsdr.frame_parser.parser import FrameParser
from nsdr.io.device import available_cores, resolve_device
from nsdr.io.files import atomic_path
from nsdr.io.fingerprint import code_revision
from nsdr.io.video import read_frames
from nsdr.world.world import CLEVRER_WORLD

TARGET = 400
"""Frames per second from video to answer that one GPU should reach."""
EVALUATED_BATCH = 32
"""Frames in a batch of the frame parser, from video to answer."""
ADDED_VIDEOS = 48
"""Videos that a longer run from video to answer has more than a shorter one."""
UNTIMED = ("results", "one step", "resumed")
"""Kinds of rows that find no times, so that several of them are measured at once."""
COLUMNS = ("what", "found", "as expected", "time", "memory")
GIB = 2**30
Row = Callable[[Setting], Result]
"""Measures one row of the table."""


def rows(small: bool) -> dict[str, Row]:
    """What is measured, by name, the most important rows first; fewer rows of frames where it is `small`."""
    found: dict[str, Row] = {
        "results: frame parser, float32": partial(gpu_rows.frame_parser, precision="float32"),
        "results: frame parser, auto": partial(gpu_rows.frame_parser, precision="auto"),
        "results: question parser": gpu_rows.question_parser,
        "results: collision network": gpu_rows.collision_network,
    }
    for name in ("physics", "propnet", "propnet_patches", "propnet_images"):
        found[f"results: dynamics {name}"] = partial(gpu_rows.dynamics, name=name)
    found["results: video to answers"] = gpu_rows.pipeline
    for title, row in (("one step", gpu_rows.one_step), ("resumed", gpu_rows.resumed)):
        found |= {f"{title}: {name}": partial(row, name=name) for name in gpu_rows.trainings()}
    found["frames: by stage"] = stages
    for workers in (1, 4, 16)[: 1 if small else None]:
        title = f"frames: video to answer, --workers {workers}, batches of {EVALUATED_BATCH}"
        found[title] = partial(video_to_answer, workers=workers, batch_size=EVALUATED_BATCH)
    return found


def stages(setting: Setting) -> Result:
    """Frames per second of one process: of decoding alone, and of the frame parser with frames in memory."""
    begin = time.perf_counter()
    frames = list(read_frames(VIDEO))
    found = [f"decoding {len(frames) / (time.perf_counter() - begin):.0f}"]
    for size in (8,) if setting.small else (8, 32, 128):
        parser = FrameParser.from_pretrained(device=setting.real, batch_size=size)
        parser.parse(frames[:size])
        shown = frames[:size] if setting.small else frames
        begin = time.perf_counter()
        parser.parse(shown)
        found.append(f"frame parser {len(shown) / (time.perf_counter() - begin):.0f} in batches of {size}")
    return f"{', '.join(found)} frames/s", True


def video_to_answer(setting: Setting, workers: int, batch_size: int) -> Result:
    """Frames per second of `nsdr evaluate`: of the videos that a longer run has more than a shorter one, so without start."""
    split, folder, on_gpu = setting.videos(), setting.work / "copies", setting.real != "cpu"
    sources, asked = [path.read_bytes() for path in split.entries("videos").values()], split.questions()
    few, many = (1, 2) if setting.small else (2 * workers, 2 * workers + ADDED_VIDEOS)
    folder.mkdir(exist_ok=True)
    scenes = []
    for i in range(many):
        name, box = f"video_{i:05d}.mp4", struct.pack(">I4sI", 12, b"free", i)  # makes each copy another file
        (folder / name).write_bytes(sources[i % len(sources)] + box)
        scenes.append(replace(asked[i % len(asked)], scene_index=i, video_filename=name))
    write_questions(folder / "questions.json", scenes)
    report, seconds, used = folder / "report.json", list[float](), [0]

    def watch() -> None:
        free, total = torch.cuda.mem_get_info(setting.real)
        used.append(total - free)

    options = {"--source": "videos", "--data": folder, "--questions": folder / "questions.json", "--output": report}
    options |= {"--device": setting.real, "--workers": workers, "--set": f"batch_size={batch_size}"}
    for limit in (few, many):
        with tempfile.TemporaryDirectory() as cache:
            arguments = [x for pair in {**options, "--limit": limit, "--cache": cache}.items() for x in pair]
            begin = time.perf_counter()
            nsdr("evaluate", *arguments, "--keep-going", watch=watch if on_gpu else None)
            seconds.append(time.perf_counter() - begin)
    rate = (many - few) * CLEVRER_WORLD.timeline.frames / (seconds[1] - seconds[0])
    done = json.loads(report.read_text())
    text = f"{rate:.0f} frames/s (target {TARGET}; {few} videos in {seconds[0]:.0f} s, {many} in {seconds[1]:.0f} s)"
    memory = f"; {max(used) / GIB:.1f} GiB of the GPU in use" if on_gpu else ""
    return f"{text}{memory}; {done['errors']} of {len(done['results'])} questions failed", not done["errors"]


def measured(row: Row, setting: Setting) -> tuple[str, ...]:
    """The cells of a row after its name: what was found, verdict, seconds, and peak memory in this process."""
    on_gpu = torch.cuda.is_available() and setting.real != "cpu"
    if on_gpu:
        torch.cuda.reset_peak_memory_stats(setting.real)
    begin = time.perf_counter()
    text, is_well = row(setting)
    seconds = time.perf_counter() - begin
    peak = f"{torch.cuda.max_memory_reserved(setting.real) / GIB:.2f}" if on_gpu else "-"
    return text, "yes" if is_well else "**no**", f"{seconds:.0f}", peak


def all_measured(chosen: Mapping[str, Row], setting: Setting, at_once: int) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Name and other cells of each row as it is done, `at_once` rows at a time where they find no times.

    An error, or the death of the process that measures, costs one row.
    """
    here, pools = local(), list[ProcessPoolExecutor]()

    def cells_of(name: str) -> tuple[str, tuple[str, ...]]:
        if getattr(here, "pool", None) is None:
            here.pool = ProcessPoolExecutor(1, get_context("spawn"))
            pools.append(here.pool)
        try:
            return name, here.pool.submit(measured, chosen[name], setting).result()
        except Exception as e:
            here.pool.shutdown()
            here.pool, reason = None, " ".join(f"{type(e).__name__}: {e}".split())[:200].replace("|", "/")
            return name, (reason, "**failed**", "-", "-")

    untimed = [name for name in chosen if name.startswith(UNTIMED)]
    with tqdm(total=len(chosen), unit="row") as bar:
        for names, size in ((untimed, at_once), ([name for name in chosen if name not in untimed], 1)):
            with ThreadPoolExecutor(size) as threads:
                for done in as_completed([threads.submit(cells_of, name) for name in names]):
                    bar.update()
                    yield done.result()
            while pools:
                pools.pop().shutdown()


def heading(setting: Setting, revision: str) -> str:
    """What was measured, where and with what."""
    if setting.device == SIMULATED:
        where = "no GPU: results and single steps are of a simulated second device, the rest of the CPU"
    elif torch.cuda.is_available() and setting.device != "cpu":
        where = f"{torch.cuda.get_device_name(setting.device)}, CUDA {torch.version.cuda}"
    else:
        where = setting.device
    size = " with `--small`" if setting.small else ""
    return (
        "# Everything on a GPU\n\n"
        f"`make gpu`{size} at revision {revision}, {time.strftime('%Y-%m-%d')}. Device: {where}; "
        f"{available_cores()} cores, torch {torch.__version__}, Python {platform.python_version()}.\n"
        "Time in seconds; memory is the most that torch reserved on the GPU in one process, GiB.\n\n"
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    default = "cuda" if torch.cuda.is_available() else SIMULATED
    parser.add_argument("--device", default=default, help=f"of torch, or {SIMULATED}; {default} by default here")
    parser.add_argument("--small", action="store_true", help="few frames, videos and steps, to try the script")
    parser.add_argument("--only", nargs="+", default=[""], help="rows whose names contain one of these")
    parser.add_argument("--data", type=Path, help="folder that an earlier run made in its --work; made anew without")
    parser.add_argument("--at-once", type=int, default=min(4, available_cores()), help="rows without times at a time")
    parser.add_argument("--revision", default=code_revision(), help="of the code, where the folder of Git is missing")
    parser.add_argument("--work", type=Path, default=Path("runs/gpu"), help="folder of data and runs, which is kept")
    options = parser.parse_args(argv)
    made = options.data and options.data.resolve()
    setting = Setting(options.device, options.work.resolve(), options.small, made)
    try:
        resolve_device(setting.real)
    except DataError as e:
        parser.error(str(e))
    chosen = {name: row for name, row in rows(setting.small).items() if any(part in name for part in options.only)}
    if not chosen:
        parser.error(f"no row has {' or '.join(options.only)} in its name")
    setting.work.mkdir(parents=True, exist_ok=True)
    found = dict[str, tuple[str, ...]]()
    for name, cells in all_measured(chosen, setting, options.at_once):
        found[name] = cells
        with atomic_path(options.output) as temporary:  # what is done is kept if the rest is killed
            text = table(COLUMNS, [(known, *found[known]) for known in chosen if known in found])
            temporary.write_text(f"{heading(setting, options.revision)}{text}\n", encoding="utf-8")
    failures = sum(cells[1] != "yes" for cells in found.values())
    print(f"{options.output}: {failures} of {len(chosen)} rows not as expected")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
