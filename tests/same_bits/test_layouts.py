"""Workers, blocks and shards do not change the content or the files."""

import itertools
import os
from collections import defaultdict

import pytest
from same_bits.matrix import Row

pytestmark = pytest.mark.same_bits

WORKERS = (1, 2, 5)
BLOCKS = ((1, 1), (3, 7), (256, 256), (1024, 1000))  # lanes, chunk
SHARDS = (None, 1, 1e9)  # usual; one a dataset; one an episode
FEW = (  # every value of each
    (1, BLOCKS[1], 1),
    (1, BLOCKS[3], None),
    (2, BLOCKS[0], 1),
    (2, BLOCKS[3], 1e9),
    (5, BLOCKS[1], 1e9),
    (5, BLOCKS[2], None),
)


def _row(workers, blocks, shards):
    lanes, chunk = blocks
    spec = {"workers": workers, "lanes": lanes, "chunk": chunk, "expect": {"lanes": lanes, "chunk": chunk}}
    spec |= {"shards": shards} if shards else {}
    cut = f"{shards:g}" if shards else "usual"
    return Row(f"{workers} workers, {lanes} lanes, chunk {chunk}, {cut} shards", spec=spec)


ALL = itertools.product(WORKERS, BLOCKS, SHARDS)
ROWS = [_row(*x) for x in (ALL if os.environ.get("IBDATA_SAME_BITS") == "full" else FEW)]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_how_the_work_is_divided_does_not_change_the_data(row, matrix, check):
    result = matrix.result(row)
    check(result, row)
    assert (result["workers"] > 0) == (row.spec["workers"] > 1)


def test_datasets_cut_into_the_same_shards_have_the_same_files(matrix):
    """Those cut in the usual way are held against golden files in every row."""
    made = defaultdict(list)
    for row in ROWS:
        made[row.spec.get("shards")].append(matrix.result(row)["results"])
    assert set(made) == set(SHARDS)
    for results in made.values():
        assert len(results) > 1
        assert all(other == results[0] for other in results)
    counts = [[len(each["shards"]) for each in results[0].values()] for results in made.values()]
    assert len(set(map(str, counts))) == len(SHARDS)
