"""A Minari dataset in `--out`/NAMESPACE/NAME-vN. `--out` is Minari's root (MINARI_DATASETS_PATH), and
NAMESPACE/NAME-vN is `--id`, by default ibdata/<name>-v0. It is stored as HDF5, because Minari's Arrow and
Parquet corrupt episodes of 32,768 steps or more. An episode of T steps has T + 1 observations, in float32.
Its `infos` hold latent state and action_log_prob, T + 1 values each; the last value is NaN unless the dataset
has it (`latent: next`). The metadata of each episode have the dataset's seed. `ref_min_score` and
`ref_max_score` are the mean returns of `random` and `optimized` over the dataset's setpoints, for
`minari.get_normalized_score`; there are none where `ibdata info` gives no score. HDF5 needs about 30 kB of
memory per episode. Needs ibdata[minari].
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ibdata.dataset import reference_returns
from ibdata.errors import DatasetError, UsageError
from ibdata.experiment.dataset_spec import spec_in
from ibdata.exporters._arrays import same
from ibdata.exporters._target import differs, needed, reserve
from ibdata.exporters._view import Array, Arrays, Block, View
from ibdata.version import __version__
from ibdata.views.options import ACTIONS, bounds_of

if TYPE_CHECKING:
    import pandas as pd

Common = Callable[[str], Any]
ID = re.compile(r"([\w-][\w/-]*[\w-]/)?[\w-]+-v[0-9]+")  # the ids that Minari accepts, if they have a version
ENVIRONMENT = "ibdata/IndustrialBenchmark-v0"
ENTRY_POINT = "ibdata.environment:IndustrialBenchmarkEnv"  # text: Minari cannot store a class

OVERHEAD = 100_000  # bytes per episode, for its chunks; 55 to 75 kB were measured


def place(view: View, out: Path, id: str | None = None) -> Path:
    """The dataset's folder below the root. Raises UsageError for an id or root that Minari refuses."""
    name = Path(_id(view, id))
    for folder in (out, *(out / parent for parent in name.parents)):
        if (folder / "data").exists() or "data" in name.parts[:-1]:
            raise UsageError(
                f"{folder}: found a folder named data in it, which Minari would take for a dataset's; "
                "choose another --out or --id"
            )
    return out / name


def episode(block: Block) -> dict[str, Any]:
    """The arrays of an episode of T steps: T + 1 observations (k · history) and infos (1), T of the rest."""
    return {
        "observations": np.concatenate([block.observations, block.next_observations[-1:]]),
        "actions": block.actions,
        "rewards": block.rewards,
        "terminations": block.terminated,
        "truncations": block.truncated,
        "infos": dict(_infos(block.extras)),
    }


def export(view: View, path: Path, target: Path, id: str | None = None) -> str:
    """Write the dataset with Minari."""
    needed("minari", "minari", "minari")
    needed("h5py", "minari", "minari")
    needed("PIL", "minari", "minari", "pillow")  # Minari imports it, but does not require it
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

    name = _id(view, id)
    path.mkdir()
    reserve(path / "room", view.bytes + OVERHEAD * (view.episodes + 1))
    data = path.absolute() / "data"  # Minari fails at relative paths when it adds up sizes
    observations, actions = _spaces(view)
    episodes = view.described()
    common = _common(view, episodes)
    environment = _environment(view, episodes, common)
    storage = MinariStorage.new(data, observations, actions, environment, data_format="hdf5")
    storage.update_metadata({**_metadata(view, episodes, name), **_references(view, episodes)})
    seed = common("seed")
    storage.update_episodes(EpisodeBuffer(seed=seed, **one) for one in _episodes(view, "write"))
    root = target.parents[len(Path(name).parts) - 1]
    return f"""\
import os

os.environ["MINARI_DATASETS_PATH"] = {str(root.absolute())!r}
import minari

dataset = minari.load_dataset({name!r})
"""


def _id(view: View, id: str | None) -> str:
    name = id if id is not None else f"ibdata/{view.dataset.info_model.name}-v0"
    if not ID.fullmatch(name) or "//" in name:
        raise UsageError(
            f"id: found {name!r}, expected NAMESPACE/NAME-vN of letters, digits, _ and -, "
            "with a namespace of two characters or more; choose one with --id"
        )
    return name


def _episodes(view: View, what: str) -> Iterator[dict[str, Any]]:
    for block in view.blocks(what):
        yield from map(episode, block.split())


def _infos(extras: Arrays) -> Iterator[tuple[str, Array]]:
    """Each info at t = 0 … T, (T + 1, 1): Minari's Arrow cannot read (T + 1,) again."""
    for name, values in extras.items():
        if not name.startswith("next_"):
            end = extras[f"next_{name}"][-1:] if f"next_{name}" in extras else np.array([np.nan], np.float32)
            yield name, np.concatenate([values, end])[:, None]


def _spaces(view: View) -> tuple[Any, Any]:
    """Boxes with the bounds of the columns."""
    from gymnasium.spaces import Box

    def box(pairs: list[tuple[float | None, float | None]]) -> Any:
        low = [-np.inf if low is None else low for low, _ in pairs]
        high = [np.inf if high is None else high for _, high in pairs]
        return Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)

    bounds = bounds_of(view.options, view.dataset.info_model.drifting)
    return box(bounds * view.history), box([(-1.0, 1.0)] * len(ACTIONS))


def _environment(view: View, episodes: pd.DataFrame, common: Common) -> Any:
    """The environment for `recover_environment`, with the dynamics, start and observations of the episodes.

    It has their setpoint, if there is only one. It is None if no environment is that of all episodes.
    """
    from gymnasium.envs.registration import EnvSpec

    if None in map(common, ("dynamics", "start")):
        return None
    setpoints = episodes["setpoint"].unique().tolist()
    options = view.options
    kwargs: dict[str, Any] = {"history": view.history, "reward_scale": view.reward_scale}
    if not options.is_classic:
        kwargs |= {"observe": options.observe, "actions": options.actions}
        kwargs |= {"imperfections": options.imperfections.plain() or None}
    if options.reward.kind != "classic":
        kwargs["reward"] = options.reward.plain()
    kwargs |= {key: common(key) for key in ("dynamics", "start")}
    if view.dataset.info_model.drifting:
        kwargs["setpoint"] = {"drifting": setpoints[0]} if len(setpoints) == 1 else "drifting"
    elif len(setpoints) == 1:
        kwargs["setpoint"] = setpoints[0]
    return EnvSpec(ENVIRONMENT, entry_point=ENTRY_POINT, max_episode_steps=common("steps"), kwargs=kwargs)


def _common(view: View, episodes: pd.DataFrame) -> Common:
    """A function that returns an option of the episodes' experiments, or None if they differ in it."""
    experiments = spec_in(view.dataset, view.dataset.manifest_model).experiments
    stops = np.cumsum([len(experiment.cells) * experiment.episodes for experiment in experiments])
    numbers = np.unique(np.searchsorted(stops, episodes.index, side="right"))
    chosen = [experiments[i].plain() for i in numbers]

    def common(key: str) -> Any:
        first, *others = (experiment[key] for experiment in chosen)
        return first if all(other == first for other in others) else None

    return common


def _metadata(view: View, episodes: pd.DataFrame, name: str) -> Mapping[str, Any]:
    from minari import __version__ as minari_version

    source, root = view.dataset.info_model.name, view.dataset.content_root
    return {
        "dataset_id": name,
        "minari_version": minari_version,
        "algorithm_name": ", ".join(sorted(episodes["policy"].unique())),
        "description": f"Industrial Benchmark, {source}, content root {root}",
        "requirements": [f"ibdata>={__version__}"],
        "view": json.dumps(view.plain()),
    }


def _references(view: View, episodes: pd.DataFrame) -> dict[str, float]:
    """The returns that `minari.get_normalized_score` takes for 0 and 1, scaled as the rewards are.

    They are means over the setpoints. There are none for other rewards than the classic one, for moving
    setpoints, for episodes of different lengths, and where the scale has no such episodes.
    """
    if view.options.reward.kind != "classic" or view.left_out:
        return {}
    info, lengths = view.dataset.info_model, episodes["length"].unique().tolist()
    if info.drifting or len(lengths) > 1:
        return {}
    scale = reference_returns.scale(info.dynamics, info.start, lengths[0], 1.0)
    ends = scale.ends(episodes["setpoint"].unique().tolist()) if scale else None
    if ends is None:
        return {}
    low, high = ends
    return {"ref_min_score": low * view.reward_scale, "ref_max_score": high * view.reward_scale}


def verify(view: View, path: Path) -> None:
    """Compare what Minari reads with the data; Minari itself checks neither lengths nor bounds."""
    from minari import MinariDataset

    found, (space, _) = MinariDataset(path.absolute() / "data"), _spaces(view)
    if (found.total_episodes, found.total_steps) != (view.episodes, view.rows):
        raise differs(f"{found.spec.data_path}: counts")
    for number, (one, expected) in enumerate(zip(found, _episodes(view, "check"), strict=True)):
        pairs = [(key, getattr(one, key), array) for key, array in expected.items() if key != "infos"]
        pairs += [(key, one.infos[key], array) for key, array in expected["infos"].items()]
        for key, array, wanted in pairs:
            if array.dtype != wanted.dtype or array.shape != wanted.shape or not same(array, wanted):
                raise differs(f"{found.spec.data_path}: episode {number}: {key}")
        if not ((one.observations >= space.low) & (one.observations <= space.high)).all():
            raise DatasetError(f"{view.dataset.place}: found observations out of bounds, see ibdata validate")
