from .localization import ground_location as ground_location, outline as outline
from .masks import tracks_from_masks as tracks_from_masks
from .tracker import TrackerConfig as TrackerConfig, tracks_from_annotation as tracks_from_annotation
from .visibility import cut_sides as cut_sides, hidden_sides as hidden_sides, in_image as in_image

VERSION: int
