"""Videos whose colours are exchanged with each other: new ones for a network, with questions and answers that are known.

CLEVRER's physics does not depend on colours. Features of the truth have numbers of their own for them, those of pixels do not.
"""

import numpy as np

from nsdr.baselines.data import Example, Vocabulary


class Recoloring:
    """Draws exchanges of colours, and applies them to texts.

    Args:
        vocabulary: of the training; colours that it does not know, as words and as answers, stay as they are.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        colors = vocabulary.objects.words["color"]
        self.n_colors = len(colors)
        self.known = [i for i, c in enumerate(colors) if c in vocabulary.words and c in vocabulary.answers]
        self._words = {i: vocabulary.words.index(colors[i]) + 1 for i in self.known}
        self._answers = {i: vocabulary.answers.index(colors[i]) for i in self.known}
        self._tokens = {i: vocabulary.token_indices[colors[i]] for i in self.known}

    def draw(self, rng: np.random.Generator) -> tuple[int, ...]:
        """For each colour, the index of the colour that takes its place."""
        drawn = np.arange(self.n_colors)
        drawn[self.known] = rng.permutation(self.known)
        return tuple(drawn.tolist())

    def text(self, example: Example, colors: tuple[int, ...]) -> Example:
        """The same text about the video with these colours."""
        words, answers, tokens = (
            {indices[i]: indices[colors[i]] for i in self.known}
            for indices in (self._words, self._answers, self._tokens)
        )
        return example._replace(
            words=[words.get(w, w) for w in example.words],
            program=[tokens.get(t, t) for t in example.program],
            answer=answers.get(example.answer, example.answer),
            colors=colors,
        )
