"""Phrases of questions, and what stands for them in normal form; they are rewritten one after the other.

In a pattern, `<N>` is a single object ("the red cube"), `<S>` any noun phrase and `<scene>` a word for the video or what it shows.
"""

import re
from collections.abc import Callable

__all__ = ["PHRASES"]

_SCENE = (
    r"(?:(?:the|a|whole|entire|full|camera|short) )*(?:video|scene|clip|movie|footage|recording|picture|frame|view|image|shot|"
    r"sequence|screen|film|animation|simulation|field of view|camera view|sight|camera)(?: clip)?"
)
_N = r"(?:(?:the|a|any) )?[NO]"
_S = r"(?:(?:the|a|any) )?(?:NS|OS|N|O)"
_BE_GONE = (
    r"(?:(?:removed|absent|gone|missing|deleted|erased|eliminated|excluded|omitted|subtracted|"
    r"(?:taken|moved|cut|left|edited) (?:away|out|off))(?: (?:from|of|out of) <scene>)?)"
)
_NOT_THERE = (
    r"(?:(?:do not|not) (?:exist|be (?:there|present)|be present)|(?:be|have) (?:not|no longer) (?:be )?"
    r"(?:there|present|exist|around|part of <scene>|a part of <scene>)|have not existed|be nonexistent)"
)
_IF = r"(?:if|after|suppose|supposing|imagine|assume|assuming|when|given|once|say)(?: that)?"

_PHRASES: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    (r"\bbeing (?=hit|struck|touched|bumped|rammed|collision)", ""),
    (r"\bbeing\b", "be"),
    # Polite beginnings and requests.
    (r"^(?:hi|hello|hey|ok|okay|so|well|now|and|question|quick question) ", ""),
    (r"\b(?:please|kindly|actually|really|simply|basically|altogether|overall|even|ever|exactly how|just tell|just say|thanks|thank you)\b",
     lambda m: {"exactly how": "how", "just tell": "tell", "just say": "say"}.get(m[0], "")),
    (r"\b(?:in total|at all|in all|at any (?:point|time|moment|stage)|at some (?:point|time|moment|stage)|anywhere)\b", ""),
    (r"^(?:can|could|will|may) (?:you|i|we|someone) (?:tell|show|say|ask|inform|know|give|let) (?:(?:me|us|you) )?(?:know )?", "tell "),
    (r"^(?:do you know|do anyone know|do you happen to know|i (?:want|wish|need) to know|i will like to know|i be wondering|i wonder|let me know|"
     r"tell me|tell us|say|tell|figure out|find out|determine|(?:give|show)(?: me)?|name|state|identify|specify|report|describe|find)"
     r" (?:me )?(?=how\b|what\b|which\b|when\b|why\b|if\b|whether\b|the\b|at what\b|in what\b|in which\b|at which\b|of what\b)", "tell "),
    (r"^tell (?=how|what|which|when|why|at|in|of)", ""),
    (r"^tell (?=the number of)", "what be "),
    (r"^tell (?=the (?:color|material|shape))", "what be "),
    (r"^tell (?:if|whether) ", "whether "),
    (r"^(?:be it (?:true|right|correct|the case) that) ", "whether "),
    (r"^whether there be ", "be there "),
    (r"^whether (<N>) (be|do|have) ", r"\2 \1 "),
    (r"^whether (<N>) (enter|exit|move|hit|collide)\b", r"do \1 \2"),
    (r"^whether (<N> and <N>) (be|do|have) ", r"\2 \1 "),
    (r"^whether (<N> and <N>) (collide|hit)\b", r"do \1 \2"),
    (r"^whether (any <S>) (be|do|have) ", r"\2 \1 "),
    (r"^(?:can|do|will) (?:you|we|i|one) (?:see|spot|find|notice|observe|detect|count|have) (?=no|any|a|NS|OS|moving|stationary)", "be there "),
    (r"^(?:do|can) <scene> (?:show|contain|have|include|feature) ", "be there "),
    (r"\b((?:NS|OS|collisions)(?: (?:in total))?) (?:can|do|will) (?:you|we|i|<scene>) (?:see|spot|find|notice|observe|detect|count|have|contain|show)\b", r"\1 be there"),
    (r"\b(NS|OS|collisions) (?:can )?be (?:seen|visible|shown|present|observed|found|recorded|contained)\b", r"\1 be there"),
    (r"\b(how many (?:NS|OS|collisions)) exist\b", r"\1 be there"),
    (r"^how many <scene> ", "how many "),
    (r"^do ((?:any |a )?(?:moving |stationary )?(?:NS|OS|N|O)) exist\b", r"be there \1"),
    (r"^be ((?:any |a |no )(?:moving |stationary )?(?:NS|OS|N|O)) (?:there|present|visible|in <scene>|around)\b", r"be there \1"),
    (r"^be (NS|OS) (?:there|present|visible|in <scene>)\b", r"be there \1"),
    (r"\bwhich (?:(?:one|ones|event|events|option|choice) )?(?:(?:of the following|of these|of those)(?: (?:events|event|options|choices|things|statements|ones|answers|possibilities|collisions))?|event|events|option|choice|one|ones|answer)\b(?! of)", "what"),
    (r"\b(?:what|which) (?:event|events|of the|of these|of those|other event|collision|collisions|option|options)\b(?= (?:will|happen|do|be|come|not|cause|next|lead|have|follow|bring|make|trigger|result|contribute|play))", "what"),
    (r"(?<=[NOS]) (?:which|who)\b", " that"),
    (r"\bwhich\b", "what"),
    (r"\bwhat (?:number|count|total number) of\b", "how many"),
    (r"\bhow many of (?:the )?", "how many "),
    (r"\b(?:the )?total (?:number|count) of\b", "the number of"),
    (r"^(how many (?:OS|NS|collisions)) total$", r"\1 be there"),
    (r"^any (?=(?:moving |stationary )?(?:NS|OS|N|O|collisions)\b)", "be there any "),
    (r"^do there exist ", "be there "),
    (r"^what (color|material|shape) (.+) be$", r"what \1 be \2"),
    (r"^what the (color|material|shape) of (.+) be$", r"what be the \1 of \2"),
    (r"^when (<N>) (enter|exit)$", r"when do \1 \2"),
    (r"\b(NS|OS|that|N|O) have (?=enter|exit|move)", r"\1 "),
    (r"\bthe count of\b", "the number of"),
    (r"\bhow many (?:different|distinct|total|separate) (?=OS|NS|collision)", "how many "),
    (r"^(?:can|could|do|will) (?:you|i|we) count ", "count "),
    (r"\bin case\b", "if"),
    (r"\b(?:if (?:we|you) )?imagine <scene> without\b", "without"),
    (r"\bfor (?:me|us)$|^(?:for (?:me|us)) ", ""),
    (r"\b(?:will|do) (?:you|we) (?:say|expect to)\b", lambda m: "will" if m[0].endswith("to") else ""),
    (r"^have there be (?=(?:a|any|no)? ?collision)", "be there "),
    (r"\b(before|after|when) (<N>) (?:come|came|comes)(?= |$)(?! (?:in|into|to|up|out|on)\b)", r"\1 \2 enter"),
    (r"^be it possible to (?:see|find|spot) ", "be there "),
    (r"\b(of|be|do|have|and|with|if|without|between|when|before|after) that (?=[NO]\b)", r"\1 the "),
    (r"\bbe of what\b", "be what"),
    (r"^when will (?=<N> (?:enter|exit|hit|and))", "when do "),
    (r"^count (?:how many|up|all|the number of)\b(?: the)?", "count"),
    (r"^be (any|a|no) (NS|OS|N|O)$", r"be there \1 \2"),
    (r"^(how many (?:moving |stationary )?(?:OS|NS|collisions)) there be\b", r"\1 be there"),
    (r"\b(any|no|none) of (?:the )?(?=NS|OS)", lambda m: "any " if m[1] == "any" else "no "),
    (r"\bkind of (?=shape|material|color)|\btype of (?=shape|material|color)|\bsort of (?=shape|material|color)", ""),
    (r"\bwhat (?:kind|type|sort) of material\b", "what material"),
    (r"\b(?:in|of) what color\b(?= be)", "what color"),
    (r"\bmade (?:out of|from|up of)\b", "made of"),
    (r"\bwhat (?=(?:be )?<N>)(?:be )?(<N>) (?:colored|built|constructed|formed) (?:of|from)\b", r"what be \1 made of"),
    (r"\bin terms of\b|\bregarding\b", "by"),
    # Times.
    (r"\b(?:when|as|once|while|the moment|at the (?:time|moment)(?: when| that)?|as soon as|the instant) (?:<scene>|it) (?:begin|open)\b", "when video begin"),
    (r"\b(?:right |just )?(?:at|in|from|during|on|by) (?:the )?(?:very )?(?:begin|beginning|outset|(?:very )?first frame|opening|opening frame|starting)(?: (?:of|in) <scene>)?\b", "when video begin"),
    (r"\b(?:initially|at first|to begin with)\b", "when video begin"),
    (r"\b(?:at|in|from) <scene> 's (?:begin|beginning)\b", "when video begin"),
    (r"\b(?:after|past|following|beyond|once) (?:the (?:very )?end of )?<scene>(?: (?:end|be over|have end|be finished|be end|cut off|be done))?(?=$| )(?! (?:begin|be|do))", "next"),
    (r"\b(?:after|once) (?:<scene>|it) (?:end|be over|have end|be end|be done|be finished)\b", "next"),
    (r"\b(?:when|as|while|the moment|at the (?:time|moment)(?: when| that)?|as soon as|the instant|by the time) (?:<scene>|it) (?:end|be over|be done|be finished|have end|conclude|concludes|be ending|close|closes)\b", "when video end"),
    (r"\b(?:right |just )?(?:at|in|by|on|during) (?:the )?(?:very )?(?:end|ending|close|conclusion|finish|(?:very )?last frame|closing frame)(?: (?:of|in) <scene>)?\b", "when video end"),
    (r"\b(?:at|in|by) <scene> 's (?:end|ending)\b", "when video end"),
    (r"\bfinally\b", "when video end"),
    (r"\b(?:as|while)\b", "when"),
    (r"\bbefore to\b", "before"),
    (r"\bfollowing (?=<N>|the (?:entrance|exit|collision|first|second|last|arrival|departure)\b)", "after "),
    (r"\b(?:at the (?:time|moment) of|during|upon)(?= (?:the )?(?:first|second|last|collision|entrance|exit|[NO])\b)", "when"),
    (r"\bwhen (?=when video)", ""),
    # Seeing, entrances and exits.
    (r"\b(?:come|comes|came|get|gets|got|move|walk|roll|rolls|rolled|slide|slides|slid|go|goes|went|pop|drive|drives|fly|flies|travel|travels|drift|drifts|glide|glides|drop|drops|pass|passes|show|shows|showed|pops)"
     r" (?:in(?: (?:to|from the side))?(?: <scene>)?|into <scene>|onto <scene>|on <scene>|inside(?: <scene>)?|up(?: (?:in|on) <scene>)?)(?= |$)", "enter"),
    (r"\b(?:coming|getting|moving|walking|rolling|sliding|going|popping|driving|flying|traveling|drifting|gliding|dropping|passing|showing)"
     r" (?:in(?: (?:to|from the side))?(?: <scene>)?|into <scene>|onto <scene>|on <scene>|inside(?: <scene>)?|up(?: (?:in|on) <scene>)?)(?= |$)", "entering"),
    (r"\b(?:appear|appears|appeared|arrive|arrives|arrived|emerge|emerges|emerged)(?: (?:in|into|at|on) <scene>)?\b", "enter"),
    (r"\b(?:appearing|arriving|emerging)(?: (?:in|into|at|on) <scene>)?\b", "entering"),
    (r"\b(?:entry|arrival|appearance|entering)(?= (?:of )?(?:in|into|of))", "entrance"),
    (r"\b(?:entry|arrival|appearance)\b", "entrance"),
    (r"\b(?:departure|disappearance|exiting)(?= of)|\b(?:departure|disappearance)\b", "exit"),
    (r"\b(?:make|makes|made) (?:its|an|a) entrance\b", "enter"),
    (r"\b(?:make|makes|made) (?:its|an|a) exit\b", "exit"),
    (r"\b(enter|entering|entrance)(?: (?:in|into|to|on|onto))? <scene>", r"\1"),
    (r"\b(?:leave|leaves|left|disappear|disappears|disappeared|depart|departs|departed|vanish|vanishes|vanished)(?: (?:from|out of|of))?(?: <scene>)?(?= |$)(?! out)", "exit"),
    (r"\b(?:leaving|disappearing|departing|vanishing)(?: (?:from|out of|of))?(?: <scene>)?(?= |$)", "exiting"),
    (r"\b(?:go|goes|went|move|get|gets|got|come|roll|rolls|rolled|slide|slides|slid|drive|drives|fly|flies|travel|travels|drift|drifts|glide|glides|pass|passes|fall|falls|drop|drops)"
     r" (?:out of <scene>|out|off <scene>|off|outside <scene>|away|offscreen|off camera)(?= |$)", "exit"),
    (r"\b(?:going|moving|getting|coming|rolling|sliding|driving|flying|traveling|drifting|gliding|passing|falling)"
     r" (?:out of <scene>|out|off <scene>|off|outside <scene>|away|offscreen|off camera)(?= |$)", "exiting"),
    (r"\b(exit|exiting)(?: (?:from|out of|of))? <scene>", r"\1"),
    (r"\b(enter|exit) it$", r"\1"),
    (r"\bfirst (enter|exit)\b(?=$| (?:before|after))", r"\1 first"),
    (r"\b(do <N>) first (enter|exit)\b", r"\1 \2"),
    (r"^(.*\bmov(?:e|ing)\b.*) (?:throughout|(?:for |during |in )?(?:the|a) (?:whole|entire|full)) .*$", r"\1 always"),
    (r"\bstill (the whole|the entire|all the) time\b|\b(?:the whole|the entire|all the) time$", lambda m: "still" if m[1] else "throughout"),
    (r"\bstationary throughout$|\bstill throughout$", "stationary"),
    (r"^be there still\b", "be there always"),
    (r"\bstill (?:in|on|inside|within|part of|present in) <scene>", "still there"),
    (r"\b(be|not) (?:(?:in|on|inside) (?:<scene>)|present in <scene>|part of <scene>)(?= |$)", r"\1 there"),
    (r"\bbe <scene>(?= |$)", "be there"),
    (r"\b(?:seen )?(?:in|of|on|within|during|throughout|across|over|from) (?:the course of )?<scene>(?= |$)(?! (?:begin|end|be over))", ""),
    (r"\b(?:here|onscreen|on screen|on camera)\b", ""),
    (r"\b(once|after|before|until|when) (<N>) (?:be there|have enter|have entered|be entered)\b", r"\1 \2 enter"),
    (r"\b(once|after|before|until|when) (<N>) (?:have exit|be gone|have gone)\b", r"\1 \2 exit"),
    # Removal.
    (rf"(?:^| ){_IF} there (?:be|have be|will be|have) (?:no|not (?:be )?(?:a|any|the)|no longer a) (?=[NO]\b)", " without the "),
    (rf"(?:^| ){_IF} (<N>) (?:be|have be|have|get|gets|got|will be)(?: all)? {_BE_GONE}(?= |$)", r" without \1"),
    (rf"(?:^| ){_IF} (<N>) (?:will )?{_NOT_THERE}(?= |$)", r" without \1"),
    (rf"(?:^| ){_IF} (?:we|you|i|one|someone|they|somebody) (?:be to |will )?(?:remove|removed|removes|delete|deleted|erase|erased|omit|eliminate|eliminated|exclude|excluded|"
     r"get rid of|got rid of|leave out|left out|take out|took out|take away|took away)"
     r" (<N>)(?: from <scene>)?(?= |$)", r" without \1"),
    (rf"(?:^| ){_IF} (?:we|you|i|one|someone|they|somebody) (?:take|took|leave|exit|takes) (<N>) (?:out|away|out of <scene>)(?= |$)", r" without \1"),
    (r"\b(?:after|upon|on|by|following) (?:the )?(?:removal of|removing|taking away|deleting|taking out) (<N>)(?= |$)", r"without \1"),
    (r"(?:^| )(?:remove|removing|delete|deleting|take out|taking out|take away|taking away) (<N>)(?: from <scene>)?(?: and)?(?= what|$)", r" without \1"),
    (rf"(?:^| ){_IF} it be not for (?=<N>)", " without "),
    (rf"(?:^| )(?:have|be) (<N>) (?:not (?:be |have be )?(?:there|present|exist|existed)|not be there|(?:be )?{_BE_GONE})(?= |$)", r" without \1"),
    (rf"(?:^| )with (<N>) (?:be )?(?:{_BE_GONE}|out(?: of (?:the way|<scene>))?)(?= |$)", r" without \1"),
    (r"(?:^| )have there (?:be )?no (?:a |the )?(?=[NO]\b)", " without the "),
    (r"(?:^| )with no (?:sign of )?(?:the )?(?=[NO]\b)", " without the "),
    (r"(?:^| )in (?:the )?absence of (?=<N>)", " without "),
    (r"\bwithout (<N>)(?: (?:being |be )?(?:there|present|around)| in the way| in <scene>)(?= |$)", r"without \1"),
    (r"\bwithout the presence of\b", "without"),
    (r"^(without <N>) (what .*)$", r"\2 \1"),
    (r"\b(without the presence of|without) (?=<N>)", "without "),
    # Motion.
    (r"\b(<N>) 's be (?=there|present)", r"\1 be "),
    (r"\bin motion\b|\bon the move\b", "moving"),
    (r"\bat rest\b|\bat a standstill\b|\bin place\b|\bresting\b|\bmotionless\b|\bunmoving\b|\bimmobile\b|\bstatic\b|\bstanding still\b|"
     r"\bsitting still\b|\bnot in motion\b|\bstill standing\b|\bnonmoving\b|\bnon moving\b|\bat a stand still\b|\bidle\b|\bnot moved\b|\bunmoved\b", "stationary"),
    (r"\bstill (?=moving|move|stationary|happen|not)", ""),
    (r"\b(?:stand|stands|stood|sit|sits|sat|lie|lies|lay) still\b", "stay stationary"),
    (r"\b(?:lying|standing|sitting|staying|kept) still\b", "stationary"),
    (r"\bstill\b", "stationary"),
    (r"\bstay (?:where (?:it|they) be|put)\b|\brest\b|\brests\b", "stay stationary"),
    (r"\bstay moving\b", "be moving"),
    (r"\bbe stay\b", "be"),
    (r"^(?!do )(.*)\b(NS|OS|that) (?:do not|not) move\b", r"\1\2 be stationary"),
    (r"\b(be|do) (any NS|any OS|any N|any O) (?:not moving|not move|do not move)\b", r"be \2 stationary"),
    (r"\b(NS|OS) not moving\b", r"\1 stationary"),
    (r"\b(NS|OS) be not moving\b", r"\1 be stationary"),
    (r"\bthat be not moving\b", "that be stationary"),
    (r"\bnot moving (?=[NO])", "stationary "),
    # Collisions.
    (r"\b(and <N>|OS) (?:come|comes|came|get|gets|got) in(?:to)? (?:contact|collision)(?: with each other| with one another)?(?= |$)", r"\1 collide"),
    (r"\b(?:collide|bump|bumps|bumped|crash|crashed|run|runs|ran|knock|knocks|knocked|smash|smashes|smashed|bang|bangs|banged|slam|slams|slammed|ram|rams|rammed|"
     r"collision|collisions) (?:together|into each other|into one another|with each other|with one another|against each other|each other)\b", "collide"),
    (r"\b(?:hit|strike|strikes|struck|touch|touches|touched|meet|meets|met|contact|bump|crash) (?:each other|one another|together)\b", "collide"),
    (r"\b(how many|any|no|the|of) (?:bumps|hit)(?= (?:happen|be there|that|before|after|between|next)|$)", r"\1 collisions"),
    (r"(?<!of )\b(<N>) collisions? with (?=<N>)", r"\1 hit "),
    (r"\bcollision of (<N>) (?:into|against) ", r"collision of \1 with "),
    (r"\b(collisions?) happen (between OS|between <N> and <N>|involving <N>|with <N>)", r"\1 \2 happen"),
    (r"\b(?:collide|collision|crash|crashed|bump|bumps|bumped|run|runs|ran|knock|knocks|knocked|smash|smashes|smashed|bang|bangs|banged|slam|slams|slammed|ram|rams|rammed|collisions|impacts?)"
     r" (?:into|against|in to)\b", "hit"),
    (r"\b(?:hit|collide) (?:with|into|against)\b", "hit"),
    (r"\b(?:strike|strikes|struck|touch|touches|touched|make contact with|makes contact with|made contact with|come into contact with|comes into contact with|came into contact with|"
     r"have a collision with|bounce off|bounces off|bounced off|be in a collision with|get in a collision with|hit against|ram|rams|rammed|bump|bumps)(?: of)?(?= <S>| the| another| any|$| [NO]|$)", "hit"),
    (r"\b(?:colliding|bumping|crashing|running|knocking|smashing|banging|slamming|ramming) (?:with each other|into each other|together|with one another|into one another)\b|\b(?:hitting|touching) each other\b", "colliding"),
    (r"\b(?:colliding|bumping|crashing|running|knocking|smashing|banging|slamming|ramming|hitting) (?:with|into|against)\b", "hitting"),
    (r"\b(?:striking|touching|making contact with|coming into contact with|bouncing off|bumping|ramming)\b", "hitting"),
    (r"\b(?:be )?(?:being )?(?:struck|touched|bumped|rammed|collided|banged|hit|knocked|hitting)(?: (?:into|with))? by\b", lambda m: "be hit by" if m[0].startswith("be") else "hit by"),
    (r"\b(?:get|gets|got|getting|be be|be being) (?=hit by)", "be "),
    (r"\bdo (<N>) get (?=hit)", r"be \1 "),
    (r"\bbe be hit by\b|\bget be hit by\b|\bgets be hit by\b", "be hit by"),
    (r"\b(do|will) (<N>) (?:be|get) hit by\b", r"be \2 hit by"),
    (r"\bbe (<N>) (?:get |be )?hit by\b", r"be \1 hit by"),
    (r"\b(?:crashing|bumping|clashing)\b", "colliding"),
    (r"\b(?:bump|clash|clashes|smash|contact)\b", "collision"),
    (r"\b(and <N>|OS|they)( will)? (?:collision|make contact|have a collision|get into a collision|crash|crashed|bumped|hit|meet)$", r"\1\2 collide"),
    (r"\b(<N> and <N>|OS) (?:collision|make contact|crash|touch|hit|meet)(?= (?:before|after|when|next|happen))", r"\1 collide"),
    (r"\b(?:take|takes|took|taking) place\b|\btakes place\b", "happen"),
    (r"\bhow (?:many times|much)\b", "how often"),
    (r"\bhow often (?:be|do) there (?:be )?(?:a )?collisions?\b", "how many collisions happen"),
    (r"\bhow many times\b", "how often"),
    (r"\btake part in\b|\bparticipate in\b", "have"),
    (r"^do (<N>) have (a|any) (collisions?)\b", r"be \1 in \2 \3"),
    (r"^(how many collisions be <N>) part of\b", r"\1 in"),
    (r"^in how many collisions be (<N>)(?: involve| part)?(?= |$)", r"how many collisions be \1 in"),
    (r"\bthe collision that involve\b", "the collision involving"),
    (r"\b(collisions?) (?:that )?(?:be )?(?:with|having|that have)\b(?= <N>)", r"\1 with"),
    (r"\b(?:the )?(?:only|sole|single) (?=collision)", "the only "),
    # What happens.
    (r"\b(?:be (?:going|about|set|(?:most )?likely|expected|bound|supposed) to)\b", "will"),
    (r"\bwill (?:have |be )?(?:happening|happened)\b", "will happen"),
    (r"\bwill not (?:have |be )+happen(?:ing|ed)?\b", "will not happen"),
    (r"\bwill have happen\b|\bhave happen\b|\bcan happen\b", "will happen"),
    (r"\bgo on\b|\bgoing on\b|\bgoes on\b", "happen"),
    (r"\b(?:cannot|can not|can) (?=happen)", lambda m: "will not " if "not" in m[0] else "will "),
    (r"\b(?:probably|likely|most likely|do you (?:think|predict|expect|believe)|you think)\b(?! to)", ""),
    (r"\bno longer (?=happen)", "not "),
    (r"\bcome to pass\b", "happen"),
    (r"\b(?:fail|fails|failed) to (?=happen|cause)", "not "),
    (r"\b(?:afterwards|afterward|after (?:this|that|the|it)$|later|later on|subsequently|thereafter|then$|from here|from now on|in the future|following this)", "next"),
    (r"\bafter the(?: end)?$", "next"),
    (r"\bnext (?:in time|up)\b|\b(?:right|just) next\b", "next"),
    (r"\bwhat (?:will |be )?(?:come|comes|came|coming|follow|follows)(?: up)?(?: next)?$", "what will happen next"),
    (r"\bwhat (?:be|have) next\b|^what next$|\bwhat (?:be )?the next(?: event)?$|\bwhat be the next (?:events?|collisions?)$", "what happen next"),
    (r"\bnext (will|do|happen)\b", r"\1"),
    (r"\bhappen next next\b", "happen next"),
    # Causes.
    (r"\b(?:be )?(not )?(?:be )?(?:responsible for|(?:(?:a|the|one|one of the|among the|part of the) )?(?:cause|causes|causing|reason|reasons|explanation)(?: of| for| behind| why| that|(?= <N>))|to blame for|behind|the cause behind|causing)\b",
     lambda m: f"{m[1] or ''}cause"),
    (r"\b(?:contribute|contributes|contributed|lead|leads|led)(?: up)? to\b|\b(?:bring|brings|brought) about\b|\b(?:result|results|resulted) in\b|\b(?:trigger|triggers|triggered)\b|"
     r"\b(?:give|gives|gave) rise to\b|\b(?:account|accounts|accounted) for\b|\b(?:explain|explains|explained)\b|"
     r"\b(?:play|plays|played) (?:a|any) (?:part|role) in\b|\bhave (?:something|anything) to do with\b|\b(?:make|makes|made) (?=<N>)", "cause "),
    (r"\bhave nothing to do with\b|\b(?:play|plays|played) no (?:part|role) in\b|\bhave no (?:influence|effect|bearing|part) (?:on|in)\b|\bbe (?:irrelevant|unrelated) to\b", "not cause"),
    (r"\b(?:cause|led|brought about|triggered|due|because|caused) (?=by)", "caused "),
    (r"\bbe (?:the )?result of\b|\bbe due to\b|\bhappen because of\b", "be caused by"),
    (r"^what (?:be )?(?:the )?(?:cause|reason)$", "what cause"),
    (r"^what (do .*) because of$", r"why \1"),
    (r"\bfor what reason\b|\bbecause of what\b|\bdue to what\b|\bwhat be the reason why\b", "why"),
    (r"\bwhy be it that\b|\bhow come\b", "why"),
    (r"^why (?=(?:the|[NO])\b)", "why do "),
    (r"^(<N>) (enter|exit) (?:why|because of what)$", r"why do \1 \2"),
    (r"\bhave (?=cause\b)", ""),
    (r"\bwhat (?:be|do) (?=cause)(?!.*caused by)", "what "),
    (r"\bwhat be not cause\b|\bwhat do not cause\b|\bwhat have not cause\b", "what not cause"),
    (r"\b(?:a |the )?(?:part of|part in|participant in|partner in)(?= (?:a|any|how|the|many))", "in"),
    (r"\bbe (<N>) involve in\b", r"be \1 in"),
    (r"\bthe fact that\b", "that"),
    (r"\b(?:the )?(?:existence|presence|being) of\b", "the presence of"),
    (r"\b(?:existence)\b", "presence"),
    (r"^((?:at what frame |in what frame |what time )?when do <N> (?:enter|exit)) first$", r"\1"),
    (r"^predict (?:the )?next(?: \w+)?$", "what will happen next"),
    (r"^what be the next events?(?: (?:to|that)(?: will)? happen)?$", "what will happen next"),
    (r"\bbe (?:being )?there\b", "be there"),
    (r"^(the presence of) the fact", r"\1"),
)  # fmt: skip


def _compiled(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern.replace("<scene>", _SCENE).replace("<N>", _N).replace("<S>", _S))


PHRASES = tuple((_compiled(pattern), replacement) for pattern, replacement in _PHRASES)
"""(pattern, replacement), applied in this order to a text whose noun phrases are N, NS, O, OS and A."""
