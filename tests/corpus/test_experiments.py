"""Many generated experiments: valid ones are read back unchanged, others give one line of error."""

import copy
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ibdata.errors import ConfigError, UsageError, printable
from ibdata.experiment import as_yaml, load

pytestmark = pytest.mark.corpus


def examples(count: int) -> settings:
    """So many examples, the same ones every time."""
    fixture = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    return settings(derandomize=True, deadline=None, max_examples=count, suppress_health_check=fixture)


def normal(x: float) -> bool:
    """Whether a value stays what it is where processors take denormal numbers of float32 for 0."""
    return x == 0.0 or abs(x) >= float(np.finfo(np.float32).tiny)


NAMES = st.from_regex(r"[a-z][a-z0-9_-]{0,12}", fullmatch=True).filter(
    lambda name: name[:3] not in ("con", "prn", "aux", "nul", "com", "lpt") and name != "default"
)
PLACES = st.floats(0, 100).filter(normal) | st.integers(0, 100)
PLACE_LISTS = st.lists(PLACES, min_size=1, max_size=4, unique_by=float)
SETPOINTS = st.one_of(
    PLACES,
    st.just("drifting"),
    PLACE_LISTS,
    st.builds(lambda x: {"drifting": x}, PLACES | PLACE_LISTS),
    st.builds(
        lambda a, b, step: {"start": min(a, b), "stop": max(a, b), "step": step},
        *(st.integers(0, 100), st.integers(0, 100), st.sampled_from([0.5, 1, 7, 30.25])),
    ),
)
ACTION = st.tuples(*[st.floats(-1, 1).filter(normal)] * 3).map(list)
POLICIES = st.lists(
    st.sampled_from([{"kind": "random"}, {"kind": "safe"}])
    | st.builds(lambda a, n: {"kind": "constant", "action": a, "name": n}, ACTION, NAMES),
    min_size=1,
    max_size=3,
    unique_by=lambda policy: (policy["kind"], *[x + 0.0 for x in policy.get("action", [])]),
)
DYNAMICS = st.sampled_from(["siemens", "paper"]) | st.builds(
    lambda base, eta: {"base": base, "eta_mean": eta},
    st.sampled_from(["siemens", "paper"]),
    st.floats(0.01, 1),
)
VALID = st.fixed_dictionaries(
    {"name": NAMES, "setpoints": SETPOINTS, "policies": POLICIES},
    optional={
        "version": st.just(1),
        "dynamics": DYNAMICS,
        "episodes": st.integers(1, 2**20),
        "steps": st.integers(1, 2**20) | st.just(1e3),
        "start": st.sampled_from(["default", "uniform"])
        | st.builds(lambda a, b: {"burn_in": sorted([a, b])}, st.integers(0, 9), st.integers(0, 9)),
        "seed": st.integers(0, 2**64 - 1),
        "output": st.fixed_dictionaries(
            {},
            optional={
                "dtype": st.sampled_from(["float32", "float64"]),
                "latent": st.sampled_from([True, False, "full", "next"]),
                "shard_rows": st.just(10**8),
            },
        ),
        "splits": st.dictionaries(NAMES, st.just({"overlap": True}), max_size=2),
    },
)
WORDS = ["setpoints", "steps", "kind", "random", "drifting", "paper", "splits", "true", "no", "<<"]
VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.floats()
    | st.text(max_size=6)
    | st.sampled_from(WORDS),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(WORDS) | st.text(max_size=4), inner)
    ),
    max_leaves=6,
)


def lines_of(error: UsageError) -> list[str]:
    """The lines of an error, each without anything that could forge another or colour the terminal."""
    if not isinstance(error, ConfigError):
        return [printable(str(error))]  # as the command line shows it
    assert error.problems
    assert all(line.isprintable() for line in error.problems), error.problems
    return list(error.problems)


@pytest.fixture
def file(tmp_path) -> Path:
    return tmp_path / "x.yaml"


def paths(data, prefix=()):
    """Every place of plain data but the top."""
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield (*prefix, key)
        yield from paths(value, (*prefix, key))


@examples(300)
@given(plain=VALID)
def test_a_valid_experiment_comes_back_from_its_own_yaml(file, plain):
    file.write_text(json.dumps(plain, ensure_ascii=False))
    experiment = load(file)
    file.write_bytes(as_yaml(experiment))
    again = load(file)
    assert again == experiment
    assert as_yaml(again) == as_yaml(experiment)
    assert [cell.digest for cell in again.cells] == [cell.digest for cell in experiment.cells]


@examples(450)
@given(plain=VALID, data=st.data())
def test_one_wrong_value_is_named_or_is_valid(file, plain, data):
    where = data.draw(st.sampled_from(list(paths(plain))))
    changed = copy.deepcopy(plain)
    part = changed
    for key in where[:-1]:
        part = part[key]
    part[where[-1]] = data.draw(VALUES)
    file.write_text(json.dumps(changed, ensure_ascii=False))
    try:
        load(file)
    except ConfigError as error:
        for line in lines_of(error):
            assert line.startswith(f"{file}:1:")
            # What was changed, or another option that does not fit it any more.
            said = line.removeprefix(f"{file}:1:").split(": ")[1]
            strict = ("found", "not valid YAML") if not said.split(".")[0].isidentifier() else ()
            assert said.split(".")[0] in (where[0], "splits", "output") or said.startswith(strict), line
