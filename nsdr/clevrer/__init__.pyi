from .answers.answer_files import (
    Given as Given,
    QuestionKey as QuestionKey,
    read_answers as read_answers,
    read_given as read_given,
    read_submission as read_submission,
    submission_document as submission_document,
    write_responses as write_responses,
    write_submission as write_submission,
)
from .answers.prompts import (
    NO_OPTION as NO_OPTION,
    answer_text as answer_text,
    option_letters as option_letters,
    prompt as prompt,
    solution as solution,
)
from .answers.responses import (
    Response as Response,
    read_response as read_response,
    read_response_to as read_response_to,
)
from .compact_files import write_compact_files as write_compact_files
from .dataset import (
    KINDS as KINDS,
    SPLITS as SPLITS,
    Inventory as Inventory,
    Split as Split,
    file_name as file_name,
    sub_folder as sub_folder,
)
from .download import OFFICIAL_ROOT as OFFICIAL_ROOT, download as download
from .files.annotations import (
    IRREGULAR_VIDEOS as IRREGULAR_VIDEOS,
    check_annotation as check_annotation,
    check_ground_truth as check_ground_truth,
    check_truth as check_truth,
    check_truth_blocks as check_truth_blocks,
    read_annotation as read_annotation,
    read_truth as read_truth,
    read_truth_file as read_truth_file,
    truth_block as truth_block,
    write_annotation as write_annotation,
    write_truth as write_truth,
)
from .files.compact_proposals import compact_rows as compact_rows, read_compact_proposals as read_compact_proposals
from .files.masks import check_mask as check_mask
from .files.predictions import (
    SAMPLE_FRAMES as SAMPLE_FRAMES,
    PredictionFile as PredictionFile,
    predictions_document as predictions_document,
    read_predictions as read_predictions,
    scene_from_predictions as scene_from_predictions,
)
from .files.proposals import (
    find_proposals as find_proposals,
    ground_truth_of as ground_truth_of,
    parse_proposals as parse_proposals,
    proposals_document as proposals_document,
    proposals_from_masks as proposals_from_masks,
    proposals_from_rows as proposals_from_rows,
    read_ground_truth as read_ground_truth,
    read_proposals as read_proposals,
)
from .files.questions import (
    OPTION_TAGS as OPTION_TAGS,
    PAIR_KINDS as PAIR_KINDS,
    PLAIN as PLAIN,
    QUESTION_TYPES as QUESTION_TYPES,
    Choice as Choice,
    Question as Question,
    SceneQuestions as SceneQuestions,
    has_answer as has_answer,
    read_questions as read_questions,
    without_answers as without_answers,
    write_questions as write_questions,
)
from .files.scenes import (
    iterate_scenes as iterate_scenes,
    scene_from_annotation as scene_from_annotation,
    scene_from_ground_truth as scene_from_ground_truth,
    scene_from_truth as scene_from_truth,
)
