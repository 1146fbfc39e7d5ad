"""The grammar of claims: rules that relate sentences and lines of tokens, from which `nsdr.claims.reading` makes statements.

The notation is that of `nsdr.language.rules`; where several rules or alternatives say the same, the first is told. In a line,
objects stand before the event that they take part in, "who" makes them those that the statement is about, and "|" ends what is
said of all clauses.
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
SENTENCE: F : SENTENCE => F at | SENTENCE
SENTENCE: F (:|,) NOUN => F at | NOUN
SENTENCE: WORLD , SENTENCE => WORLD | SENTENCE
SENTENCE: WORLD [:] SENTENCE => WORLD | SENTENCE
SENTENCE: F , SENTENCE => F at | SENTENCE
SENTENCE: AT [,|:] SENTENCE => AT | SENTENCE
SENTENCE: AT [,|:] NOUN => AT | NOUN
SENTENCE: CLAUSE [,] WORLD => WORLD | CLAUSE
SENTENCE: START [,] SENTENCE => SENTENCE
START: (so|then|finally|also|therefore|thus|hence|and|but|now|meanwhile|later|here|however|first|firstly) =>
START: (afterwards|as a result|in fact|(in|during) the video) =>
WORLD: after the video => later
WORLD: after the [end of the] video [ends|is over|has ended] => later
WORLD: without OBJ => OBJ without
WORLD: if OBJ (is (removed|absent|gone|taken away)|is not (there|present)) => OBJ without
WORLD: (removing|if (we|you) remove) OBJ => OBJ without
AT: at F => F at
AT: [at] (in|around|about|near|during|approximately) F => F at
AT: (when the video begins|at the (start|beginning) of the video) => first at
AT: (when the video ends|at the end of the video) => last at
BOUND: before F => F before
BOUND: after F => F after

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
PREDICATE: MOTION [AT] => who motion MOTION AT
PREDICATE: IS => who IS

# Events.
CLAUSE: NOUN AT => NOUN AT
CLAUSE: EVENT [(in|during) the video] [AT|BOUND] => EVENT AT BOUND
EVENT: HAPPENS => HAPPENS
EVENT: OBJ and SUBJECT AUXILIARIES COLLIDE => OBJ SUBJECT collision AUXILIARIES
EVENT: SUBJECT DENIAL => SUBJECT DENIAL
EVENT: there is (no|not a) collision (between|of|involving) OBJ and OBJ2 => OBJ OBJ2 collision not
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
DENIAL: is not (hit|struck) by OBJ => OBJ collision not
COMES: (enters|is entering) [PLACE] => in
COMES: (exits|leaves|is (exiting|leaving)) [PLACE] => out
COME: enter [PLACE] => in
COME: (exit|leave) [PLACE] => out
PLACE: [into|from] the (scene|video|view|image) =>
HITS: (hits|collides (with|into)|(bumps|crashes|runs) into) =>
COLLIDE: (collide [with (each other|one another)|together]|hit (each other|one another)|are colliding) =>
AUXILIARY: does not => not
AUXILIARY: never => not
AUXILIARY: would [have] => modal
AUXILIARY: would not [have] => not modal
AUXILIARY: would no longer => not modal
AUXILIARIES: do not => not
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
CLAUSE: E before E2 => E E2 earlier
CLAUSE: E after E2 => E E2 afterwards
CLAUSE: before E , E2 => E2 E earlier
CLAUSE: after E , E2 => E2 E afterwards
CLAUSE: the ORDINAL collision is between OBJ and OBJ2 => OBJ OBJ2 collision ORDINAL
CLAUSE: the ORDINAL collision is [the] [collision] (between|of) OBJ and OBJ2 => OBJ OBJ2 collision ORDINAL
CLAUSE: the ORDINAL N (to|that) PLACED is OBJ => N OBJ who PLACED ORDINAL
ORDINAL: first => nth-first
ORDINAL: second => nth-second
ORDINAL: last => nth-last
PLACED: COME => COME
PLACED: (collide with|HITS) OBJ => OBJ collision
CLAUSE: E LEAD E2 => E E2 cause
CLAUSE: E NOTLEAD E2 => E E2 cause not
CLAUSE: E (BECAUSE|because [of]) E2 => E2 E cause
CLAUSE: E NOTBECAUSE E2 => E2 E cause not
CLAUSE: WHO (is responsible for|LEAD) E => WHO E cause
CLAUSE: WHO (is not responsible for|NOTLEAD) E => WHO E cause not
CLAUSE: E (BECAUSE|because [of]) WHO => WHO E cause
CLAUSE: E NOTBECAUSE WHO => WHO E cause not
WHO: OBJ => OBJ who
WHO: ([the] presence of OBJ|OBJ 's presence) => OBJ who
LEAD: (led to|causes|results in|is responsible for) =>
NOTLEAD: ((did not|never) (lead to|cause|result in)|is not responsible for) =>
BECAUSE: is (caused by|(the|a) result of) =>
NOTBECAUSE: is not (caused by|(the|a) result of) =>

# What things are, and how they move.
CLAUSE: SUBJECT IS => SUBJECT who IS
CLAUSE: SUBJECT MOTION [AT] => SUBJECT who motion MOTION AT
MOTION: is STATE => STATE
MOTION: is not moving => stationary
MOTION: is not stationary => moving
MOTION: moves in the video => ever
MOTION: never moves in the video => never
MOTION: moves => ever
MOTION: (never|does not) move [in the video] => never
MOTIONS: are STATE => STATE
MOTIONS: move in the video => ever
MOTIONS: never move in the video => never
MOTIONS: MOTION => MOTION
STATE: (moving|in motion) => moving
STATE: (stationary|at rest|motionless) => stationary
IS: is [made of] WORDS => WORDS attribute
IS: is not [made of] WORDS => WORDS attribute not
WORDS: (W|A) => W A
WORDS: W [,|[,] and] WORDS => W WORDS
CLAUSE: (the NAME of OBJ|OBJ 's NAME) is (W|OBJ2) => OBJ who W OBJ2 attribute NAME
CLAUSE: (the NAME of OBJ|OBJ 's NAME) is not (W|OBJ2) => OBJ who W OBJ2 attribute NAME not
NAME: color => color
NAME: material => material
NAME: shape => shape

# Numbers.
CLAUSE: there is (A|K) [in the video] => A K who presence
CLAUSE: there are KS [in the video] => KS who presence
CLAUSE: there is not A [in the video] => A who presence not
CLAUSE: K MOTION [AT] => K who count MOTION AT
CLAUSE: KS MOTIONS [AT] => KS who count MOTIONS AT
CLAUSE: K COMES in the video => K who COMES count whole
CLAUSE: KS COME in the video => KS who COME count whole
CLAUSE: K COMES [in the video] [BOUND] => K who COMES count BOUND
CLAUSE: KS COME [in the video] [BOUND] => KS who COME count BOUND
CLAUSE: ONE collision [of OBJ] happens in the video => ONE number OBJ collision count whole
CLAUSE: QS collisions [of OBJ] happen in the video => QS number OBJ collision count whole
CLAUSE: ONE collision [of OBJ] (happens|takes place) [in the video] [BOUND] => ONE number OBJ collision count BOUND
CLAUSE: no collisions [of OBJ] (happen|take place) [in the video] [BOUND] => zero number OBJ collision count BOUND
CLAUSE: QS collisions [of OBJ] (happen|take place) [in the video] [BOUND] => QS number OBJ collision count BOUND
CLAUSE: there is ONE (collision|collisions) [of OBJ] [in the video] [BOUND] => ONE number OBJ collision count BOUND
CLAUSE: there are QS collisions [of OBJ] [in the video] [BOUND] => QS number OBJ collision count BOUND
ONE: no => zero
ONE: Q => Q
""",
    SLOTS,
    NORMAL,
)
"""Its symbol of a sentence is SENTENCE."""
