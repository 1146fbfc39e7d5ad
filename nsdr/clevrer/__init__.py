"""CLEVRER's files: one reader, and a writer where one is needed, for each kind, and the scenes they describe."""

from typing import TYPE_CHECKING

# Function and module have the same name; imported lazily, the name could mean the module.
from nsdr.clevrer.download import OFFICIAL_ROOT, download
from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.clevrer.annotations import (
        IRREGULAR_VIDEOS,
        check_annotation,
        check_ground_truth,
        check_truth,
        read_annotation,
        read_truth_file,
        write_annotation,
    )
    from nsdr.clevrer.answer_files import RESPONSE_KEYS, GivenAnswer, read_answers, read_given, write_responses
    from nsdr.clevrer.compact_files import write_compact_files
    from nsdr.clevrer.dataset import CLEVRER, KINDS, SPLITS, Inventory, Split
    from nsdr.clevrer.masks import check_mask, mask_numbers
    from nsdr.clevrer.parsed_programs import with_parsed_programs
    from nsdr.clevrer.predictions import (
        SAMPLE_FRAMES,
        PredictionFile,
        predictions_document,
        predictions_from_document,
        read_predictions,
        scene_from_predictions,
    )
    from nsdr.clevrer.prompts import NO_OPTION, answer_text, option_letters, prompt, solution
    from nsdr.clevrer.proposals import (
        compact_rows,
        ground_truth_of,
        parse_proposals,
        proposals_document,
        proposals_from_document,
        proposals_from_rows,
        read_compact_proposals,
        read_ground_truth,
        read_proposals,
    )
    from nsdr.clevrer.questions import (
        OPTION_TAGS,
        QUESTION_TYPES,
        Choice,
        Question,
        SceneQuestions,
        by_type,
        iterate_questions,
        read_questions,
        without_answers,
        write_questions,
    )
    from nsdr.clevrer.responses import READ_AS, Response, read_response, read_response_to
    from nsdr.clevrer.scene_files import iterate_scenes
    from nsdr.clevrer.scenes import (
        collisions_in_view,
        enter_exit_events,
        scene_from_annotation,
        scene_from_ground_truth,
        scene_from_truth,
        speed_world_per_s,
    )
    from nsdr.clevrer.submissions import read_submission, submission_document, write_submission
    from nsdr.clevrer.truth_blocks import check_truth_blocks, read_truth, truth_block, write_truth

_HOME = {
    "nsdr.clevrer.annotations": [
        "IRREGULAR_VIDEOS",
        "check_annotation",
        "check_ground_truth",
        "check_truth",
        "read_annotation",
        "read_truth_file",
        "write_annotation",
    ],
    "nsdr.clevrer.answer_files": ["RESPONSE_KEYS", "GivenAnswer", "read_answers", "read_given", "write_responses"],
    "nsdr.clevrer.compact_files": ["write_compact_files"],
    "nsdr.clevrer.dataset": ["CLEVRER", "KINDS", "SPLITS", "Inventory", "Split"],
    "nsdr.clevrer.masks": ["check_mask", "mask_numbers"],
    "nsdr.clevrer.parsed_programs": ["with_parsed_programs"],
    "nsdr.clevrer.predictions": [
        "SAMPLE_FRAMES",
        "PredictionFile",
        "predictions_document",
        "predictions_from_document",
        "read_predictions",
        "scene_from_predictions",
    ],
    "nsdr.clevrer.proposals": [
        "compact_rows",
        "ground_truth_of",
        "parse_proposals",
        "proposals_document",
        "proposals_from_document",
        "proposals_from_rows",
        "read_compact_proposals",
        "read_ground_truth",
        "read_proposals",
    ],
    "nsdr.clevrer.prompts": ["NO_OPTION", "answer_text", "option_letters", "prompt", "solution"],
    "nsdr.clevrer.questions": [
        "OPTION_TAGS",
        "QUESTION_TYPES",
        "Choice",
        "Question",
        "SceneQuestions",
        "by_type",
        "iterate_questions",
        "read_questions",
        "without_answers",
        "write_questions",
    ],
    "nsdr.clevrer.responses": ["READ_AS", "Response", "read_response", "read_response_to"],
    "nsdr.clevrer.scene_files": ["iterate_scenes"],
    "nsdr.clevrer.scenes": [
        "collisions_in_view",
        "enter_exit_events",
        "scene_from_annotation",
        "scene_from_ground_truth",
        "scene_from_truth",
        "speed_world_per_s",
    ],
    "nsdr.clevrer.submissions": ["read_submission", "submission_document", "write_submission"],
    "nsdr.clevrer.truth_blocks": ["check_truth_blocks", "read_truth", "truth_block", "write_truth"],
}

__all__ = [
    "CLEVRER",
    "IRREGULAR_VIDEOS",
    "KINDS",
    "NO_OPTION",
    "OFFICIAL_ROOT",
    "OPTION_TAGS",
    "QUESTION_TYPES",
    "READ_AS",
    "RESPONSE_KEYS",
    "SAMPLE_FRAMES",
    "SPLITS",
    "Choice",
    "GivenAnswer",
    "Inventory",
    "PredictionFile",
    "Question",
    "Response",
    "SceneQuestions",
    "Split",
    "answer_text",
    "by_type",
    "check_annotation",
    "check_ground_truth",
    "check_mask",
    "check_truth",
    "check_truth_blocks",
    "collisions_in_view",
    "compact_rows",
    "download",
    "enter_exit_events",
    "ground_truth_of",
    "iterate_questions",
    "iterate_scenes",
    "mask_numbers",
    "option_letters",
    "parse_proposals",
    "predictions_document",
    "predictions_from_document",
    "prompt",
    "proposals_document",
    "proposals_from_document",
    "proposals_from_rows",
    "read_annotation",
    "read_answers",
    "read_compact_proposals",
    "read_given",
    "read_ground_truth",
    "read_predictions",
    "read_proposals",
    "read_questions",
    "read_response",
    "read_response_to",
    "read_submission",
    "read_truth",
    "read_truth_file",
    "scene_from_annotation",
    "scene_from_ground_truth",
    "scene_from_predictions",
    "scene_from_truth",
    "solution",
    "speed_world_per_s",
    "submission_document",
    "truth_block",
    "with_parsed_programs",
    "without_answers",
    "write_annotation",
    "write_compact_files",
    "write_questions",
    "write_responses",
    "write_submission",
    "write_truth",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)
