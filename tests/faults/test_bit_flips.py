"""Every change of a byte, and every truncation, is found and named."""

import json
from itertools import product

import pyarrow.parquet as pq
import pytest

from ibdata.validation.validate import validate

pytestmark = pytest.mark.faults


@pytest.fixture
def dataset(forks, tools):
    """A small dataset of two shards, with a split."""
    out = tools.where / "out"
    answer = forks.run(*tools.args(tools.tiny, out, "--set", "splits={low: {setpoint: 10}}"))
    assert answer.code == 0, answer
    return out


def files_of(folder):
    """The dataset's files, but the card, which is the user's to edit."""
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "README.md")


def same_values(path, changed, whole):
    """Whether a change of a file that has no hash leaves its values, as a cut of the last newline does."""
    if path.name not in ("manifest.json", "splits.json"):
        return False
    try:
        return json.loads(changed) == json.loads(whole)
    except ValueError:
        return False


def missed(folder, path, changes, ways=(True, False)):
    """The changes of a file by which validating does not name it; ways are quick or not."""
    whole, name, found = path.read_bytes(), str(path.relative_to(folder)), []
    for what, changed in changes(whole):
        if not same_values(path, changed, whole):
            path.write_bytes(changed)
            quietly = [quick for quick in ways if name not in {p.path for p in validate(folder, quick)}]
            found += [f"{name}: {what}: quick={quick}" for quick in quietly]
    path.write_bytes(whole)
    return found


def flipped(whole, place, bit):
    return f"byte {place}, bit {bit}", whole[:place] + bytes([whole[place] ^ 1 << bit]) + whole[place + 1 :]


def test_every_flipped_bit_is_found_and_its_file_named(tools, dataset):
    files, wrong = files_of(dataset), []
    sizes = [path.stat().st_size for path in files]

    def one(whole):
        yield flipped(whole, tools.random.randrange(len(whole)), tools.random.randrange(8))

    for path in [*files, *tools.random.choices(files, sizes, k=tools.size(200, 1000) - len(files))]:
        wrong += missed(dataset, path, one)
    assert not wrong, "\n".join(wrong)
    assert tools.root(dataset)


def test_every_flipped_bit_of_the_manifest_is_found(tools, dataset):
    def some(whole):
        places = range(len(whole))
        chosen = places if tools.full else tools.random.sample(places, 150)
        return (flipped(whole, place, bit) for place, bit in product(chosen, range(8)))

    wrong = missed(dataset, dataset / "meta" / "manifest.json", some, ways=[True])
    assert not wrong, "\n".join(wrong)


def boundaries(path):
    """Where row groups, column chunks and their pages begin or end."""
    found, metadata = set(), pq.read_metadata(path)
    for group, column in product(range(metadata.num_row_groups), range(metadata.num_columns)):
        chunk = metadata.row_group(group).column(column)
        starts = [chunk.data_page_offset, chunk.dictionary_page_offset or chunk.data_page_offset]
        found |= {*starts, min(starts) + chunk.total_compressed_size}
    return found


def test_every_truncation_is_found_and_its_file_named(tools, dataset):
    wrong = []
    for path in files_of(dataset):
        inner = boundaries(path) if path.suffix == ".parquet" else set()

        def cuts(whole, inner=inner):
            n = len(whole)
            drawn = {tools.random.randrange(n) for _ in range(tools.size(5, 200))}
            lengths = inner | drawn | {0, 1, 4, n // 2, n - 8, n - 4, n - 1}
            return ((f"{length} bytes", whole[:length]) for length in sorted(lengths & set(range(n))))

        wrong += missed(dataset, path, cuts)
    assert not wrong, "\n".join(wrong)
