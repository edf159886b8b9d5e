#!/usr/bin/env python3
"""Generate the experiments of this folder in one setting, check the setting, and print JSON.

    child.py SPEC    SPEC is JSON: size, folder, and optionally workers, lanes, chunk, shards,
                     known_answer, and expect: facts that must hold here and in every worker process

Each setting is a process of its own, because numpy, numba and the C library read the tested environment
variables when they are loaded. The workers begin with `start` below, and have the same sizes of blocks.
"""

import ctypes
import hashlib
import json
import math
import os
import platform
import re
import struct
import sys
import tempfile
from pathlib import Path

import numba
import numpy as np
import pyarrow as pa
from numpy._core import _multiarray_umath as umath
from ruamel.yaml import YAML

import ibdata
from ibdata._simulation import unroll
from ibdata.experiment import Experiment
from ibdata.generation import process, record
from ibdata.plan import rollout

HERE = Path(__file__).resolve().parent
BEGIN = """\
import sys
sys.path[:] = sys.argv[2:]
import child
child.start()
from ibdata.generation.process import main
main(int(sys.argv[1]))
"""


def experiments(size: str, shards: float = 0) -> list[Experiment]:
    """The experiments in a size; each in about so many shards (0: the usual number)."""
    given = YAML(typ="safe", pure=True).load(HERE / "experiments.yaml")
    made = []
    for plain in given["experiments"]:
        here = {"folder": HERE}
        rows = Experiment.model_validate(plain | given["sizes"][size], context=here).rows
        output = plain["output"] | {"shard_rows": max(1, int(rows / (shards or given["shards"])))}
        changed = plain | given["sizes"][size] | {"output": output}
        made.append(Experiment.model_validate(changed, context=here))
    return made


def core_name() -> str | None:
    """The processor for which the OpenBLAS that numpy brings has chosen its code."""
    libraries = Path(np.__file__).parent.parent / "numpy.libs"
    for path in libraries.glob("libscipy_openblas64_*"):
        name = ctypes.CDLL(str(path)).scipy_openblas_get_corename64_
        name.restype = ctypes.c_char_p
        return str(name().decode())
    return None


@numba.njit(fastmath={"contract"})
def _fused(a, b, out):
    for i in range(len(a)):
        out[i] = a[i] * b[i] + out[i]


def fuses() -> bool:
    """Whether numba's target has fused multiply-add, seen in the machine code of a loop that allows it."""
    _fused(np.ones(8), np.ones(8), np.ones(8))
    return any(x in asm for asm in _fused.inspect_asm().values() for x in ("vfmadd", "fmla", "fmadd"))


def facts() -> dict[str, object]:
    """What a setting is to change, as this process has it."""
    inputs = [i * 0.00137 - 13.0 for i in range(20_000)]
    config = numba.config
    return {
        "machine": platform.machine(),
        "libc exp": hashlib.sha256(struct.pack("<20000d", *map(math.exp, inputs))).hexdigest(),
        "numpy": {
            name: hashlib.sha256(getattr(np, name)(np.array(inputs)).tobytes()).hexdigest()
            for name in ("exp", "tanh")
        },
        "numpy on": [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)],
        "features": {name: bool(on) for name, on in umath.__cpu_features__.items()},
        "blas": core_name(),
        "CPU_NAME": config.CPU_NAME,
        "CPU_FEATURES": config.CPU_FEATURES,
        "DISABLE_JIT": config.DISABLE_JIT,
        "lanes": rollout.LANES,
        "chunk": unroll.BLOCK,
    }


def unmet(expect: dict[str, object], found: dict[str, object]) -> list[str]:
    """The expectations that are not met; `off` lists features that numpy must know and have off."""
    wrong = [
        f"{k}: found {found[k]}, expected {v}" for k, v in expect.items() if k != "off" and found[k] != v
    ]
    features = dict(found["features"])
    return wrong + [
        f"{x}: found {features.get(x)}, expected False"
        for x in expect.get("off", ())
        if features.get(x) is not False
    ]


def made(experiment: Experiment, spec: dict[str, object]) -> dict[str, object]:
    """Generate an experiment; what its manifest says."""
    out = Path(spec["folder"]) / experiment.name
    ibdata.generate(experiment, out, workers=spec.get("workers", 1))
    manifest = json.loads((out / "meta" / "manifest.json").read_bytes())
    files = {file["path"]: file["sha256"] for file in manifest["files"]}
    return {
        "root": manifest["content_root"],
        "reproducible": manifest["reproducible"],
        "shards": [files.pop(shard["path"]) for shard in manifest["shards"]],
        "files": {path: without_tokens(out / path) for path in files},
    }


def without_tokens(path: Path) -> str:
    """SHA-256 of a file without the random digits that end the names of shards in it."""
    return hashlib.sha256(re.sub(rb"(part-[0-9]{5})-[0-9a-f]{16}", rb"\1", path.read_bytes())).hexdigest()


def main(spec: dict[str, object]) -> None:
    """Check the setting, generate, and print results, facts and versions."""
    prepare(spec)
    process.BEGIN = BEGIN
    found = facts()
    if not numba.config.DISABLE_JIT:
        found["fuses"] = fuses()
    wrong = unmet(spec.get("expect", {}), found)
    assert not wrong, wrong
    if "known_answer" in spec:
        record.KNOWN_ANSWER = spec["known_answer"]
    with tempfile.TemporaryDirectory(dir=spec["folder"]) as notes:
        os.environ |= {"SAME_BITS_NOTES": notes, "SAME_BITS_SPEC": json.dumps(spec)}
        results = {e.name: made(e, spec) for e in experiments(spec["size"], spec.get("shards", 0))}
        others = [json.loads(path.read_bytes()) for path in Path(notes).glob("*.json")]
    assert bool(others) == (spec.get("workers", 1) > 1)
    wrong = [x for other in others for x in unmet(spec.get("expect", {}), other)]
    assert not wrong, wrong
    json.dump(
        {
            "results": results,
            "facts": found,
            "workers": len(others),
            "versions": {"python": platform.python_version(), "numpy": np.__version__}
            | {"numba": numba.__version__, "pyarrow": pa.__version__},
        },
        sys.stdout,
    )


def prepare(spec: dict[str, object]) -> None:
    """Set the sizes of blocks."""
    rollout.LANES = spec.get("lanes", rollout.LANES)
    unroll.BLOCK = spec.get("chunk", unroll.BLOCK)


def start() -> None:
    """What a worker does before all else."""
    prepare(json.loads(os.environ["SAME_BITS_SPEC"]))
    note = Path(os.environ["SAME_BITS_NOTES"], str(os.getpid()))
    note.write_text(json.dumps(facts()))
    note.rename(note.with_suffix(".json"))  # which the parent reads only when it is whole


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
