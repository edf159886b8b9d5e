"""Experiments whose shards have one episode each, for tests of whole runs."""

from ibdata.experiment import Experiment

FOUR_SHARDS = Experiment.model_validate(
    {
        "name": "tiny",
        "setpoints": [20.0, 70.0],
        "policies": [{"kind": "random"}],
        "episodes": 2,
        "steps": 5,
        "output": {"shard_rows": 5},
    }
)
TEN_SHARDS = FOUR_SHARDS.model_copy(update={"episodes": 5})
