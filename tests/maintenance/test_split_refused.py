"""Impossible options of `split` are refused in one line, and change nothing; tests/corpus has more."""

import pytest
from helpers.folders import contents
from helpers.tiny import MANY

import ibdata
from ibdata.errors import UsageError

TRANSFER = {"source": [50], "target": [75]}
REFUSED = [
    ({"source": [50], "target": [50]}, "found 50 as source and target, expected different"),
    ({"source": [50]}, "found none as source and target"),
    ({**TRANSFER, "shots": 6}, "found a budget of 6 episodes, expected at most 5, the episodes of each pol"),
    ({**TRANSFER, "shots": 0}, "found 0 shots, expected at least 1"),
    ({**TRANSFER, "transitions": 3}, "found 3 transitions, expected at least 4, those of an episode"),
    ({**TRANSFER, "shots": 1, "transitions": 9}, "expected one of them"),
    ({**TRANSFER, "fractions": (0.5, 0.5)}, "found --fractions, but the scheme transfer uses only --source"),
    ({"scheme": "distance", "source": [50]}, "needs both --source and --within"),
    ({"scheme": "distance", "source": [50], "within": 5}, "found 0 setpoints within 5"),
    ({"scheme": "leave-one-ou"}, "expected one of transfer, leave-one-out"),
    ({"scheme": "leave-one-ou"}, "did you mean 'leave-one-out'?"),
    ({"by": "episode", "fractions": (0.9, 0.05, 0.05)}, "found 5 episodes in each cell"),
    ({"by": "episode", "fractions": 0.8}, "found fractions 0.8, expected 2 or 3"),
    ({"by": "episode", "shots": 1}, "found --shots, but a split by episode uses only --fractions"),
    (
        {"by": "policy", "names": {"saef": "x"}},
        "found 'saef' to be renamed, expected one of random, safe; di",
    ),
    ({"by": "policy", "names": {"safe": "random"}}, "found one name for two splits"),
    ({"remove": ["x"], "prefix": "a"}, "found a name or a prefix, but no splits to make"),
]


@pytest.fixture(scope="module")
def many(made_at, tmp_path_factory):
    return made_at(MANY, tmp_path_factory.mktemp("many") / "many")


@pytest.mark.parametrize(("call", "line"), REFUSED, ids=range(len(REFUSED)))
def test_what_cannot_be_meant_is_refused(many, call, line):
    before = contents(many.path)
    with pytest.raises(UsageError, match=r"^split: ") as error:
        ibdata.split(many.path, **call)
    assert line in str(error.value)
    assert contents(many.path) == before
