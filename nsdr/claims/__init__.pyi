from .narration import narrate as narrate
from .pairs import MinimalPair as MinimalPair, minimal_pairs as minimal_pairs
from .verification import Claim as Claim, Verification as Verification, verify as verify
