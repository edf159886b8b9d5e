"""The matrix as a fixture: all rows start together, and each test waits for its own."""

from pathlib import Path

import pytest
from ruamel.yaml import YAML
from same_bits.matrix import SIZE, UNMODIFIED, Matrix, Row

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def matrix(request, tmp_path_factory):
    """All rows of the tests that run, begun at once."""
    made = Matrix(tmp_path_factory.mktemp("same-bits"))
    if not hasattr(request.config, "workerinput"):
        params = [item.callspec.params for item in request.session.items if hasattr(item, "callspec")]
        made.start(given["row"] for given in params if isinstance(given.get("row"), Row))
    yield made
    made.pool.shutdown(cancel_futures=True)


@pytest.fixture(scope="session")
def unmodified(matrix):
    """What a child prints in which nothing is changed."""
    return matrix.result(UNMODIFIED)


@pytest.fixture(scope="session")
def golden():
    return YAML(typ="safe", pure=True).load(HERE / "golden.yaml")


@pytest.fixture(scope="session")
def check(golden, unmodified):
    """Check a child's roots against the golden ones, and its files where the same pyarrow wrote them."""

    def same(result, row):
        found = {name: made["root"] for name, made in result["results"].items()}
        assert found == golden["roots"][row.size]
        assert {made["reproducible"] for made in result["results"].values()} == {True}
        usual = "shards" not in row.spec and result["versions"]["pyarrow"] == golden["pyarrow"]
        if usual:
            files = {name: made["shards"] for name, made in result["results"].items()}
            assert files == golden["shards"][row.size]
        if usual and row.size == SIZE:
            for name, made in result["results"].items():
                assert made["files"] == unmodified["results"][name]["files"]

    return same
