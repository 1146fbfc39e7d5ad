"""Whether a video-language model that is trained on an export sees the video.

    python -m benchmarks.seeing trl-grpo trl-sft -o results/seeing_trl.json

A data set of one video is exported as it is, with the video blanked, and with the video exchanged for another. From each
export, the framework's own code makes one training step's input for a tiny model with random weights. It sees the video if
the log-probabilities from which the loss is computed change with the video, and not without it.

Needs the framework (for TRL, the extra `rl`), in an environment of its own. verl and ms-swift decode videos by qwen-vl-utils:
install decord, and set `FORCE_QWENVL_VIDEO_READER=decord`.
"""

import argparse
import json
import os
from collections.abc import Callable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from nsdr.clevrer import SceneQuestions
from nsdr.clevrer.files.questions import Question, write_questions
from nsdr.generate.export import ExportConfig, export_dataset
from nsdr.io.files import write_json
from nsdr.io.video import write_video

SPECIAL = {
    "<|endoftext|>": 151643, "<|im_start|>": 151644, "<|im_end|>": 151645, "<|vision_start|>": 151652,
    "<|vision_end|>": 151653, "<|image_pad|>": 151655, "<|video_pad|>": 151656,
}  # fmt: skip
"""Tokens of Qwen's chats, and their ids, which ms-swift takes for granted."""
TEMPLATE = """{% for message in messages %}<|im_start|>{{ message['role'] }}
{% if message['content'] is string %}{{ message['content'] }}{% else %}{% for part in message['content'] %}\
{% if part['type'] == 'image' %}<|vision_start|><|image_pad|><|vision_end|>\
{% elif part['type'] == 'video' %}<|vision_start|><|video_pad|><|vision_end|>\
{% else %}{{ part['text'] }}{% endif %}{% endfor %}{% endif %}<|im_end|>
{% endfor %}{% if add_generation_prompt %}<|im_start|>assistant
{% endif %}"""
FAMILIES = ("qwen2_5_vl", "qwen3_vl")
WIDTH, HEIGHT, N_FRAMES = 112, 84, 8
"""Size (pixels) and number of frames of the videos."""
ANSWER = "red"
N_COMPLETION = 3
"""Positions at the end of a sequence whose log-probabilities are compared; the answer has more tokens."""


def tiny_model(family: str, qwen_ids: bool = False) -> tuple[Any, Any]:
    """A model of a family with random weights, two layers of language and two of vision, and its processor.

    Args:
        family: one of `FAMILIES`.
        qwen_ids: give special tokens Qwen's own ids, which takes a large vocabulary, and so time; else small ones.
    """
    import transformers as t
    from tokenizers import Tokenizer, decoders, models, pre_tokenizers

    letters = sorted(pre_tokenizers.ByteLevel.alphabet())
    special = SPECIAL if qwen_ids else {token: len(letters) + i for i, token in enumerate(SPECIAL)}
    vocabulary = {token: i for i, token in enumerate(letters)} | special
    bytes_alone = Tokenizer(models.BPE(vocabulary, []))
    bytes_alone.pre_tokenizer, bytes_alone.decoder = pre_tokenizers.ByteLevel(False), decoders.ByteLevel()
    names = {"pad_token": "<|endoftext|>", "eos_token": "<|im_end|>", "extra_special_tokens": list(SPECIAL)}
    tokenizer = t.PreTrainedTokenizerFast(tokenizer_object=bytes_alone, **names)
    ids = {f"{name}_token_id": vocabulary[f"<|{name}_pad|>"] for name in ("image", "video")}
    ids |= {f"vision_{name}_token_id": vocabulary[f"<|vision_{name}|>"] for name in ("start", "end")}
    text = {
        "vocab_size": max(vocabulary.values()) + 1, "hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2,
        "num_attention_heads": 4, "num_key_value_heads": 2, "max_position_embeddings": 4096,
        "pad_token_id": special["<|endoftext|>"], "eos_token_id": special["<|im_end|>"],
    }  # fmt: skip
    vision = {"depth": 2, "hidden_size": 32, "intermediate_size": 64, "num_heads": 4, "out_hidden_size": 32}
    size = {"shortest_edge": 28 * 28, "longest_edge": 128 * 128}
    torch.manual_seed(0)
    if family == "qwen2_5_vl":
        text |= {"rope_parameters": {"rope_type": "default", "mrope_section": [1, 1, 2], "rope_theta": 1e4}}
        vision |= {"fullatt_block_indexes": [1], "window_size": 112}
        config: Any = t.Qwen2_5_VLConfig(text_config=text, vision_config=vision, **ids, tie_word_embeddings=False)
        model: Any = t.Qwen2_5_VLForConditionalGeneration(config)
        images, videos, made = (
            t.Qwen2VLImageProcessor(size=size),
            t.Qwen2VLVideoProcessor(size=size),
            t.Qwen2_5_VLProcessor,
        )
    else:
        text |= {
            "head_dim": 8,
            "rope_parameters": {"rope_type": "default", "mrope_section": [2, 1, 1], "rope_theta": 1e4},
        }
        vision |= {"deepstack_visual_indexes": [0], "num_position_embeddings": 64}
        config = t.Qwen3VLConfig(text_config=text, vision_config=vision, **ids, tie_word_embeddings=False)
        model = t.Qwen3VLForConditionalGeneration(config)
        size = {"shortest_edge": 32 * 32, "longest_edge": 8 * 128 * 128}
        images = t.Qwen2VLImageProcessor(size=size, patch_size=16)
        videos, made = t.Qwen3VLVideoProcessor(size=size), t.Qwen3VLProcessor
    processor = made(image_processor=images, tokenizer=tokenizer, video_processor=videos, chat_template=TEMPLATE)
    return model, processor


def exports(folder: Path, name: str) -> dict[str, Path]:
    """Exports of one question about one video: "video", "again" (the same), "blanked" and "exchanged"."""
    rng = np.random.default_rng(0)
    first, second = (
        rng.integers(0, 255, (2, N_FRAMES, HEIGHT // 12, WIDTH // 16, 3), np.uint8).repeat(12, 2).repeat(16, 3)
    )
    shown = {"video": first, "again": first, "blanked": np.full_like(first, 128), "exchanged": second}
    question = Question(0, "What color is the cube?", "descriptive", "query_color", None, ANSWER)
    for key, frames in shown.items():
        root = folder / f"{key}_data"
        write_questions(root / "questions" / "train.json", [SceneQuestions(0, "video_00000.mp4", (question,))])
        video = root / "videos" / "train" / "video_00000-01000" / "video_00000.mp4"
        video.parent.mkdir(parents=True, exist_ok=True)
        write_video(video, frames)
        frames_of = {"frames": 4, "frame_width": WIDTH} if name == "trl" else {}
        prefix = f"{(folder / key).resolve()}/"
        export_dataset(ExportConfig(str(root), str(folder / key), name, prefix=prefix, **frames_of))
    return {key: folder / key for key in shown}


class Watched:
    """Records the log-probabilities of the last positions in each forward pass with gradients.

    Args:
        model: the model, whose passes outside of this context are not recorded.
    """

    def __init__(self, model: Any) -> None:
        self.model = model
        self.recorded: list[NDArray[np.float32]] = []

    def __enter__(self) -> list[NDArray[np.float32]]:
        def record(_: Any, __: Any, output: Any) -> None:
            if torch.is_grad_enabled():
                if (
                    given := getattr(output, "log_probs", None)
                ) is None:  # TRL's models compute those of the labels alone
                    given = torch.log_softmax(output.logits[:, :-1].float(), -1)
                self.recorded.append(given[:, -N_COMPLETION:].detach().numpy())

        self.hook = self.model.register_forward_hook(record)
        return self.recorded

    def __exit__(self, *_: object) -> None:
        self.hook.remove()


def _rows_of_trl(folder: Path) -> Any:
    from datasets import Image, List, load_dataset

    rows = load_dataset("json", data_files=str(folder / "train.jsonl"), cache_dir=str(folder / "cache"))["train"]
    return rows.cast_column("images", List(Image()))


QUIET: dict[str, Any] = {
    "max_steps": 1, "use_cpu": True, "bf16": False, "report_to": [], "save_strategy": "no", "disable_tqdm": True, "seed": 0,
    "gradient_checkpointing": False, "logging_strategy": "no",
}  # fmt: skip


def trl_grpo(folder: Path, family: str, blind: bool = False) -> NDArray[np.float32]:
    """A step of TRL's `GRPOTrainer`, whose model generates the same completions for each video.

    Args:
        folder: the export.
        family: the model's family.
        blind: leave out the column of the frames, for a test of this test.
    """
    from trl import GRPOConfig, GRPOTrainer

    from nsdr.rewards import exact

    model, processor = tiny_model(family)
    said = torch.tensor(processor.tokenizer(f"<answer>{ANSWER}</answer><|im_end|>")["input_ids"])

    def generate(input_ids: torch.Tensor, **_: Any) -> torch.Tensor:
        other = said.clone()
        other[0] += 1  # so that two completions earn different rewards
        return torch.cat([input_ids, torch.stack([said, other] * (len(input_ids) // 2))], dim=1)

    model.generate = generate
    sizes = {"per_device_train_batch_size": 2, "num_generations": 2, "max_completion_length": len(said)}
    config = GRPOConfig(str(folder / "run"), **QUIET, **sizes)
    rows = _rows_of_trl(folder)
    rows = rows.remove_columns("images") if blind else rows
    trainer = GRPOTrainer(model, [exact], config, train_dataset=rows, processing_class=processor)
    with Watched(model) as recorded:
        trainer.train()
    return recorded[-1]


def trl_sft(folder: Path, family: str) -> NDArray[np.float32]:
    """A step of TRL's `SFTTrainer`."""
    from trl import SFTConfig, SFTTrainer

    model, processor = tiny_model(family)
    config = SFTConfig(str(folder / "run"), **QUIET, per_device_train_batch_size=1, max_length=None)
    trainer = SFTTrainer(model, config, train_dataset=_rows_of_trl(folder), processing_class=processor)
    with Watched(model) as recorded:
        trainer.train()
    return recorded[-1]


def verl(folder: Path, family: str) -> NDArray[np.float32]:
    """A row of verl's `RLHFDataset`, prepared as in its agent loop; the model's own forward pass stands for verl's actor."""
    from omegaconf import OmegaConf
    from verl.utils.dataset.rl_dataset import RLHFDataset
    from verl.utils.tokenizer.tokenizer import build_multimodal_processor_inputs

    model, processor = tiny_model(family)
    config = OmegaConf.create({"cache_dir": str(folder / "cache"), "filter_overlong_prompts": False})
    data = RLHFDataset(str(folder / "train.parquet"), processor.tokenizer, config, processor)
    messages = data[0]["raw_prompt"]
    images, videos, audios = data._process_multi_modal_info(messages, data.image_patch_size, config)
    text = processor.apply_chat_template(messages, add_generation_prompt=True, tokenize=False)
    text += f"{data[0]['reward_model']['ground_truth']}<|im_end|>"
    inputs = build_multimodal_processor_inputs(processor, text=[text], images=images, videos=videos, audio=audios)
    with Watched(model) as recorded:
        model(**inputs)
    return recorded[-1]


def swift(folder: Path, family: str) -> NDArray[np.float32]:
    """A row of ms-swift's `load_dataset` by its template and collator for training, as its trainers give it to the model."""
    from swift import get_model_processor, get_template
    from swift.dataset import load_dataset

    for part in tiny_model(family, qwen_ids=True):
        part.save_pretrained(folder / "model")
    kind = {"model_type": family, "torch_dtype": torch.float32, "device_map": "cpu", "attn_impl": "sdpa"}
    model, processor = get_model_processor(str(folder / "model"), **kind)
    template = get_template(processor, template_type=family)
    template.set_mode("train")
    template.model = model
    rows, _ = load_dataset([str(folder / "train.jsonl")], load_from_cache_file=False)
    inputs = template.data_collator([template.encode(dict(rows[0]))])
    template.register_post_encode_hook([model])
    with Watched(model) as recorded:
        model(**{name: value for name, value in inputs.items() if name != "labels"})
    return recorded[-1]


FRAMEWORKS: dict[str, tuple[str, str, Callable[[Path, str], NDArray[np.float32]]]] = {
    "trl-grpo": ("trl", "trl", trl_grpo),
    "trl-grpo-blind": ("trl", "trl", partial(trl_grpo, blind=True)),
    "trl-sft": ("trl", "trl", trl_sft),
    "verl": ("verl", "verl", verl),
    "swift": ("ms-swift", "swift", swift),
}
"""By name the package, the export's format and what makes a step."""


def changes(name: str, family: str) -> dict[str, float]:
    """The largest change of a log-probability of the completion, when the video is the same, blanked or exchanged.

    Args:
        name: one of `FRAMEWORKS`.
        family: one of `FAMILIES`.
    """
    _, form, step = FRAMEWORKS[name]
    with TemporaryDirectory() as temporary:
        found = {key: step(path, family) for key, path in exports(Path(temporary), form).items()}
    return {key: float(np.abs(found[key] - found["video"]).max()) for key in ("again", "blanked", "exchanged")}


def main(arguments: Sequence[str] | None = None) -> None:
    """Write for each framework and family the changes and the versions."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frameworks", nargs="+", choices=FRAMEWORKS)
    parser.add_argument("-o", "--output", required=True)
    options = parser.parse_args(arguments)
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    rows = []
    for name in options.frameworks:
        versions = {package: version(package) for package in (FRAMEWORKS[name][0], "transformers", "torch")}
        for family in FAMILIES:
            rows.append({"framework": name, "family": family, **changes(name, family), "versions": versions})
            print(json.dumps(rows[-1]), flush=True)
    write_json(options.output, rows, indent=1)


if __name__ == "__main__":
    main()
