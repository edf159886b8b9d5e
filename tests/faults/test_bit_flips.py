"""Every change of a byte, and every truncation, is found and named."""

import json
from itertools import product

import pytest

from ibdata.tools.validate import validate

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


def flipped(whole, place, bit):
    return f"byte {place}, bit {bit}", whole[:place] + bytes([whole[place] ^ 1 << bit]) + whole[place + 1 :]


def missed(folder, path, changes, ways=(True, False)):
    """The changes of a file by which validating does not name it; ways are quick or not."""
    whole, name, found = path.read_bytes(), str(path.relative_to(folder)), []
    plain = name in ("meta/manifest.json", "meta/splits.json")  # no hash: values count
    for what, changed in changes:
        path.write_bytes(changed)
        quietly = [quick for quick in ways if name not in {p.path for p in validate(folder, quick)}]
        if quietly and not (plain and json.loads(changed) == json.loads(whole)):
            found.append(f"{name}: {what}: quick={quietly}")
    path.write_bytes(whole)
    return found


def test_every_flipped_bit_and_truncation_is_found_and_its_file_named(tools, dataset):
    files, wrong, draw = files_of(dataset), [], tools.random.randrange
    sizes = [path.stat().st_size for path in files]
    for path in [*files, *tools.random.choices(files, sizes, k=tools.size(200, 1000) - len(files))]:
        whole = path.read_bytes()
        wrong += missed(dataset, path, [flipped(whole, draw(len(whole)), draw(8))])
    path = dataset / "meta" / "manifest.json"
    whole = path.read_bytes()
    places = range(len(whole)) if tools.full else tools.random.sample(range(len(whole)), 150)
    changes = (flipped(whole, place, bit) for place, bit in product(places, range(8)))
    wrong += missed(dataset, path, changes, ways=[True])
    for path in files:
        whole = path.read_bytes()
        n = len(whole)
        lengths = {0, 1, 4, n // 2, n - 8, n - 4, n - 1, *(draw(n) for _ in range(tools.size(15, 200)))}
        wrong += missed(dataset, path, [(f"{length} bytes", whole[:length]) for length in sorted(lengths)])
    assert not wrong, "\n".join(wrong)
    assert tools.root(dataset)
