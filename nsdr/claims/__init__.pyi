from .verification import Claim as Claim, Verification as Verification
