"""The list of the experiments that come with ibdata."""

from __future__ import annotations

import pytest

from ibdata.experiment import load
from ibdata.experiment.catalogue import catalogue, description
from ibdata.experiment.shipped import shipped, suites


def test_every_shipped_experiment_is_listed():
    found = {each.name: each for each in catalogue()}
    assert set(found) == {*shipped(), *(f"{suite}/" for suite in suites())}
    assert found["random"].rows == 10_000
    assert found["siemens-offline/"].rows == 16 * load("siemens-offline/bad-0").rows
    assert found["siemens-offline/"].description == "A folder of 16 experiments."


@pytest.mark.parametrize("name", shipped())
def test_the_first_line_of_the_comment_is_a_sentence(name):
    said = description(shipped()[name])
    assert said[0].isupper()
    assert said.endswith(".")
    assert len(said) <= 120
