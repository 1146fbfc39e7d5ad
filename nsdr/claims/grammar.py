"""The grammar of claims: rules that relate sentences and lines of tokens, from which `nsdr.claims.reading` makes statements.

The notation is that of `nsdr.language.rules`; where several rules or alternatives say the same, the first is told. A line has
fields of the statement ("negated=yes"), in this order: removed, later, frame; number, objects, events; kind, words, attribute,
number of an order, negated, modal; frame and relation. A name alone is the field of the slots before it: events such as "in"
and "who" (`Statement.objects`) take objects, "at" is the frame of the last event. "|" ends what is said of all clauses.
"""

from nsdr.language.normal import FORMS
from nsdr.language.rules import Rules

__all__ = ["GRAMMAR", "NORMAL"]

NORMAL = {
    **FORMS,
    **dict.fromkeys(("bumps", "bumped"), "bump"),
    **dict.fromkeys(("runs", "ran"), "run"),
    **dict.fromkeys(("leads", "led"), "lead"),
    **dict.fromkeys(("results", "resulted"), "result"),
    **dict.fromkeys(("leaves", "left"), "leave"),
    **{"took": "take", "takes": "take", "entry": "entrance", "removed": "remove"},
}
"""Word -> its normal form."""

SLOTS = {
    "OBJ": ("N", "A"),  # the cube, a cube
    "N": ("N",),
    "A": ("A",),
    "K": ("K",),  # no cube, 1 cube
    "KS": ("KS",),  # 2 cubes
    "Q": ("Q",),  # 1, before "collision"
    "QS": ("QS",),
    "F": ("F",),  # frame 12
    "W": ("W",),  # red
}

GRAMMAR = Rules(
    """
# When, or in which course of events.
SENTENCE: CLAUSES => CLAUSES
SENTENCE: F : SENTENCE => F frame | SENTENCE
SENTENCE: F (:|,) NOUN => F frame | NOUN
SENTENCE: WORLD , SENTENCE => WORLD | SENTENCE
SENTENCE: WORLD [:] SENTENCE => WORLD | SENTENCE
SENTENCE: F , SENTENCE => F frame | SENTENCE
SENTENCE: AT [,|:] SENTENCE => AT | SENTENCE
SENTENCE: AT [,|:] NOUN => AT | NOUN
SENTENCE: CLAUSE [,] WORLD => WORLD | CLAUSE
SENTENCE: START [,] SENTENCE => SENTENCE
START: (so|then|finally|also|therefore|thus|hence|and|but|now|meanwhile|later|here|however|first|firstly) =>
START: (afterwards|as a result|in fact|(in|during) the video) =>
WORLD: after the video => later=yes
WORLD: after the [end of the] video [ends|is over|has ended] => later=yes
WORLD: without OBJ => OBJ without
WORLD: if OBJ (is (removed|absent|gone|taken away)|is not (there|present)) => OBJ without
WORLD: (removing|if (we|you) remove) OBJ => OBJ without
AT: at F => F at
AT: [at] (in|around|about|near|during|approximately) F => F at
AT: (when the video begins|at the (start|beginning) of the video) => first at
AT: (when the video ends|at the end of the video) => last at
BOUND: before F => F frame relation=before
BOUND: after F => F frame relation=after

# Clauses in a row, of which a later one may leave out the subject of the first.
CLAUSES: CLAUSE => CLAUSE
CLAUSES: CLAUSE AND CLAUSES => CLAUSE ; CLAUSES
CLAUSES: SUBJECT PREDICATE AND REST => SUBJECT PREDICATE ; same REST
CLAUSES: START [,] CLAUSES => CLAUSES
REST: PREDICATE => PREDICATE
REST: PREDICATE AND REST => PREDICATE ; same REST
REST: PREDICATE AND CLAUSES => PREDICATE ; CLAUSES
REST: START [,] REST => REST
AND: (,|;|[,] and [then]|, then|, but|, while) =>
PREDICATE: (ACTION|DENIAL) [in the video] [AT|BOUND] => ACTION DENIAL AT BOUND
PREDICATE: MOTION [AT] => who kind=motion MOTION AT
PREDICATE: IS => who IS

# Events.
CLAUSE: NOUN AT => NOUN AT
CLAUSE: EVENT [(in|during) the video] [AT|BOUND] => EVENT AT BOUND
EVENT: HAPPENS => HAPPENS
EVENT: OBJ and SUBJECT AUXILIARIES COLLIDE => OBJ SUBJECT collision AUXILIARIES
EVENT: SUBJECT DENIAL => SUBJECT DENIAL
EVENT: there is (no|not a) collision (between|of|involving) OBJ and OBJ2 => OBJ OBJ2 collision negated=yes
EVENT: NOUN [AT] AUXILIARY (happen|take place) => NOUN AT AUXILIARY
HAPPENS: OBJ and SUBJECT COLLIDE => OBJ SUBJECT collision
HAPPENS: SUBJECT ACTION => SUBJECT ACTION
HAPPENS: there is a collision (between|of|involving) OBJ and OBJ2 => OBJ OBJ2 collision
HAPPENS: NOUN [AT] (happens|takes place) => NOUN AT
SUBJECT: OBJ [then|also|finally|eventually|subsequently] => OBJ
ACTION: COMES => COMES
ACTION: (HITS|is (hitting|(hit|struck) by|colliding (with|into))) OBJ => OBJ collision
DENIAL: AUXILIARY COME => COME AUXILIARY
DENIAL: AUXILIARY (HITS|be (hit|struck) by) OBJ => OBJ collision AUXILIARY
DENIAL: is not (hit|struck) by OBJ => OBJ collision negated=yes
COMES: (enters|is entering) [PLACE] => in
COMES: (exits|leaves|is (exiting|leaving)) [PLACE] => out
COME: enter [PLACE] => in
COME: (exit|leave) [PLACE] => out
PLACE: [into|from] the (scene|video|view|image) =>
HITS: (hits|collides (with|into)|(bumps|crashes|runs) into) =>
COLLIDE: (collide [with (each other|one another)|together]|hit (each other|one another)|are colliding) =>
AUXILIARY: does not => negated=yes
AUXILIARY: never => negated=yes
AUXILIARY: would [have] => modal=yes
AUXILIARY: would not [have] => negated=yes modal=yes
AUXILIARY: would no longer => negated=yes modal=yes
AUXILIARIES: do not => negated=yes
AUXILIARIES: AUXILIARY => AUXILIARY
NOUN: the collision of OBJ and OBJ2 => OBJ OBJ2 collision
NOUN: [the|a] collision (between|of|involving) OBJ (and|with) OBJ2 => OBJ OBJ2 collision
NOUN: OBJ 's collision with OBJ2 => OBJ OBJ2 collision
NOUN: the entrance of OBJ => OBJ in
NOUN: the exit of OBJ => OBJ out
NOUN: (entrance of OBJ|OBJ 's entrance) => OBJ in
NOUN: (exit of OBJ|OBJ 's exit) => OBJ out

# Order and causes.
E: NOUN [AT] [is] => NOUN AT
E: HAPPENS [AT] => HAPPENS AT
CLAUSE: E before E2 => E E2 kind=order relation=before
CLAUSE: E after E2 => E E2 kind=order relation=after
CLAUSE: before E , E2 => E2 E kind=order relation=before
CLAUSE: after E , E2 => E2 E kind=order relation=after
CLAUSE: the ORDINAL collision is between OBJ and OBJ2 => OBJ OBJ2 collision kind=order ORDINAL
CLAUSE: the ORDINAL collision is [the] [collision] (between|of) OBJ and OBJ2 => OBJ OBJ2 collision kind=order ORDINAL
CLAUSE: the ORDINAL N (to|that) PLACED is OBJ => N OBJ who PLACED kind=order ORDINAL
ORDINAL: first => number=1
ORDINAL: second => number=2
ORDINAL: last => number=-1
PLACED: COME => COME
PLACED: (collide with|HITS) OBJ => OBJ collision
CLAUSE: E LEAD E2 => E E2 kind=cause
CLAUSE: E NOTLEAD E2 => E E2 kind=cause negated=yes
CLAUSE: E (BECAUSE|because [of]) E2 => E2 E kind=cause
CLAUSE: E NOTBECAUSE E2 => E2 E kind=cause negated=yes
CLAUSE: WHO (is responsible for|LEAD) E => WHO E kind=cause
CLAUSE: WHO (is not responsible for|NOTLEAD) E => WHO E kind=cause negated=yes
CLAUSE: E (BECAUSE|because [of]) WHO => WHO E kind=cause
CLAUSE: E NOTBECAUSE WHO => WHO E kind=cause negated=yes
WHO: OBJ => OBJ who
WHO: ([the] presence of OBJ|OBJ 's presence) => OBJ who
LEAD: (led to|causes|results in|is responsible for) =>
NOTLEAD: ((did not|never) (lead to|cause|result in)|is not responsible for) =>
BECAUSE: is (caused by|(the|a) result of) =>
NOTBECAUSE: is not (caused by|(the|a) result of) =>

# What things are, and how they move.
CLAUSE: SUBJECT IS => SUBJECT who IS
CLAUSE: SUBJECT MOTION [AT] => SUBJECT who kind=motion MOTION AT
MOTION: is STATE => STATE
MOTION: is not moving => words=stationary
MOTION: is not stationary => words=moving
MOTION: moves in the video => words=ever-moving
MOTION: never moves in the video => words=never-moving
MOTION: moves => words=ever-moving
MOTION: (never|does not) move [in the video] => words=never-moving
MOTIONS: are STATE => STATE
MOTIONS: move in the video => words=ever-moving
MOTIONS: never move in the video => words=never-moving
MOTIONS: MOTION => MOTION
STATE: (moving|in motion) => words=moving
STATE: (stationary|at rest|motionless) => words=stationary
IS: is [made of] WORDS => WORDS words kind=attribute
IS: is not [made of] WORDS => WORDS words kind=attribute negated=yes
WORDS: (W|A) => W A
WORDS: W [,|[,] and] WORDS => W WORDS
CLAUSE: (the NAME of OBJ|OBJ 's NAME) is (W|OBJ2) => OBJ who W OBJ2 words kind=attribute NAME
CLAUSE: (the NAME of OBJ|OBJ 's NAME) is not (W|OBJ2) => OBJ who W OBJ2 words kind=attribute NAME negated=yes
NAME: color => attribute=color
NAME: material => attribute=material
NAME: shape => attribute=shape

# Numbers.
CLAUSE: there is (A|K) [in the video] => A K who kind=presence
CLAUSE: there are KS [in the video] => KS who kind=presence
CLAUSE: there is not A [in the video] => A who kind=presence negated=yes
CLAUSE: K MOTION [AT] => K who kind=count MOTION AT
CLAUSE: KS MOTIONS [AT] => KS who kind=count MOTIONS AT
CLAUSE: K COMES in the video => K who COMES kind=count relation=
CLAUSE: KS COME in the video => KS who COME kind=count relation=
CLAUSE: K COMES [in the video] [BOUND] => K who COMES kind=count BOUND
CLAUSE: KS COME [in the video] [BOUND] => KS who COME kind=count BOUND
CLAUSE: ONE collision [of OBJ] happens in the video => ONE OBJ collision kind=count relation=
CLAUSE: QS collisions [of OBJ] happen in the video => QS number OBJ collision kind=count relation=
CLAUSE: ONE collision [of OBJ] (happens|takes place) [in the video] [BOUND] => ONE OBJ collision kind=count BOUND
CLAUSE: no collisions [of OBJ] (happen|take place) [in the video] [BOUND] => number=0 OBJ collision kind=count BOUND
CLAUSE: QS collisions [of OBJ] (happen|take place) [in the video] [BOUND] => QS number OBJ collision kind=count BOUND
CLAUSE: there is ONE (collision|collisions) [of OBJ] [in the video] [BOUND] => ONE OBJ collision kind=count BOUND
CLAUSE: there are QS collisions [of OBJ] [in the video] [BOUND] => QS number OBJ collision kind=count BOUND
ONE: no => number=0
ONE: Q => Q number
""",
    SLOTS,
    NORMAL,
)
"""Its symbol of a sentence is SENTENCE."""
