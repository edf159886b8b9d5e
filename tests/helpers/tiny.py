"""Small experiments for tests of whole runs; the shards of the first two have one episode each."""

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
PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 3,
    "steps": 20,
    "output": {"shard_rows": 40},
    "splits": {"source": {"setpoint": 20}},
}
MANY = {  # for splits
    "name": "many",
    "setpoints": [10.0, 30.0, 50.0, 75.0, 90.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 5,
    "steps": 4,
    "output": {"shard_rows": 40},
    "splits": {"low": {"setpoint": [10, 30], "overlap": True}},
}
