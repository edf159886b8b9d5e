"""Validation finds changes by a forger who corrects all hashes."""

import hashlib
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import AS_WRITTEN
from helpers.folders import seal

import ibdata
from ibdata._system.files import FileEntry
from ibdata._system.storage import Storage
from ibdata.dataset import manifest, parquet
from ibdata.dataset.stored import Stored
from ibdata.errors import DatasetError
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


def column(info, name):
    return next(column for column in info["columns"] if column["name"] == name)


def moved(stats, share):
    """Move a quantile by a share of the distance from the least to the greatest value."""
    reward = stats["all"]["reward"]
    reward["quantiles"]["0.5"] += share * (reward["max"] - reward["min"])


JSON = {  # changes of values that follow from the experiment or the rows, by the file
    "role": ("dataset", lambda i: column(i, "next_obs_gain").update(role="latent")),
    "bound": ("dataset", lambda i: column(i, "obs_gain").update(high=None)),
    "dynamics": ("dataset", lambda i: i.update(dynamics="paper")),
    "rows": ("dataset", lambda i: i["counts"].update(rows=1)),
    "near quantile": ("statistics", lambda s: moved(s, 0.011)),
    "column": ("statistics", lambda s: s["all"].update(more=s["all"]["reward"])),
    "file": ("croissant", lambda c: c["distribution"].pop()),
    "files of a split": ("croissant", lambda c: c["distribution"][2]["includes"].pop()),
    "of a split": ("statistics", lambda s: s["splits"]["source"]["reward"]["quantiles"].update({"0.5": 1e6})),
}


def test_metadata_that_do_not_follow_are_named(copied):
    for name, (file, change) in JSON.items():
        path = copied / f"meta/{file}.json"
        whole = path.read_bytes()
        edit(path, change)
        seal(copied)
        assert {problem.path for problem in validate(copied)} == {f"meta/{file}.json"}, name
        path.write_bytes(whole)


def test_metadata_of_another_form_are_named(copied):
    (copied / manifest.CROISSANT).write_text("[1]")
    seal(copied)
    (problem,) = validate(copied)
    assert (problem.path, problem.rule) == (manifest.CROISSANT, "metadata")


SPLITS = {
    "rows": lambda s: s["source"].update(rows=1),
    "episodes of a later split": lambda s: s["train"].update(runs=[[0, 8]], episodes=8, rows=320),
    "definition of a later split": lambda s: s["train"]["split"].update(setpoint=[70.0]),
    "a declared split that is later": lambda s: s["source"].update(declared=False),
}


def test_splits_that_do_not_follow_are_named(copied):
    ibdata.split(copied, {"train": {"policy": "random"}, "calm": {"policy": "calm"}})
    path = copied / manifest.SPLITS
    whole = path.read_bytes()
    for change in SPLITS.values():
        edit(path, change)
        (problem,) = validate(copied, quick=True)
        assert (problem.path, problem.rule) == (manifest.SPLITS, "splits")
        path.write_bytes(whole)
    assert validate(copied) == []


MANIFEST = {
    "a setpoint less": lambda m: m["experiments"][0].update(setpoints=[20.0], splits={}),
    "clipped actions": lambda m: m.update(clipped_actions=10**9),
    "code": lambda m: m["code"].append({"target": "a:b", "version": None, "sha256": None}),
    "another experiment": lambda m: m["shards"][1].update(experiment=1),
    "other episodes": lambda m: m["shards"][1].update(episodes=[0, 1]),
    "a file that is not listed": lambda m: m["files"].pop(0),
    "content root": lambda m: m.update(content_root="0" * 64),
}


@pytest.mark.parametrize("change", MANIFEST.values(), ids=MANIFEST)
def test_a_manifest_that_does_not_follow_is_named(copied, change):
    seal(copied, change)
    assert manifest.PATH in {problem.path for problem in validate(copied)}


@pytest.mark.parametrize("name", ["a setpoint less", "other episodes"])
def test_a_manifest_with_another_plan_is_not_used(copied, name):
    seal(copied, MANIFEST[name])
    for use in (reproduce, lambda folder: ibdata.split(folder, {"random": {"policy": "random"}})):
        with pytest.raises(DatasetError, match="see ibdata validate"):
            use(copied)


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
