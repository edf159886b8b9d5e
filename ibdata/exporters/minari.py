"""A Minari dataset in `--out`/NAMESPACE/NAME-vN. `--out` is Minari's root (MINARI_DATASETS_PATH), and
NAMESPACE/NAME-vN is `--id`, by default ibdata/<name>-v0. It is stored as HDF5, because Minari's Arrow and
Parquet corrupt episodes of 32,768 steps or more. An episode of T steps has T + 1 observations, in float32.
Its `infos` hold latent state and action_log_prob, T + 1 values each; the last value is NaN unless the dataset
has it (`latent: next`). Episodes have no seed, because no `reset(seed=…)` plays one again. `ref_min_score`
and `ref_max_score` are the mean returns of `random` and `optimized` over the dataset's setpoints, for
`minari.get_normalized_score`; there are none where `ibdata info` gives no score. `recover_environment()`
makes the environment of episodes at one setpoint and of one length; for others there is none. HDF5 needs
about 30 kB of memory per episode. Needs ibdata[minari].
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from ibdata._numerics.arrays import Arrays
from ibdata.dataset.reference_returns import scale_of
from ibdata.errors import OUT, UsageError, parameter
from ibdata.exporters._source import Source
from ibdata.exporters._target import hdf5_file, library
from ibdata.plan.dataset_spec import declared_spec
from ibdata.version import __version__

ID = re.compile(r"([\w-][\w/-]*[\w-]/)?[\w-]+-v[0-9]+")  # the ids that Minari accepts, if they have a version
HOLDS_COSTS = True  # it has a place for them
ENVIRONMENT = "ibdata/IndustrialBenchmark-v0"
ENTRY_POINT = "ibdata.environment:IndustrialBenchmarkEnv"  # text: Minari cannot store a class

FILE = "main_data.hdf5"


def place(source: Source, out: Path, id: str | None = None) -> Path:
    """The dataset's folder below the root. Raises UsageError for an id or root that Minari refuses."""
    name = Path(_id(source, id))
    for folder in (out, *(out / parent for parent in name.parents)):
        if (folder / "data").exists() or "data" in name.parts[:-1]:
            raise UsageError(
                f"{folder}: found a folder named data in it, which Minari would take for a dataset's; "
                f"choose another {OUT} or {parameter('id')}"
            )
    return out / name


def episode(block: Arrays) -> dict[str, Any]:
    """The arrays of an episode of T steps: T + 1 observations (k · history) and infos (1), T of the rest."""
    infos: Arrays = {}
    extras = {name.removeprefix("infos/"): array for name, array in block.items() if "/" in name}
    if "costs" in block:
        extras["cost"] = block["costs"]
    for name, values in extras.items():
        if not name.startswith("next_"):
            last = extras.get(f"next_{name}", np.array([np.nan], np.float32))[-1:]
            infos[name] = np.concatenate([values, last])[:, None]  # Minari's Arrow cannot read (T + 1,) again
    return {
        "observations": np.concatenate([block["observations"], block["next_observations"][-1:]]),
        "actions": block["actions"],
        "rewards": block["rewards"],
        "terminations": block["terminated"],
        "truncations": block["truncated"],
        "infos": infos,
    }


def export(source: Source, path: Path, target: Path, id: str | None = None) -> str:
    """Write the dataset: the metadata with Minari, and the episodes as it does."""
    library("minari", "minari", "minari")
    library("h5py", "minari", "minari")
    library("PIL", "minari", "minari", "pillow")  # Minari imports it, but does not require it
    from minari.dataset.minari_storage import MinariStorage

    name = _id(source, id)
    path.mkdir()
    data = path.absolute() / "data"  # Minari fails at relative paths when it adds up sizes
    environment = _environment(source)
    made = environment.make()  # whose spaces are those of every setpoint
    is_of_all = len(source.setpoints) == 1 and source.table["length"].nunique() == 1
    storage = MinariStorage.new(
        data,
        made.observation_space,
        made.action_space,
        environment if is_of_all else None,
        data_format="hdf5",
    )
    storage.update_metadata({**_metadata(source, name), **_references(source)})
    with hdf5_file(data / FILE, track_order=True) as (file, check):
        for number, block in enumerate(source.episode_blocks()):
            group = file.create_group(f"episode_{number}")
            group.attrs["id"], group.attrs["total_steps"] = number, len(block["rewards"])
            _fill(group, episode(block))
            check()
    sizes = {
        "total_steps": source.rows,
        "total_episodes": source.episodes,
        "dataset_size": storage.get_size(),
    }
    storage.update_metadata(sizes)
    root = target.parents[len(Path(name).parts) - 1]
    return f"""\
import os

os.environ["MINARI_DATASETS_PATH"] = {str(root.absolute())!r}
import minari

dataset = minari.load_dataset({name!r})
"""


def _fill(group: Any, arrays: dict[str, Any]) -> None:
    """Write the arrays of an episode as Minari's own storage does."""
    for name, values in arrays.items():
        if isinstance(values, dict):
            _fill(group.create_group(name), values)
        else:
            group.create_dataset(name, data=values, chunks=True, maxshape=(None, *values.shape[1:]))


def _id(source: Source, id: str | None) -> str:
    name = id if id is not None else f"ibdata/{source.info.name}-v0"
    if not ID.fullmatch(name) or "//" in name:
        raise UsageError(
            f"id: found {name!r}, expected NAMESPACE/NAME-vN of letters, digits, _ and -, "
            "with a namespace of two characters or more; choose another"
        )
    return name


def _environment(source: Source) -> Any:
    """The environment at the first setpoint of the episodes, with their dynamics, start, view and steps."""
    from gymnasium.envs.registration import EnvSpec

    plain = declared_spec(source.selection.stored).experiments[0].plain()
    first = source.setpoints[0]
    kwargs: dict[str, Any] = {"setpoint": {"drifting": first} if source.info.drifting else first}
    kwargs |= {"history": source.history, "dynamics": plain["dynamics"], "start": plain["start"]}
    if shown := source.options.changed():
        kwargs["view"] = shown
    steps = int(source.table["length"].iloc[0])
    return EnvSpec(ENVIRONMENT, entry_point=ENTRY_POINT, max_episode_steps=steps, kwargs=kwargs)


def _metadata(source: Source, name: str) -> dict[str, Any]:
    from minari import __version__ as minari_version

    root = source.selection.content_root
    return {
        "dataset_id": name,
        "minari_version": minari_version,
        "algorithm_name": ", ".join(sorted(source.table["policy"].unique())),
        "description": f"Industrial Benchmark, {source.info.name}, content root {root}",
        "requirements": [f"ibdata>={__version__}"],
        "view": json.dumps(source.plain()),
    }


def _references(source: Source) -> dict[str, float]:
    """The returns that `minari.get_normalized_score` takes for 0 and 1, scaled as the rewards are.

    They are means over the setpoints. There are none for other rewards than the classic one, for episodes of
    different lengths or unequal numbers of them at the setpoints, and where the scale has no such episodes.
    """
    lengths = source.table["length"].unique().tolist()
    unequal = source.table["setpoint"].value_counts().nunique() > 1
    if source.options.reward.kind != "classic" or source.left_out or len(lengths) > 1 or unequal:
        return {}
    scale = scale_of(source.info, lengths[0])
    ends = scale.ends(source.setpoints) if scale else None
    if ends is None:
        return {}
    low, high = ends
    return {
        "ref_min_score": low * source.options.reward_scale,
        "ref_max_score": high * source.options.reward_scale,
    }
