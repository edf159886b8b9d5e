"""Validation finds rows that a forger changed, who corrects all hashes; tests/corpus forges metadata."""

import hashlib
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import AS_WRITTEN
from helpers.folders import seal

from ibdata._system.files import FileEntry
from ibdata._system.storage import Storage
from ibdata.dataset import manifest, parquet
from ibdata.dataset.stored import Stored
from ibdata.generation.finish import finish
from ibdata.generation.metadata import as_json
from ibdata.generation.pieces import stored_pieces
from ibdata.generation.shard import ShardSummarizer, WrittenShard
from ibdata.plan.columns import layout
from ibdata.plan.dataset_spec import spec_in
from ibdata.tools.reproduce import reproduce
from ibdata.tools.validate import validate


def edit(path, change):
    """Change a JSON file."""
    found = json.loads(path.read_bytes())
    change(found)
    path.write_bytes(as_json(found))


def summary_of(spec, shard, folder, path):
    """The summary of the rows of a shard's file."""
    experiment = spec.experiments[shard.experiment]
    rows = (shard.stop - shard.first) * experiment.steps
    batches = parquet.batches(Storage(folder), path, layout(experiment).names, 65_536, rows)
    summarizer = ShardSummarizer(spec, shard)
    for piece in stored_pieces(spec, shard, batches):
        summarizer.add(piece)
    return summarizer.summary()


def moved(stats, share):
    """Move a quantile by a share of the distance from the least to the greatest value."""
    reward = stats["all"]["reward"]
    reward["quantiles"]["0.5"] += share * (reward["max"] - reward["min"])


def test_metadata_of_another_form_are_named(copied):
    (copied / manifest.CROISSANT).write_text("[1]")
    seal(copied)
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == (manifest.CROISSANT, "metadata")


# --- rows


def forge(folder, change):
    """Change the rows of every shard, and make everything else of the dataset again for them."""
    stored = Stored.open(folder)
    listed, spec = stored.manifest, spec_in(stored)
    written = []
    for shard, one in zip(spec.shards, listed.shards, strict=True):
        path = folder / one.path
        table = pq.read_table(path)
        columns = {name: table[name].to_numpy() for name in table.column_names if name != "policy"}
        change(columns)
        for i, field in enumerate(table.schema):
            if field.name != "policy":
                table = table.set_column(i, field, pa.array(columns[field.name], field.type))
        pq.write_table(table, path, **AS_WRITTEN)
        data = path.read_bytes()
        entry = FileEntry(one.path, len(data), hashlib.sha256(data).hexdigest())
        written.append(WrittenShard(shard, entry, summary_of(spec, shard, folder, entry.path)))
    for path, document in finish(spec, written, True, clipped=listed.clipped_actions):
        (folder / path).write_bytes(document)


def swap(columns, a, b):
    columns[a], columns[b] = columns[b], columns[a]


ACTIONS = ("act_velocity", "act_gain", "act_shift")
ROWS = {
    "operational costs swapped": (lambda c: swap(c, "latent_theta_3", "latent_theta_4"), "shift register"),
    "actions negated": (lambda c: c.update({name: -c[name] for name in ACTIONS}), "steering"),
    "density 50": (lambda c: c.update(action_log_prob=np.full_like(c["action_log_prob"], 50)), "density"),
    "hidden values swapped": (lambda c: swap(c, "latent_mu_v", "latent_mu_g"), None),
    "setpoint after": (lambda c: c.update(next_obs_setpoint=c["next_obs_setpoint"] + 1), "setpoint"),
}


@pytest.mark.parametrize(("change", "rule"), ROWS.values(), ids=ROWS)
def test_forged_rows_break_a_rule_and_are_not_reproduced(copied, change, rule):
    forge(copied, change)
    assert rule is None or rule in {problem.rule for problem in validate(copied)}
    assert len(reproduce(copied)[1]) == 12


def test_the_number_of_clipped_actions_is_made_again(copied):
    seal(copied, lambda listed: listed.update(clipped_actions=1))
    assert validate(copied) == []
    _, (problem,) = reproduce(copied)
    assert problem.message == "clipped_actions: found 1, expected 14"
    assert reproduce(copied, episodes=2)[1] == []


# --- what is no forgery


def backwards(data):
    """JSON data with the keys of all objects in the opposite order."""
    if isinstance(data, dict):
        return {key: backwards(value) for key, value in reversed(data.items())}
    return [backwards(value) for value in data] if isinstance(data, list) else data


def test_values_count_and_not_how_they_are_written(copied):
    for path in copied.glob("meta/*.json"):
        path.write_text(json.dumps(backwards(json.loads(path.read_bytes()))))
    words = "as a later version may say it"
    edit(copied / "meta/dataset.json", lambda info: info["columns"][0].update(description=words))
    edit(copied / "meta/statistics.json", lambda stats: moved(stats, 0.009))  # the next value of the sample
    experiment = copied / "meta/experiment.yaml"
    experiment.write_text(experiment.read_text() + "# a remark\n")
    episodes = copied / "meta/episodes.table"
    pq.write_table(pq.read_table(episodes), episodes, compression="snappy", write_page_index=True)
    for shard in (copied / "data").iterdir():
        pq.write_table(pq.read_table(shard), shard, compression="zstd", row_group_size=7)
    seal(copied, lambda listed: listed.update(versions={}))
    listed = copied / manifest.PATH
    listed.write_text(json.dumps(backwards(json.loads(listed.read_bytes()))))
    assert validate(copied) == []
    edit(copied / "meta/statistics.json", lambda stats: moved(stats, 0.002))
    seal(copied)
    assert [problem.path for problem in validate(copied)] == ["meta/statistics.json"]
