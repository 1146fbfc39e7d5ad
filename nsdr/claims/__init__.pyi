from .narration import narrate as narrate
from .verification import Claim as Claim, Verification as Verification, verify as verify
