"""Words of questions, and what stands for them in normal form.

`FORMS` maps single words; `OTHER_WORDS` are words that are no misspelling of a known one. Phrases are in `phrases`.
"""

from nsdr.world.nouns import ADJECTIVES, NOUNS

__all__ = [
    "ADJECTIVES",
    "CLAUSE_STARTS",
    "FORMS",
    "NOUNS",
    "OTHER_WORDS",
    "QUESTION_STARTS",
    "SHORT_CORRECTABLE",
]


_FORMS = """
be: is are was were been am isnt
do: does did done
have: has had having
will: would shall
the: this our teh hte
what: wat waht
which: wich whcih
any: some
enter: enters entered
exit: exits exited
hit: hits strike strikes struck touch touches touched
collide: collides collided
collision: crash impact
collisions: crashes impacts
move: moves moved
happen: happens happened occur occurs occurred
happening: occurring
cause: causes caused
begin: begins began start starts started begun
end: ends ended finish finishes finished stop stops stopped
color: colour colours colors hue
shape: shapes form
material: materials
how: howmany
number: amount quantity
frame: frames
involve: involves involved
include: includes
involving: including
predict: guess
not: never
no: zero
first: 1st
second: 2nd
last: final
often: frequently
stay: stays stayed staying remain remains remained remaining keep keeps
exist: exists existed existing
do not: dont doesnt didnt don doesn didn
will not: wont wouldnt
be not: isnt arent wasnt werent aint
have not: hasnt havent hadnt
before: prior
collection: collections
"""
FORMS = {form: line.split(":")[0] for line in _FORMS.split("\n") if line for form in line.split(":")[1].split()}
"""Word -> its normal form."""

QUESTION_STARTS = frozenset(
    [
        "how",
        "what",
        "which",
        "be",
        "do",
        "why",
        "will",
        "when",
        "count",
        "have",
        "predict",
        "tell",
        "say",
        "name",
        "give",
        "state",
    ]
)
"""Normal forms of words that a question starts with."""
CLAUSE_STARTS = frozenset(
    [
        "when",
        "as",
        "while",
        "once",
        "before",
        "after",
        "until",
        "at",
        "in",
        "by",
        "during",
        "if",
        "without",
        "with",
        "suppose",
        "supposing",
        "imagine",
        "assume",
        "assuming",
        "say",
        "given",
        "have",
        "initially",
        "finally",
        "from",
        "throughout",
        "on",
        "upon",
        "following",
        "prior",
        "since",
        "remove",
        "removing",
        "delete",
        "deleting",
        "because",
    ]
)
"""Normal forms of words that a clause in front of a question starts with."""

SHORT_CORRECTABLE = frozenset(["cube", "ball", "blue", "gray", "grey", "cyan", "many", "what", "when", "move", "does"])
"""Words of four letters that misspelt words may be corrected to."""

OTHER_WORDS = frozenset(
    """
    agent alter bail bails bald bale balk beacon bean bell bells best big bigger bill bills black blacks blocked blown blur
    boring boxer boxing bread bred breed brow bull bulls burst cased cases center centre chan clan class clause clauses
    clock clue code colder collapse collar collate cone cones cooler counts court crown crude crush crushes cue cure cute
    dies docs dots edits emits exciting far fast fever fist fists flock glue grab grad gram gran great greek greens greet
    grep grew grown guest hall halt halving hast head hill hinting holder hull inner inter iron large larger least less list
    lock long lost loving mail major maker mall manor mast meal medal mental meta metals mobile mode modes mold mole moles
    mood more motel mother motor mould mouth mover must mute near newer novel numbers older orange others outer paint petal
    petals pink points predicts presents preset prevent print proving rabbit read remote remoter retain retained retains
    ribbon river road rob robber rubbed rubble ruby saying says season seconds seed seven shade shades shake shaped
    shapeless shaper share shares sharp sheep shell shine ship slow small smaller smart smarts spear speed spheric sphinx
    stabs staged staging stall star stare stared starry stars stating steps stern sting store storm story stove tall test
    than them theme thin thinks three tiger tube tubes tying videos wall wand waste water wheel white world worst yell
    """.split()
)
"""Words that are near to known ones and mean something else; they are not corrected."""
