"""What people ask, in normal form (`nsdr.question_parser.normal`), with the program of each text: see `Rules` for the notation.

The start symbols are DESCRIPTIVE, MULTIPLE and CHOICE. A text that is none of them is refused, so a rule must only be added where
the program says all that the text says.
"""

from nsdr.language.rules import Rules

__all__ = ["ENGLISH", "ENGLISH_RULES", "START_SYMBOLS"]

START_SYMBOLS = {"descriptive": "DESCRIPTIVE", "multiple_choice": "MULTIPLE", "choice": "CHOICE"}
"""The symbol of each kind of text."""

ENGLISH_RULES = """
# A single object, classes of objects, orders, entrances and exits, motion.
ONE: [the] N => objects N unique
CLASS: NS => NS
CLASS: N => N
ORDER: first => first filter_order
ORDER: second => second filter_order
ORDER: last => last filter_order
INOUT: enter => filter_in
INOUT: exit => filter_out
INOUTING: entering => filter_in
INOUTING: exiting => filter_out
INOUTNOUN: (entrance|entering) => filter_in
INOUTNOUN: (exit|exiting) => filter_out
INPOST: INOUTING => INOUTING
INPOST: (that|to) INOUT => INOUT
INPOST: that be INOUTING => INOUTING
INPRED: INOUT => INOUT
INPRED: be INOUTING => INOUTING
MOTION: moving => filter_moving
MOTION: stationary => filter_stationary
MOTPOST: MOTION => MOTION
MOTPOST: that MOTPRED => MOTPRED
MOTPRED: be MOTION => MOTION
MOTPRED: move => filter_moving
MOTPRED: stay stationary => filter_stationary
MOTPRED: be not stationary => filter_moving
MOTPRED: be not moving => filter_stationary
MOTBASE: move => filter_moving
MOTBASE: (stay stationary|not move) => filter_stationary

# Events as clauses and as nouns; one event each.
CLAUSE: ONE INOUT => events ONE INOUT unique
CLAUSE: ONE be INOUTING => events ONE INOUTING unique
CLAUSE: ONE1 (hit|be hit by|be hitting) ONE2 => events ONE1 filter_collision ONE2 filter_collision unique
CLAUSE: ONE1 and ONE2 (collide|be colliding) => events ONE1 filter_collision ONE2 filter_collision unique
CLAUSE: [the] ORDER collision [happen] => events objects filter_collision ORDER
CLAUSE: [the] ORDER entrance => events objects filter_in ORDER
CLAUSE: [the] ORDER exit => events objects filter_out ORDER
CLAUSE: [the] ORDER CLASS INPRED => events objects CLASS INPRED ORDER
CLAUSE: NOUN [happen] => NOUN
NOUN: PAIRNOUN => PAIRNOUN
NOUN: [the] INOUTNOUN of ONE => events ONE INOUTNOUN unique
NOUN: ONE 's INOUTNOUN => events ONE INOUTNOUN unique
NOUN: ONE INOUTING => events ONE INOUTING unique
PAIRNOUN: PAIR => events PAIR unique
PAIR: [the|a] collision (between|of|involving|with) ONE1 (and|with) ONE2 => ONE1 filter_collision ONE2 filter_collision
PAIR: ONE1 (and|with) ONE2 's collision => ONE1 filter_collision ONE2 filter_collision
PAIR: ONE1 's (collision with|hitting) ONE2 => ONE1 filter_collision ONE2 filter_collision
PAIR: ONE1 (hitting|hit by) ONE2 => ONE1 filter_collision ONE2 filter_collision
PAIR: ONE1 and ONE2 colliding => ONE1 filter_collision ONE2 filter_collision

# When: a frame for motion, a side of an event for events.
TIME: => null
TIME: when video begin => start get_frame
TIME: when video end => end get_frame
TIME: when CLAUSE => CLAUSE get_frame
SIDE: (before|until) => filter_before
SIDE: (after|once) => filter_after
WHEN: => events
WHEN: SIDE CLAUSE => events CLAUSE SIDE

# Sets of objects or events that are counted, or asked whether they are empty.
SET: CLASS => objects CLASS
SET: MOTION CLASS TIME => objects CLASS TIME MOTION
SET: CLASS MOTPOST TIME => objects CLASS TIME MOTPOST
SET: CLASS INPOST WHEN => WHEN objects CLASS INPOST
SET: CLASS INPOST SIDE ONE [do] => events events ONE INPOST unique SIDE objects CLASS INPOST
SET: EVENTS WHEN => WHEN EVENTS
EVENTS: COLLISIONS [happening|that happen|to happen] => objects filter_collision
EVENTS: COLLISIONS (involving|with|of) ONE => ONE filter_collision
EVENTS: COLLISIONS that involve ONE => ONE filter_collision
EVENTS: COLLISIONS (between|of|involving) ONE1 (and|with) ONE2 => ONE1 filter_collision ONE2 filter_collision
EVENTS: ONE1 hitting ONE2 => ONE1 filter_collision ONE2 filter_collision
COLLISIONS: (collision|collisions) [between OBJS|of OBJS] =>
SUBJECT: CLASS MOTPRED TIME => objects CLASS TIME MOTPRED
SUBJECT: CLASS INPRED WHEN => WHEN objects CLASS INPRED
SUBJECT: CLASS INPRED SIDE ONE [do] => events events ONE INPRED unique SIDE objects CLASS INPRED
SUBJECT: COLLISIONS (happen|be happening) WHEN => WHEN objects filter_collision

COUNT: how many CLASS be there => objects CLASS count
COUNT: how many CLASS be A [there] => objects CLASS&A count
COUNT: how many MOTION CLASS be there TIME => objects CLASS TIME MOTION count
COUNT: how many CLASS be there MOTPOST TIME => objects CLASS TIME MOTPOST count
COUNT: how many CLASS be there INPOST WHEN => WHEN objects CLASS INPOST count
COUNT: how many SUBJECT => SUBJECT count
COUNT: how many EVENTS (be there|happen) WHEN => WHEN EVENTS count
COUNT: how many EVENTS WHEN => WHEN EVENTS count
COUNT: how many COLLISIONS (involve|include) ONE WHEN => WHEN ONE filter_collision count
COUNT: how many COLLISIONS (do ONE have|be ONE in) WHEN => WHEN ONE filter_collision count
COUNT: how often do [two|any] OBJS collide WHEN => WHEN objects filter_collision count
COUNT: how often do (a OBJ hit another OBJ|a collision happen|collisions happen) WHEN => WHEN objects filter_collision count
COUNT: how often do ONE (collide|hit another OBJ|hit any OBJ|hit a OBJ|hit OBJS) WHEN => WHEN ONE filter_collision count
COUNT: how often be ONE (hit|hit by another OBJ|in a collision) WHEN => WHEN ONE filter_collision count
COUNT: how often do ONE1 hit ONE2 WHEN => WHEN ONE1 filter_collision ONE2 filter_collision count
COUNT: how often do ONE1 and ONE2 collide WHEN => WHEN ONE1 filter_collision ONE2 filter_collision count
COUNT: [what be] [the] number of SET => SET count
COUNT: count [the] SET => SET count

EXIST: be there [any|a] SET => SET exist
EXIST: be there (no|not any|not a) SET => SET exist negate
EXIST: be any CLASS A => objects CLASS&A exist
EXIST: be no CLASS A => objects CLASS&A exist negate
EXIST: be (any|a) CLASS MOTION TIME => objects CLASS TIME MOTION exist
EXIST: be no CLASS MOTION TIME => objects CLASS TIME MOTION exist negate
EXIST: be (any|a) CLASS (INOUTING|to INOUT) WHEN => WHEN objects CLASS INOUTING INOUT exist
EXIST: be no CLASS INOUTING WHEN => WHEN objects CLASS INOUTING exist negate
EXIST: do (any|a) CLASS MOTBASE TIME => objects CLASS TIME MOTBASE exist
EXIST: do NS MOTBASE TIME => objects NS TIME MOTBASE exist
EXIST: do no CLASS move TIME => objects CLASS TIME filter_moving exist negate
EXIST: (do|have) (any|a) CLASS INOUT WHEN => WHEN objects CLASS INOUT exist
EXIST: do NS INOUT WHEN => WHEN objects NS INOUT exist
EXIST: do no CLASS INOUT WHEN => WHEN objects CLASS INOUT exist negate
EXIST: do (any|a) CLASS INOUT SIDE ONE [do] => events events ONE INOUT unique SIDE objects CLASS INOUT exist
EXIST: be (any|a) CLASS INOUTING SIDE ONE [do] => events events ONE INOUTING unique SIDE objects CLASS INOUTING exist
EXIST: (do|be) [any|a] COLLISIONS (happen|happening) WHEN => WHEN objects filter_collision exist
EXIST: do no COLLISIONS happen WHEN => WHEN objects filter_collision exist negate
EXIST: do [any] [two] OBJS collide WHEN => WHEN objects filter_collision exist
EXIST: do (any OBJ|a OBJ) (collide|hit another OBJ|hit any other OBJ) WHEN => WHEN objects filter_collision exist
EXIST: do no (OBJ|OBJS) collide WHEN => WHEN objects filter_collision exist negate
EXIST: do (any OBJ|any OBJS|a OBJ|another OBJ) hit ONE WHEN => WHEN ONE filter_collision exist
EXIST: do no OBJ hit ONE WHEN => WHEN ONE filter_collision exist negate

# Yes or no about single objects.
ONLY: be ONE MOTION TIME => ONE TIME MOTION exist
ONLY: be ONE not moving TIME => ONE TIME filter_stationary exist
ONLY: be ONE not stationary TIME => ONE TIME filter_moving exist
ONLY: (do|have) ONE MOTBASE TIME => ONE TIME MOTBASE exist
ONLY: (do|have) ONE INOUT WHEN => WHEN ONE INOUT exist
ONLY: be ONE INOUTING WHEN => WHEN ONE INOUTING exist
ONLY: do ONE not INOUT WHEN => WHEN ONE INOUT exist negate
ONLY: (do|have) ONE1 INOUT SIDE ONE2 [do] => events events ONE2 INOUT unique SIDE ONE1 INOUT exist
ONLY: (do|have) ONE1 hit ONE2 WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist
ONLY: be ONE1 (hit by|hitting) ONE2 WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist
ONLY: do ONE1 not hit ONE2 WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist negate
ONLY: be ONE1 not hit by ONE2 WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist negate
ONLY: (do|have) ONE1 and ONE2 collide WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist
ONLY: be ONE1 and ONE2 colliding WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist
ONLY: do ONE1 and ONE2 not collide WHEN => WHEN ONE1 filter_collision ONE2 filter_collision exist negate
ONLY: do PAIR happen WHEN => WHEN PAIR exist
ONLY: do ONE collide WHEN => WHEN ONE filter_collision exist
ONLY: do ONE not collide WHEN => WHEN ONE filter_collision exist negate
ONLY: do ONE hit (any OBJ|a OBJ|another OBJ|any other OBJ|OBJS|any OBJS) WHEN => WHEN ONE filter_collision exist
ONLY: do ONE not hit (any OBJ|any other OBJ|any OBJS) WHEN => WHEN ONE filter_collision exist negate
ONLY: do ONE hit no OBJ WHEN => WHEN ONE filter_collision exist negate
ONLY: be ONE hit [by any OBJ|by a OBJ|by another OBJ] WHEN => WHEN ONE filter_collision exist
ONLY: be ONE in (a collision|any collision|any collisions) WHEN => WHEN ONE filter_collision exist

# Attributes of one object.
ATTRIBUTE: color => query_color
ATTRIBUTE: material => query_material
ATTRIBUTE: shape => query_shape
QUERY: [what be] [the] ATTRIBUTE of THIS => THIS ATTRIBUTE
QUERY: what ATTRIBUTE (be|of|have) THIS => THIS ATTRIBUTE
QUERY: what ATTRIBUTE do THIS have => THIS ATTRIBUTE
QUERY: what be the ATTRIBUTE that THIS have => THIS ATTRIBUTE
QUERY: THIS (have|be) what ATTRIBUTE => THIS ATTRIBUTE
QUERY: what be THIS 's ATTRIBUTE => THIS ATTRIBUTE
QUERY: of what ATTRIBUTE be THIS => THIS ATTRIBUTE
QUERY: (of|from) what material be THIS made => THIS query_material
QUERY: what [material] be THIS made of => THIS query_material
QUERY: THIS be made of what [material] => THIS query_material
QUERY: what ATTRIBUTE N INPRED WHEN => WHEN objects N INPRED unique get_object ATTRIBUTE
QUERY: what ATTRIBUTE N INPRED ORDER WHEN => WHEN objects N INPRED ORDER get_object ATTRIBUTE
QUERY: what ATTRIBUTE INPRED ORDER => events objects INPRED ORDER get_object ATTRIBUTE
QUERY: what OBJ INPRED ORDER by ATTRIBUTE => events objects INPRED ORDER get_object ATTRIBUTE
QUERY: what ATTRIBUTE N MOTPRED TIME => objects N TIME MOTPRED unique ATTRIBUTE
QUERY: [with] what ATTRIBUTE [of] OBJ do ONE (hit|collide) => events ONE filter_collision unique ONE get_col_partner ATTRIBUTE
QUERY: [with] what ATTRIBUTE [of] OBJ do ONE (hit|collide) ORDER => events ONE filter_collision ORDER ONE get_col_partner ATTRIBUTE
QUERY: what ATTRIBUTE OBJ (hit|be hit by) ONE => events ONE filter_collision unique ONE get_col_partner ATTRIBUTE
QUERY: what ATTRIBUTE OBJ (hit|be hit by) ONE ORDER => events ONE filter_collision ORDER ONE get_col_partner ATTRIBUTE
QUERY: what do ONE hit ORDER by ATTRIBUTE => events ONE filter_collision ORDER ONE get_col_partner ATTRIBUTE
THIS: ONE => ONE
THIS: the only N => objects N unique
THIS: [the] [only] MOTION N TIME => objects N TIME MOTION unique
THIS: [the] [only] N MOTPOST TIME => objects N TIME MOTPOST unique
THIS: [the] [only] N INPOST WHEN => WHEN objects N INPOST unique get_object
THIS: [the] [only] N INPOST SIDE ONE [do] => events events ONE INPOST unique SIDE objects N INPOST unique get_object
THIS: [the] ORDER N INPOST SIDE ONE [do] => events events ONE INPOST unique SIDE objects N INPOST ORDER get_object
THIS: [the] ORDER N INPOST WHEN => WHEN objects N INPOST ORDER get_object
THIS: [the] N INPOST ORDER WHEN => WHEN objects N INPOST ORDER get_object
THIS: [the] [only] OBJ PARTNER WHEN => WHEN PARTNER filter_collision unique PARTNER get_col_partner
THIS: [the] ORDER OBJ PARTNER WHEN => WHEN PARTNER filter_collision ORDER PARTNER get_col_partner
THIS: [the] OBJ (that be hit|hit) ORDER by ONE WHEN => WHEN ONE filter_collision ORDER ONE get_col_partner
THIS: [the] OBJ PARTNER ORDER WHEN => WHEN PARTNER filter_collision ORDER PARTNER get_col_partner
PARTNER: (that hit|hitting|to hit|hit by|that be hit by|to be hit by|that be hitting) ONE => ONE
PARTNER: [that] ONE (hit|be hitting|be hit by) => ONE

# When something happens, and what will.
FRAME: ASKWHEN do ONE INOUT => events ONE INOUT unique get_frame
FRAME: ASKWHEN be ONE INOUTING => events ONE INOUTING unique get_frame
FRAME: ASKWHEN do ONE1 hit ONE2 => events ONE1 filter_collision ONE2 filter_collision unique get_frame
FRAME: ASKWHEN be ONE1 hit by ONE2 => events ONE1 filter_collision ONE2 filter_collision unique get_frame
FRAME: ASKWHEN do ONE1 and ONE2 collide => events ONE1 filter_collision ONE2 filter_collision unique get_frame
FRAME: ASKWHEN do [the] ORDER collision happen => events objects filter_collision ORDER get_frame
FRAME: ASKWHEN do [the] ORDER CLASS INOUT => events objects CLASS INOUT ORDER get_frame
FRAME: ASKWHEN be the ORDER collision => events objects filter_collision ORDER get_frame
FRAME: ASKWHEN be the ORDER entrance => events objects filter_in ORDER get_frame
FRAME: ASKWHEN be the ORDER exit => events objects filter_out ORDER get_frame
FRAME: ASKWHEN (be|do) NOUN [happen] => NOUN get_frame
FRAME: what be the (frame|time) (of|when) CLAUSE => CLAUSE get_frame
ASKWHEN: when =>
ASKWHEN: [at|in|on|during] what (frame|time|moment|point) =>
NEXT: [what will happen] next => unseen_events
NEXT: what (happen|be|be happening|come) next => unseen_events
NEXT: what will be next => unseen_events
NEXT: predict what [will] happen next => unseen_events
NEXT: what will happen => unseen_events
LATER: how many COLLISIONS [will] (happen|be there) next => unseen_events objects filter_collision count
LATER: (will|be|do) [there] [be] [any|a] COLLISIONS [happen] next => unseen_events objects filter_collision exist
LATER: (will|do) ONE1 hit ONE2 next => unseen_events ONE1 filter_collision ONE2 filter_collision exist
LATER: (will|do) ONE1 and ONE2 collide next => unseen_events ONE1 filter_collision ONE2 filter_collision exist

DESCRIPTIVE: COUNT => COUNT
DESCRIPTIVE: COUNT => COUNT
DESCRIPTIVE: COUNT => COUNT
DESCRIPTIVE: EXIST => EXIST
DESCRIPTIVE: EXIST => EXIST
DESCRIPTIVE: ONLY => ONLY
DESCRIPTIVE: ONLY => ONLY
DESCRIPTIVE: QUERY => QUERY
DESCRIPTIVE: QUERY => QUERY
DESCRIPTIVE: QUERY => QUERY
DESCRIPTIVE: FRAME => FRAME
DESCRIPTIVE: NEXT => NEXT
DESCRIPTIVE: LATER => LATER

# Multiple choice.
MULTIPLE: what [do] cause EFFECT => events EFFECT filter_ancestor belong_to
MULTIPLE: what (not|do not) cause EFFECT => events EFFECT filter_ancestor belong_to negate
MULTIPLE: why do CLAUSE => events CLAUSE filter_ancestor belong_to
MULTIPLE: why be ONE1 hit by ONE2 => events events ONE1 filter_collision ONE2 filter_collision unique filter_ancestor belong_to
MULTIPLE: why be there PAIRNOUN => events PAIRNOUN filter_ancestor belong_to
MULTIPLE: NOUN be caused by what => events NOUN filter_ancestor belong_to
MULTIPLE: NOUN be not caused by what => events NOUN filter_ancestor belong_to negate
MULTIPLE: what be NOUN caused by => events NOUN filter_ancestor belong_to
MULTIPLE: NEXT => NEXT belong_to
MULTIPLE: what (will not happen|not happen|do not happen|will not be|will not come) next => unseen_events belong_to negate
MULTIPLE: what [will|do] [happen] without [the|a] N => all_events objects N unique get_counterfact belong_to
MULTIPLE: what (not|will not|do not) happen without [the|a] N => all_events objects N unique get_counterfact belong_to negate
EFFECT: NOUN => NOUN
EFFECT: ONE to INOUT => events ONE INOUT unique
EFFECT: ONE1 to hit ONE2 => events ONE1 filter_collision ONE2 filter_collision unique
EFFECT: ONE1 to be hit by ONE2 => events ONE1 filter_collision ONE2 filter_collision unique
EFFECT: ONE1 and ONE2 to collide => events ONE1 filter_collision ONE2 filter_collision unique
EFFECT: CLAUSE => CLAUSE

# Choices: objects, events as nouns (observed), and sentences (any possible event).
CHOICE: [the] presence of ONEA => ONEA
CHOICE: (the|a) N => objects N unique
CHOICE: ONEA 's presence => ONEA
CHOICE: [that] ONEA (be there|be present|exist) => ONEA
CHOICE: [that] there be ONEA => ONEA
CHOICE: NOUNA => NOUNA
CHOICE: that ONE INOUT => events ONE INOUT unique
CHOICE: that PAIRCLAUSE => events PAIRCLAUSE unique
CHOICE: PAIRA will happen => all_events PAIRA unique
CHOICE: PAIRA happen => all_events PAIRA unique
CHOICE: (there will be|there be) PAIRA [happen] => all_events PAIRA unique
CHOICE: PAIRCLAUSE => all_events PAIRCLAUSE unique
CHOICE: ONEA [will] INOUT => all_events ONEA INOUT unique
ONEA: [the|a] N => objects N unique
NOUNA: PAIRA => events PAIRA unique
NOUNA: [the] INOUTNOUN of ONEA => events ONEA INOUTNOUN unique
NOUNA: ONEA 's INOUTNOUN => events ONEA INOUTNOUN unique
NOUNA: ONEA INOUTING => events ONEA INOUTING unique
PAIRCLAUSE: ONEA1 [will] (hit|be hit by) ONEA2 => ONEA1 filter_collision ONEA2 filter_collision
PAIRCLAUSE: ONEA1 will be hitting ONEA2 => ONEA1 filter_collision ONEA2 filter_collision
PAIRCLAUSE: ONEA1 and ONEA2 [will] collide => ONEA1 filter_collision ONEA2 filter_collision
PAIRA: [the|a] collision (between|of|involving) ONEA1 (and|with) ONEA2 => ONEA1 filter_collision ONEA2 filter_collision
PAIRA: ONEA1 's (collision with|hitting) ONEA2 => ONEA1 filter_collision ONEA2 filter_collision
PAIRA: ONEA1 (and|with) ONEA2 's collision => ONEA1 filter_collision ONEA2 filter_collision
PAIRA: ONEA1 (hitting|hit by) ONEA2 => ONEA1 filter_collision ONEA2 filter_collision
PAIRA: ONEA1 and ONEA2 colliding => ONEA1 filter_collision ONEA2 filter_collision
"""

ENGLISH = Rules(ENGLISH_RULES)
"""The rules of all texts in normal form."""
