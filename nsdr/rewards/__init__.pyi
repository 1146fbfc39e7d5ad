from .answers import answer_format as answer_format, exact as exact, per_option as per_option
from .facts import evidence as evidence, read_scene as read_scene
from .frameworks import SWIFT as SWIFT, easyr1 as easyr1, verl as verl, video_r1 as video_r1
from .videos import Lawfulness as Lawfulness, lawfulness as lawfulness, lawfulness_parts as lawfulness_parts
