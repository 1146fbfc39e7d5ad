"""Frameworks of reinforcement learning with tiny models of random weights (extra `rl`; `docs/rewards.md`)."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks.seeing import FAMILIES, FRAMEWORKS, changes, exports
from nsdr import Scene, load, save
from nsdr.clevrer import prompt, read_questions, solution
from nsdr.clevrer.example import QUESTIONS, TRUTH
from nsdr.rewards import SWIFT, answer_format, evidence, exact, per_option

pytestmark = [pytest.mark.rl, pytest.mark.filterwarnings("ignore")]

REWARDS = [exact, per_option, answer_format, evidence]


TEXTS = [
    "Frame 17: the brown cylinder and the cyan sphere collide.\n",
    "Frame 25: the purple cube exits.\n",
    "<answer>A</answer>",
    "<answer>yes</answer>",
    "<answer>2</answer>",
]
"""Tokens of the tiny model: whole sentences, so that random weights write texts that get rewards."""


def tiny_model_and_tokenizer():
    """A GPT-2 of two small layers with random weights, and its tokenizer."""
    from tokenizers import Tokenizer, models
    from transformers import GPT2Config, GPT2LMHeadModel, PreTrainedTokenizerFast, set_seed

    set_seed(0)
    vocabulary = {token: i for i, token in enumerate(["<pad>", "<eos>", "<unk>", *TEXTS])}
    whole = Tokenizer(models.WordLevel(vocabulary, unk_token="<unk>"))
    tokenizer = PreTrainedTokenizerFast(tokenizer_object=whole, pad_token="<pad>", eos_token="<eos>", unk_token="<unk>")
    size = {"n_embd": 16, "n_layer": 2, "n_head": 2, "n_positions": 64, "vocab_size": len(vocabulary)}
    config = GPT2Config(**size, bos_token_id=1, eos_token_id=1, pad_token_id=0)
    return GPT2LMHeadModel(config), tokenizer


def needs(module: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(find_spec(module) is None, reason=f"{module} has an environment of its own")


MODULES = {"trl": "trl", "verl": "verl", "ms-swift": "swift"}
"""What the packages of `FRAMEWORKS` are imported as."""


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("name", [pytest.param(n, marks=needs(MODULES[f[0]])) for n, f in FRAMEWORKS.items()])
def test_the_loss_sees_the_video(name: str, family: str) -> None:
    found = changes(name, family)
    assert found["again"] == 0
    assert (min(found["blanked"], found["exchanged"]) > 1e-3) == (not name.endswith("blind"))


@needs("verl")
def test_verl_finds_and_calls_the_reward(tmp_path: Path) -> None:
    from datasets import load_dataset
    from verl.utils.import_utils import load_extern_object

    path = exports(tmp_path, "verl")["video"] / "train.parquet"
    row = load_dataset("parquet", data_files=str(path), cache_dir=str(tmp_path / "cache"))["train"][0]
    compute_score = load_extern_object("pkg://nsdr.rewards", "verl")
    truth = {"ground_truth": row["reward_model"]["ground_truth"], "extra_info": row["extra_info"]}
    for text, score in (("<think>?</think><answer>red</answer>", 1), ("<answer>blue</answer>", 0)):
        assert compute_score(data_source=row["data_source"], solution_str=text, **truth)["score"] == score


@needs("swift")
def test_swift_registers_and_calls_the_reward(tmp_path: Path) -> None:
    from swift.dataset import load_dataset
    from swift.rewards import orms

    orms.update(SWIFT)
    rows, _ = load_dataset(
        [str(exports(tmp_path, "swift")["video"] / "train.jsonl")],
        load_from_cache_file=False,
        remove_unused_columns=False,
    )
    columns = {name: [rows[0][name]] for name in ("solution", "options")}
    assert orms["clevrer_exact"](args=None)(["<answer>red</answer>"], **columns) == [1]


@needs("trl")
@pytest.mark.parametrize("conversational", [False, True])
def test_three_steps_with_all_rewards(tmp_path: Path, conversational: bool) -> None:
    from datasets import Dataset
    from trl import GRPOConfig, GRPOTrainer

    save(tmp_path / "scene.json", load(TRUTH, Scene))
    (scene,) = read_questions(QUESTIONS)
    rows = []
    for q in scene.questions:
        text = prompt(q)
        asked = [{"role": "user", "content": text}] if conversational else text
        options = [c.text for c in q.choices]
        programs = {"program": q.program, "option_programs": [c.program for c in q.choices]}
        scene_file = str(tmp_path / "scene.json")
        rows.append({"prompt": asked, "solution": solution(q), "options": options, "scene": scene_file, **programs})
    model, tokenizer = tiny_model_and_tokenizer()
    if conversational:
        tokenizer.chat_template = "{% for m in messages %}{{ m.content }}\n{% endfor %}"
    before = {name: weights.clone() for name, weights in model.named_parameters()}
    config = GRPOConfig(
        str(tmp_path / "run"),
        max_steps=3,
        per_device_train_batch_size=16,
        num_generations=8,
        max_completion_length=8,
        learning_rate=0.01,
        logging_steps=1,
        report_to=[],
        use_cpu=True,
        bf16=False,
        save_strategy="no",
        disable_tqdm=True,
        seed=0,
    )
    trainer = GRPOTrainer(model, REWARDS, config, train_dataset=Dataset.from_list(rows), processing_class=tokenizer)
    trainer.train()
    logged = [row for row in trainer.state.log_history if "reward" in row]
    assert len(logged) == 3
    for reward in REWARDS:
        means = [row[f"rewards/{reward.__name__}/mean"] for row in logged]
        assert 0 < max(means) <= 1, reward.__name__
    assert any((weights != before[name]).any() for name, weights in model.named_parameters())
