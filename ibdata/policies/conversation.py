"""Ask an object step by step, and find out whether it remembers or draws what ibdata does not give it."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import numpy as np

from ibdata.policies.given import Given
from ibdata.policies.ways import Answer, AnswerError, Way

ASKED_AGAIN = (0, 1, 10, 100)  # the steps of an episode at which an earlier question is asked again
NEARLY = {"rtol": 1e-3, "atol": 1e-3}  # the last bits of an action may depend on the number of episodes

DECLARE = (
    "memory must be returned by decide, be the state of predict, or begin anew in reset(n), and random "
    "numbers must come from `uniforms`"
)
SECRET = f"found other actions when the same was asked again, expected equal ones; {DECLARE}"
MIXED = (
    "found other actions for the same episodes in another order, expected that the actions of an episode "
    "depend on nothing in the others; random numbers must come from `uniforms`"
)
DISORDER = (
    "found a question about step {}, expected the steps of the same episodes in order from step 0, because "
    "the object remembers them; only a policy with decide may begin at any step"
)


class Conversation:
    """The questions to an object and its answers, for one block of episodes after another.

    An episode's actions may depend on its inputs alone: else they would be other ones in another file, worker
    or block. So the first question of all is asked once with the episodes in another order; and at some
    steps, an earlier question is asked again, which must give the same bits:

    - If the object has no `reset`, it is the first question of all, without a state.
    - Else the object begins anew, and the questions of the block are asked again up to the second one, after
      which the object is where it was.
    """

    def __init__(self, way: Way) -> None:
        self.way = way
        self.asked: list[tuple[Given, Answer]] = []  # which are asked again
        self.last: tuple[Given, Answer] | None = None

    def answer(self, given: Given) -> Answer:
        """Return what the object answers, whose state is carried from one step of a block to the next.

        If the question is the last one, it gets the same answer.

        Raises AnswerError if the object fails, gives another answer than before, or is not asked in order.
        """
        if self.last is not None and _same(self.last[0], given):
            if not self._remembers:
                _refuse_other(self._ask_again(given, None), self.last[1])
            return self.last[1]
        self._refuse_disorder(given)
        question, step = given.apply(np.copy), int(given.step[0])
        begins = not given.step.any()
        state = None if begins or self.last is None else self.last[1].state
        if begins:
            self.way.begin(len(given.step))
        found = self.way.ask(question, state)
        if found.state is not None and state is None and not begins:
            raise AnswerError(DISORDER.format(step))
        is_first = not self.asked
        if is_first or (self.way.reset is not None and step <= 1):
            self.asked = [*self.asked[:step], (question, found)]
        if step in ASKED_AGAIN:
            found = self._again(found, step)
        if is_first:
            self._refuse_mixing(question, found)
            found = self._again(found, step)
        self.last = question, found
        return found

    @property
    def _remembers(self) -> bool:
        """Whether the object keeps something for the next step other than its memory."""
        return self.way.reset is not None or (self.last is not None and self.last[1].state is not None)

    def _again(self, found: Answer, step: int) -> Answer:
        """Ask what was asked before. Returns the answer to the latest question, with its state."""
        if self.way.reset is None:
            question, before = self.asked[0]
            _refuse_other(self._ask_again(question, None), before)
        elif step <= 1:
            self.way.begin(len(found.actions))
            state = None
            for question, before in self.asked:
                found = self._ask_again(question, state)
                _refuse_other(found, before)
                state = found.state
        return found

    def _ask_again(self, question: Given, state: Any) -> Answer:
        try:
            return self.way.ask(question, state)
        except AnswerError as error:
            raise AnswerError(f"{error}, when asked again; {DECLARE}") from error

    def _refuse_mixing(self, question: Given, found: Answer) -> None:
        """AnswerError if most actions are others where the episodes have other places."""
        n = len(found.actions)
        rows = np.roll(np.arange(max(2, n)), 1) % n
        self.way.begin(len(rows))
        other = self._ask_again(question.apply(itemgetter(rows)), None)
        near = np.isclose(other.actions, found.actions[rows], **NEARLY, equal_nan=True).all(axis=1)
        if 2 * int(near.sum()) <= len(rows):
            raise AnswerError(MIXED)

    def _refuse_disorder(self, given: Given) -> None:
        """AnswerError if an object that remembers is asked about other steps than the next ones."""
        expected = -1 if self.last is None else self.last[0].step
        if self._remembers and given.step.any() and not np.array_equal(given.step, expected + 1):
            raise AnswerError(DISORDER.format(given.step[0]))


def _refuse_other(found: Answer, before: Answer) -> None:
    for one, other in zip(found[:2], before[:2], strict=True):
        if not np.array_equal(one, other, equal_nan=True):
            raise AnswerError(SECRET)


def _same(question: Given, other: Given) -> bool:
    pairs: Any = zip(question, other, strict=True)
    return all(np.array_equal(one, two) for one, two in pairs)
