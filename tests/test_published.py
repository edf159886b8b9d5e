"""The classes of the published package: traps, state, Gymnasium's interface, and what they refuse.

Their numbers are compared with the package's in tests/reference/test_old_scripts.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from ibdata import published
from ibdata.published import IDS, IBGym

NOTHING = (0.0, 0.0, 0.0)

pytestmark = pytest.mark.usefixtures("global_generator")


# The last rows of test_data/markovStates0.csv and 9 in the authors' repository, siemens/industrialbenchmark
# fe844f0, by setpoint and seed of their own test.
STORED_KEYS = "hg hv he ge ve MC c v g h f fb oc reward"
STORED = {
    (88, 1005): """
        0.2529337718054738 0.1561980840334950 -1.431526284003990 0.1197240362919674 0.1412943599053498
        -1.067597830483195 241.1964982555204 47.96409606877143 77.59007209308537 36.56947431992021
        9.537158523634544 28.07971400109189 182.5600942953580 -269.8079738264240
    """,
    (69, 1014): """
        1.156309107389090 0.02830878833329135 -0.6535271919207417 0.8019279619882091 0.02830878833329135
        -0.2511752196979196 164.9823916637220 87.05069120817244 9.231496457707077 44.52945616158517
        35.65646871564321 55.19600826740088 134.4060058200222 -271.9517978106516
    """,
}


@pytest.mark.parametrize(("setpoint", "seed"), STORED)
def test_the_last_row_of_the_authors_own_test(setpoint, seed):
    ids = IDS(setpoint, inital_seed=seed)
    for _ in range(1000):
        ids.step(2 * np.random.rand(3) - 1)  # noqa: NPY002
    expected = [float(number) for number in STORED[setpoint, seed].split()]
    assert [ids.state[key] for key in STORED_KEYS.split()] == pytest.approx(expected, rel=1e-13, abs=1e-14)
    assert [ids.state[key] for key in ("gs_domain", "gs_sys_response", "gs_phi_idx")] == [-1, -1, 6]


def test_a_state_that_a_script_writes_is_continued():
    ids = IDS(p=30, inital_seed=1)
    ids.state.update(v=10.0, g=95.0, h=0.0, hv=4.9, gs_phi_idx=-6)
    costs, ids.state["o"][:] = ids.state["o"], 7.0
    ids.step([1.0, 1.0, -1.0])
    state = ids.state
    assert (state["p"], state["v"], state["g"], state["h"], state["hv"]) == (30, 11.0, 100.0, 0.0, 5.0)
    assert state["o"] is costs
    assert state["o"].tolist() == [*[7.0] * 9, pytest.approx(math.exp(3.54))]
    assert (state["gs_domain"], state["gs_phi_idx"]) == (-1, -5)  # turned back at -6
    assert state["oc"] == pytest.approx(7.0 * 0.99999)


def test_both_constructors_and_reset_seed_the_global_generator():
    """With None too, so that the seed of a script is lost; and `reset` with a number that was drawn."""
    drawn = []
    for make in (IDS, lambda: IBGym(70)):
        for _ in range(2):
            np.random.seed(0)  # noqa: NPY002
            make()
            drawn.append(np.random.rand())  # noqa: NPY002
    assert len(set(drawn)) == 4
    env = IBGym(70, init_seed=3)
    seed = env.init_seed
    assert 0 <= seed < 100_000
    np.random.rand(9)  # noqa: NPY002
    again = IDS(70, inital_seed=seed).visibleState()[:6]
    assert env.reset().tolist() == again.tolist()


def test_without_gymnasium_all_but_the_spaces_works(monkeypatch):
    monkeypatch.setattr(published, "gymnasium", None)
    env = IBGym(70, init_seed=0)
    env.reset()
    env.step(NOTHING)
    for name in ("action_space", "observation_space"):
        with pytest.raises(ImportError, match=rf"^IBGym.{name} needs the package gymnasium: pip install "):
            getattr(env, name)
    env.close()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: IDS(101), r"state.setpoint: found \[101.\], expected numbers in \[0, 100\]"),
        (lambda: IDS().step([0.0, math.nan, 0.0]), "action: found .* expected finite numbers"),
        (lambda: IDS().step([0.0, 0.0]), r"action: found shape \(1, 2\), expected \(1, 3\)"),
        (lambda: IBGym(70, "clasic"), "^reward_type: found 'clasic', expected classic or delta"),
        (lambda: IBGym(70, action_type="box"), "^action_type: found 'box', expected discrete or cont"),
        (lambda: IBGym(70, observation_type="past"), "^observation_type: found 'past', expected classic or"),
    ],
)
def test_what_cannot_be_meant_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
