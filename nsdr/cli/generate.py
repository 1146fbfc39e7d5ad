"""`nsdr generate dataset|violations|scene|questions`: from a YAML file and flags to files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from tqdm import tqdm

from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import write_questions
from nsdr.clevrer.files.scenes import iterate_scenes
from nsdr.cli.common import KEEP_GOING, KEEP_GOING_HELP, Command, configured, left_out
from nsdr.generate.dataset import DatasetConfig, generate_dataset
from nsdr.generate.physics.changed import TruthSimulator
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.physics.scene_config import SceneConfig
from nsdr.generate.questions.selection import QuestionConfig, find_candidates, select_questions, world_of
from nsdr.generate.scene_files import truth_document
from nsdr.generate.statistics import write_question_statistics
from nsdr.generate.violations import ViolationsConfig, generate_violations
from nsdr.io.files import check_output, check_output_folder, find_files, write_json
from nsdr.io.tasks import ENGINES, run_in_order
from nsdr.io.worlds import read_world, store_world_beside
from nsdr.language.reserved import check_vocabulary
from nsdr.validation import Count, Settings, one_of


@dataclass(frozen=True)
class SceneOptions(Settings):
    """One scene's truth file, by seed.

    Attributes:
        output: JSON file to write.
        seed: number of the scene, as `seed` in its truth file: the n-th scene of `nsdr generate dataset --seed s` has
            1,000,000 s + n.
        world: the world that the scene is in: a file, or the name of one that ships.
        scene: what scenes look like, where it is not as the world says.
    """

    output: str
    seed: Count = 0
    world: str = "clevrer"
    scene: SceneConfig = field(default_factory=SceneConfig)


@dataclass(frozen=True)
class QuestionOptions(Settings):
    """Balanced questions for scenes.

    Attributes:
        scenes: truth files (`truth_*.json`), annotation files, or compact ground truth (`.json` or `.json.gz` with a list
            of blocks); folders stand for the truth files, or else the annotation files, below them.
        output: question file to write, with `.statistics.md` beside it, and for another world than CLEVRER's with its
            `world.json`, unless the folder is of a data set of that world.
        questions: which are wanted.
        engine: "processes" or "ray".
        workers: processes, 0 for one a CPU core.
    """

    scenes: str | list[str]
    output: str
    questions: QuestionConfig = field(default_factory=QuestionConfig)
    engine: Annotated[str, one_of(ENGINES)] = "processes"
    workers: Count = 0


def _dataset(arguments: Sequence[str]) -> str:
    config = configured(
        DatasetConfig, [a for a in arguments if a != KEEP_GOING], "generate dataset", "generate", KEEP_GOING_HELP
    )
    check_output_folder(config.output)
    root = generate_dataset(config, KEEP_GOING in arguments)
    print(_splits(config))
    return str(root)


def _violations(arguments: Sequence[str]) -> str:
    config = configured(
        ViolationsConfig, [a for a in arguments if a != KEEP_GOING], "generate violations", "generate", KEEP_GOING_HELP
    )
    check_output_folder(config.output)
    root = generate_violations(config, KEEP_GOING in arguments)
    print(_splits(config))
    return str(root)


def _splits(config: DatasetConfig) -> str:
    """How many videos each split has: "4 videos: train 2, validation 1, test 1"."""
    counts = {name: len(indices) for name, indices in config.indices().items()}
    return f"{config.videos} videos: {', '.join(f'{name} {count}' for name, count in counts.items() if count)}"


def _scene(arguments: Sequence[str]) -> str:
    options = configured(SceneOptions, arguments, "generate scene", "generate")
    check_output(options.output, [".json"])
    world = read_world(options.world)
    scene = simulate_scene(options.seed, options.scene, world=world)
    write_json(options.output, truth_document(scene, options.seed, world.camera))
    return options.output


def _questions(arguments: Sequence[str]) -> str:
    options = configured(QuestionOptions, arguments, "generate questions", "generate")
    paths = [options.scenes] if isinstance(options.scenes, str) else options.scenes
    check_output(options.output, [".json"], paths)
    scenes: list[Any] = sorted((s for path in paths for s in iterate_scenes(path)), key=lambda scene: scene[0])
    world = world_of([scene for _, _, scene in scenes])
    check_vocabulary(world.vocabulary)
    store_world_beside(options.output, world)
    if options.questions.changed_per_video:
        simulators = _simulators(paths)
        scenes = [(*scene, simulators.get(scene[0])) for scene in scenes]
    find = partial(find_candidates, config=options.questions)
    found = run_in_order(find, scenes, options.engine, options.workers)
    bar = tqdm(found, total=len(scenes), unit="scene", desc="questions")
    selected = list(select_questions(bar, options.questions, world))
    output = Path(options.output)
    write_questions(output, selected)
    write_question_statistics(output.with_suffix(""), selected, world)
    return options.output


def _simulators(paths: Sequence[str]) -> dict[int, TruthSimulator]:
    """What simulates the scenes of the truth files below the paths, by scene index."""
    files = [
        file for path in map(Path, paths) for file in (find_files(path, "truth_*.json") if path.is_dir() else [path])
    ]
    truths = [read_truth_file(file) for file in files if file.name.startswith("truth_")]
    return {truth["scene_index"]: TruthSimulator(truth) for truth in truths}


def _printed(write: Callable[[Sequence[str]], str]) -> Command:
    def run(arguments: list[str]) -> int:
        written = write(arguments)
        print(written)
        return left_out(written)

    return Command(run)


FUNCTIONS = {
    f"generate {name}": _printed(write)
    for name, write in (
        ("dataset", _dataset),
        ("violations", _violations),
        ("scene", _scene),
        ("questions", _questions),
    )
}
"""What runs the commands of this file."""
