"""Whether rewards teach a model to look: a small video-language model learns questions about objects on one CPU core.

    nsdr generate dataset --config learning -o train --videos 300 --seed 8
    nsdr generate dataset --config learning -o test --videos 100 --seed 500008
    nsdr export train --format trl -o rows_train --frames 16 --frame-width 96 --scenes
    nsdr export test --format trl -o rows_test --frames 16 --frame-width 96
    python -m benchmarks.learning rows_train rows_test -o results/learning.md --curve docs/images/learning.png

The model is our own and begins with random weights. Its vision tower learns to name the object at each place of a frame, and is
frozen. Its language part is trained on right answers for a short while, and then by `nsdr.rewards.exact` alone: it answers each
question eight times, and answers that earn more than the mean of the eight become more probable (GRPO without clipping, as each
batch is used once). A control is trained in the same way with gray frames: what it earns, the texts of the questions give away.
On other videos, the reward of the most probable answer is measured with the question's own video, with another one, and with
gray frames.

The questions are those about objects alone (`subtype` "plain"). A run that was killed resumes from its last evaluation in
`--run-dir`.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from PIL import Image
from torch import Tensor, nn
from torch.distributions import Categorical
from torch.nn import functional as F
from tqdm import tqdm

from benchmarks.shared import made_by, parser_of, percent_right, show, table
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.io.video import spaced
from nsdr.rewards import exact
from nsdr.world.world import CLEVRER_WORLD

N_FRAMES = 4
"""Frames of a video that the model gets: one from each quarter of those exported, by chance in training."""
N_TOKENS = 8
"""Places of a frame that the language part gets: those that most probably have an object."""
N_VIDEOS = 12
"""Videos in a batch, with all of their questions."""
N_ANSWERS = 8
"""Answers to a question whose rewards are compared."""
WIDTH = 128
"""Number of features of a place, and of a question."""
TOWER_STEPS = 400
EVALUATE_EVERY = 100
GRAY = 128
SHOWN = ("its own video", "another video", "gray frames")
"""What the model is shown when its reward is measured."""
WORDS = [CLEVRER_WORLD.vocabulary.words[kind] for kind in ("color", "material", "shape")]


@dataclass(frozen=True)
class Rows:
    """An export's questions and frames.

    Attributes:
        texts: (N,) questions.
        solutions: (N,) right answers in their tags.
        questions: for each of V videos, the indices of its questions.
        frames: (V, F, 3, height, width) uint8 frames.
        truths: (V,) files of true scenes; empty in an export without them.
    """

    texts: list[str]
    solutions: list[str]
    questions: list[np.ndarray]
    frames: Tensor
    truths: list[Path]

    @classmethod
    def read(cls, folder: Path) -> "Rows":
        """The rows that `nsdr export --format trl` wrote to a folder."""
        lines = [json.loads(line) for line in (folder / "train.jsonl").read_text().splitlines()]
        lines = [line for line in lines if line["subtype"] == "plain"]
        scenes = np.array([line["scene_index"] for line in lines])
        videos = {line["scene_index"]: line for line in lines}
        frames = np.stack([[np.asarray(Image.open(folder / p)) for p in v["images"]] for v in videos.values()])
        return cls(
            [line["question"] for line in lines],
            [line["solution"] for line in lines],
            [np.flatnonzero(scenes == scene) for scene in videos],
            torch.from_numpy(frames).permute(0, 1, 4, 2, 3).contiguous(),
            [folder / v["scene"] for v in videos.values() if v["scene"]],
        )

    def places(self, height: int, width: int) -> Tensor:
        """(V, F, 3, height, width) colour, material and shape of the object whose centre is in each cell, from 1; 0: none."""
        found = torch.zeros(*self.frames.shape[:2], 3, height, width, dtype=torch.long)
        camera = CLEVRER_WORLD.camera
        for video, path in zip(found, self.truths, strict=True):
            truth = read_truth_file(path)
            triples = {o["object_id"]: (o["color"], o["material"], o["shape"]) for o in truth["objects"]}
            for frame, at in zip(video, spaced(truth["n_frames"], len(video)), strict=True):
                for o in truth["frames"][at]["objects"]:
                    x, y = camera.pixels(np.array(o["location"])) / (camera.width, camera.height)
                    if 0 <= x < 1 and 0 <= y < 1:
                        numbers = [1 + w.index(word) for w, word in zip(WORDS, triples[o["object_id"]], strict=True)]
                        frame[:, int(y * height), int(x * width)] = torch.tensor(numbers)
        return found


class Tower(nn.Module):
    """A convolutional network that names the object at each place, 8 x 8 pixels, of a frame.

    Attributes:
        seconds: (scalar) CPU time that it learned for.
    """

    seconds: Tensor

    def __init__(self) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.BatchNorm2d(3)]
        for n_in, n_out, size, stride in ((3, 48, 4, 2), (48, 96, 4, 2), (96, 128, 4, 2), (128, WIDTH, 3, 1)):
            layers += [nn.Conv2d(n_in, n_out, size, stride, 1), nn.BatchNorm2d(n_out), nn.ReLU()]
        self.features = nn.Sequential(*layers)
        self.register_buffer("seconds", torch.zeros(()))
        self.names = nn.ModuleList(nn.Conv2d(WIDTH, 1 + len(words), 1) for words in WORDS)

    def learn(self, rows: Rows) -> None:
        """Learns from frames with true scenes."""
        rng, began = np.random.default_rng(0), time.process_time()
        places = rows.places(rows.frames.shape[3] // 8, rows.frames.shape[4] // 8)
        optimizer = torch.optim.AdamW(self.parameters(), 2e-3, weight_decay=0.05)
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: min(1.0, 2 - 2 * step / TOWER_STEPS))
        for _ in tqdm(range(TOWER_STEPS), "tower"):
            at = tuple(torch.from_numpy(rng.integers(0, n, 32)) for n in rows.frames.shape[:2])
            frames, truth = rows.frames[at], places[at]
            if rng.random() < 0.5:
                frames, truth = frames.flip(-1), truth.flip(-1)
            seen = self.features(frames.float())
            losses = [F.cross_entropy(names(seen), truth[:, i]) for i, names in enumerate(self.names)]
            loss = torch.stack(losses).sum()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
        self.seconds += time.process_time() - began
        self.eval()

    @torch.no_grad()
    def tokens(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """Features of the places that most probably have an object, (V, F, N_TOKENS, WIDTH), and these places."""
        seen = torch.stack([self.features(video.float()) for video in frames])
        empty = torch.stack([self.names[0](video).softmax(1)[:, 0] for video in seen])
        where = empty.flatten(2).topk(N_TOKENS, largest=False).indices
        of_places = seen.flatten(3).transpose(2, 3)
        return of_places.gather(2, where[..., None].expand(-1, -1, -1, WIDTH)), where


class Words:
    """Numbers of words and answers; an answer with its tags is one token.

    Args:
        rows: in whose questions and answers the words are.
    """

    def __init__(self, rows: Rows) -> None:
        self.answers = sorted(set(rows.solutions))
        self.words = {word: 2 + i for i, word in enumerate(sorted({w for t in rows.texts for w in t.split()}))}

    def encode(self, texts: Sequence[str]) -> Tensor:
        """(N, L) numbers of words: 0 before a text, so that the last column is its end, and 1 for a word that is not known."""
        numbers = [[self.words.get(word, 1) for word in text.split()] for text in texts]
        longest = max(map(len, numbers))
        return torch.tensor([[0] * (longest - len(row)) + row for row in numbers])


@cache
def reward(text: str, solution: str) -> float:
    """What an answer earns; there are few, so each is scored once."""
    return exact([text], [solution], [()])[0]


class LanguagePart(nn.Module):
    """A recurrent reader of the question, which scales and shifts the features of each place (FiLM), and an answer from their
    maxima and means.

    Args:
        words: words and answers that it knows.
        n_places: number of places in a frame.
    """

    def __init__(self, words: Words, n_places: int) -> None:
        super().__init__()
        self.place = nn.Embedding(n_places, WIDTH)
        nn.init.normal_(self.place.weight, std=0.02)
        self.norm = nn.LayerNorm(WIDTH)
        self.embedding = nn.Embedding(2 + len(words.words), 64, padding_idx=0)
        self.reader = nn.GRU(64, WIDTH, batch_first=True)
        self.maps = nn.ModuleList(nn.Linear(WIDTH, WIDTH) for _ in range(2))
        self.scales = nn.ModuleList(nn.Linear(WIDTH, 2 * WIDTH) for _ in range(2))
        n_features = (2 * N_FRAMES + 1) * WIDTH
        self.head = nn.Sequential(
            nn.Linear(n_features, 256), nn.ReLU(), nn.Dropout(0.1), nn.Linear(256, len(words.answers))
        )

    def forward(self, features: Tensor, where: Tensor, of_video: Tensor, words: Tensor) -> Tensor:
        """Logits of answers, (N, A).

        Args:
            features: (V, N_FRAMES, N_TOKENS, WIDTH), see `Tower.tokens`.
            where: (V, N_FRAMES, N_TOKENS).
            of_video: (N,) index of each question's video.
            words: (N, L) words of questions.
        """
        read = self.reader(self.embedding(words))[1][0]
        x = self.norm(features + self.place(where))[of_video]
        for mapped, scaled in zip(self.maps, self.scales, strict=True):
            scale, shift = scaled(read)[:, None, None].chunk(2, -1)
            x = F.relu(mapped(x) * (1 + scale) + shift)
        return self.head(torch.cat([x.amax(2).flatten(1), x.mean(2).flatten(1), read], 1))


class Run:
    """A language part in training, its evaluations so far, and their file.

    Args:
        tower: the trained tower.
        train: rows to learn from.
        test: rows about other videos.
        is_blind: whether all frames are gray in training.
        file: where the state is kept after each evaluation.

    Raises:
        ValueError: the file is of a run on other rows.
    """

    def __init__(self, tower: Tower, train: Rows, test: Rows, is_blind: bool, file: Path) -> None:
        self.train, self.test, self.name, self.file = train, test, "blind" if is_blind else "seeing", file
        gray_video = tower.tokens(torch.full_like(train.frames[:1], GRAY))

        def gray(n_videos: int) -> Sequence[Tensor]:
            return [tokens.expand(n_videos, *tokens.shape[1:]) for tokens in gray_video]

        self.learned_from = gray(len(train.frames)) if is_blind else tower.tokens(train.frames)
        self.seen, self.gray = tower.tokens(test.frames), gray(len(test.frames))
        torch.manual_seed(0)
        self.words = Words(train)
        self.model = LanguagePart(self.words, train.frames.shape[3] * train.frames.shape[4] // 64)
        self.optimizer = torch.optim.AdamW(self.model.parameters(), 1e-3, weight_decay=0.05)
        self.step, self.seconds = 0, 0.0
        self.curve: list[dict[str, Any]] = []
        self.rows = sha256(repr([(rows.texts, rows.solutions) for rows in (train, test)]).encode()).hexdigest()
        if file.exists():
            kept = torch.load(file)
            if kept["rows"] != self.rows:
                raise ValueError(f"{file} is of a run on other rows; give another --run-dir")
            self.model.load_state_dict(kept["model"])
            self.optimizer.load_state_dict(kept["optimizer"])
            self.step, self.seconds, self.curve = kept["step"], kept["seconds"], kept["curve"]

    def learn(self, supervised: int, rewarded: int) -> None:
        """Makes the steps that are left.

        Args:
            supervised: number of steps on right answers.
            rewarded: number of steps by rewards after them.
        """
        if not self.curve:
            self._evaluate("random weights")
        for step in tqdm(range(self.step, supervised + rewarded), self.name):
            phase = "supervised" if step < supervised else "rewards"
            began = time.process_time()
            self._learn(phase)
            self.seconds += time.process_time() - began
            self.step = step + 1
            if self.step % EVALUATE_EVERY == 0 or self.step in (supervised, supervised + rewarded):
                self._evaluate(phase)

    def _learn(self, phase: str) -> None:
        rng = np.random.default_rng(self.step)
        torch.manual_seed(self.step)
        videos = rng.choice(len(self.train.frames), N_VIDEOS, replace=False)
        stride = self.train.frames.shape[1] // N_FRAMES
        at = np.arange(N_FRAMES) * stride + rng.integers(0, stride, (N_VIDEOS, N_FRAMES))
        shown = [tokens[torch.from_numpy(videos)[:, None], torch.from_numpy(at)] for tokens in self.learned_from]
        rows, logits = self._answer(self.train, videos, shown)
        solutions = [self.train.solutions[i] for i in rows]
        if phase == "supervised":
            loss = F.cross_entropy(logits, torch.tensor([self.words.answers.index(text) for text in solutions]))
        else:
            policy = Categorical(logits=logits)
            answers = policy.sample((N_ANSWERS,))
            rewards = torch.tensor(
                [[reward(self.words.answers[i], s) for i, s in zip(row, solutions, strict=True)] for row in answers]
            )
            advantages = (rewards - rewards.mean(0)) / (rewards.std(0) + 1e-4)
            loss = -(advantages * policy.log_prob(answers)).mean()
        self.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        self.optimizer.step()

    def _answer(self, rows: Rows, videos: np.ndarray, shown: Sequence[Tensor]) -> tuple[np.ndarray, Tensor]:
        """All questions about videos, and the logits of answers."""
        numbers = [len(rows.questions[v]) for v in videos]
        which = np.concatenate([rows.questions[v] for v in videos])
        of_video = torch.arange(len(videos)).repeat_interleave(torch.tensor(numbers))
        return which, self.model(*shown, of_video, self.words.encode([rows.texts[i] for i in which]))

    @torch.no_grad()
    def _evaluate(self, phase: str) -> None:
        """Appends the rewards on the test's videos to the curve, and keeps the state."""
        self.model.eval()
        n_videos, stride = len(self.test.frames), self.test.frames.shape[1] // N_FRAMES
        videos = np.arange(n_videos)
        earned = {}
        for name in SHOWN:
            tokens = self.gray if name == "gray frames" else self.seen
            shown = [t[(videos + n_videos // 2) % n_videos if name == "another video" else videos] for t in tokens]
            which, logits = self._answer(self.test, videos, [t[:, stride // 2 :: stride] for t in shown])
            answers = [self.words.answers[i] for i in logits.argmax(1)]
            earned[name] = [reward(text, self.test.solutions[i]) for text, i in zip(answers, which, strict=True)]
        self.model.train()
        self.curve.append({"step": self.step, "seconds": self.seconds, "phase": phase, "earned": earned})
        kept = {"model": self.model.state_dict(), "optimizer": self.optimizer.state_dict(), "rows": self.rows}
        torch.save(kept | {"step": self.step, "seconds": self.seconds, "curve": self.curve}, self.file)


def figure_of(runs: Mapping[str, Run], supervised: int) -> Figure:
    """The rewards of a model that sees and of a blind one, over the steps.

    Args:
        runs: "seeing" and "blind".
        supervised: number of steps on right answers.
    """
    figure = Figure(figsize=(7, 3.4), layout="constrained")
    axis = figure.subplots()
    for name, shown, style in (("seeing", SHOWN[0], "o-"), ("blind", SHOWN[2], "s-"), ("seeing", SHOWN[1], "^:")):
        curve = runs[name].curve
        means = [100 * np.mean(point["earned"][shown]) for point in curve]
        label = f"trained on {'gray frames' if name == 'blind' else 'videos'}, tested on {shown}"
        axis.plot([point["step"] for point in curve], means, style, markersize=3, label=label)
    axis.axvspan(0, supervised, color="0.92")
    for at, text in ((0, " supervised"), (supervised, " rewards alone")):
        axis.text(at, 0.02, text, fontsize=8, transform=axis.get_xaxis_transform())
    axis.set(xlabel="step", ylabel="reward on other videos (%)")
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8, frameon=False)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Trains both models, and writes the table and the curve."""
    parser = parser_of(__doc__)
    parser.add_argument("train", type=Path, help="folder of the export to learn from, with true scenes")
    parser.add_argument("test", type=Path, help="folder of an export of other videos")
    parser.add_argument("--supervised", type=int, default=450, help="steps on right answers")
    parser.add_argument("--rewarded", type=int, default=1350, help="steps by rewards after them")
    parser.add_argument("--run-dir", type=Path, default=Path("runs/learning"), help="keeps the state")
    parser.add_argument("-o", "--output", type=Path, help="the table")
    parser.add_argument("--curve", type=Path, help="the rewards over the steps, a PNG file")
    options = parser.parse_args(arguments)
    options.run_dir.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    torch.manual_seed(0)
    train, test = Rows.read(options.train), Rows.read(options.test)
    tower, kept = Tower(), options.run_dir / "tower.pt"
    if kept.exists():
        tower.load_state_dict(torch.load(kept))
        tower.eval()
    else:
        tower.learn(train)
        torch.save(tower.state_dict(), kept)
    runs = {
        name: Run(tower, train, test, name == "blind", options.run_dir / f"{name}.pt") for name in ("seeing", "blind")
    }
    for run in runs.values():
        run.learn(options.supervised, options.rewarded)
    scenes = [v for v, questions in enumerate(test.questions) for _ in questions]
    lines = []
    for name, run in runs.items():
        for point in run.curve:
            if point["step"] in (0, options.supervised, run.step):
                cells = [percent_right(point["earned"][shown], scenes) for shown in SHOWN]
                lines.append([name, point["step"], point["phase"], f"{point['seconds'] / 60:.1f}", *cells])
    columns = ["model", "steps", "trained by", "minutes of CPU time", *(f"reward (%): {shown}" for shown in SHOWN)]
    size = sum(weights.numel() for part in (tower, runs["seeing"].model) for weights in part.parameters()) / 1e6
    learned, tested = (f"{len(rows.texts)} questions about {len(rows.frames)}" for rows in (train, test))
    numbers = f"{learned} videos to learn from, {tested} others; {size:.2f} M parameters. "
    numbers += f"The tower learned for {tower.seconds / 60:.1f} minutes of CPU time."
    show(f"{numbers}\n\n{table(columns, lines)}\n\n{made_by()}", options.output)
    if options.curve:
        figure_of(runs, options.supervised).savefig(options.curve, dpi=130)


if __name__ == "__main__":
    main()
