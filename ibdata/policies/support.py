"""The support of a policy: where its density lies, as far as that can be said before an episode is seen."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple


class Piece(NamedTuple):
    """A part of the support in one component of the action.

    Attributes:
        text: how messages call it.
        of: the policy that says where it is, as JSON of its form; else empty.
        drawn: whether that action depends on random numbers of the episode, which no dataset has.
    """

    text: str
    of: str = ""
    drawn: bool = False


INSIDE = Piece("a density on (-1, 1)")
EDGES = Piece("point masses at ±1")
SOME_EDGES = Piece("point masses at ±1 for some observations")  # `of` a policy, which says for which
LAST = Piece("a point mass at the last action")
COMPONENTS = ("velocity", "gain", "shift")

# A stratum has one piece for each component; a support is the union of its strata.
Stratum = tuple[Piece, Piece, Piece]
Support = frozenset[Stratum]


def each(*pieces: Piece) -> Support:
    """The support in which each component has all of these pieces, independently of the others."""
    return frozenset(product(pieces, pieces, pieces))


def whole(piece: Piece) -> Support:
    """The support that is one point mass at a whole action."""
    return frozenset({(piece, piece, piece)})


def covers(behaviour: Piece, target: Piece) -> bool:
    """Whether data from one piece have all that a policy does in another.

    >>> covers(EDGES, SOME_EDGES), covers(SOME_EDGES, EDGES)
    (True, False)
    """
    if target.drawn:
        return False
    return behaviour == target or (behaviour == EDGES and target.text == SOME_EDGES.text)


def missing(behaviour: Support, target: Support) -> str | None:
    """Describe a part of the target's support that the behaviour's lacks; None if it lacks none.

    >>> missing(each(INSIDE), each(INSIDE, EDGES))
    'point masses at ±1 in velocity, gain and shift'
    >>> missing(each(INSIDE), each(INSIDE) | whole(LAST))
    'a point mass at the last action in the whole action'
    """
    lacking = [lost for lost in target if not any(all(map(covers, had, lost)) for had in behaviour)]
    if not lacking:
        return None
    first = min(lacking)
    for piece in first:
        if all(set(stratum) == {piece} for stratum in target if piece in stratum):
            return f"{piece.text} in the whole action"
        lost_in = {name for j, name in enumerate(COMPONENTS) if any(lost[j] == piece for lost in lacking)}
        had_in = {
            name for had in behaviour for name, own in zip(COMPONENTS, had, strict=True) if covers(own, piece)
        }
        if places := [name for name in COMPONENTS if name in lost_in - had_in]:
            return f"{piece.text} in {_listed(places)}"
    parts = (f"{piece.text} in {name}" for piece, name in zip(first, COMPONENTS, strict=True))
    return " together with ".join(parts)


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
