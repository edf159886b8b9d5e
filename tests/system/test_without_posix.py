"""Reading, evaluation and environments do without what only POSIX has, as on Windows."""

import inspect
import json

from helpers import python

# What Python has not on Windows, of what might be used.
OS = """
O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK chown fchmod fchown fork fstatvfs geteuid getuid killpg mkfifo
posix_fallocate pread sched_getaffinity setsid statvfs sysconf uname
"""
SIGNAL = "SIGALRM SIGHUP SIGKILL SIG_BLOCK SIG_SETMASK SIG_UNBLOCK alarm pthread_sigmask"
MODULES = ("fcntl", "grp", "pwd", "resource", "termios")


def everything(path):
    """What reading and simulating gives, as text."""
    import numpy as np

    import ibdata
    from ibdata.environment.settings import settings
    from ibdata.environment.simulation import Simulation
    from ibdata.published import IDS

    def draw(which, purpose, step, steps, slots):
        return np.full((1, slots, len(which)), 2**62, np.uint64)

    dataset = ibdata.open(path)
    lanes, simulation = np.arange(2), Simulation(settings(setpoint=70), 2)
    simulation.reset(lanes, draw)
    published = IDS(p=70, inital_seed=1)
    published.step(np.array([0.5, -0.5, 0.1]))
    parts = [
        dataset.content_root,
        dataset.to_pandas().to_csv(),
        *dataset.arrays(history=3).values(),
        dataset.select(setpoint=70).episodes,
        dataset.windows(history=2).batch([0, 5]),
        ibdata.validate(path),
        ibdata.evaluate(["safe"], episodes=2, steps=50).results,
        simulation.step(lanes, np.ones((2, 3), np.float32), draw).tolist(),
        sorted(published.state.items()),
    ]
    return [repr(part) for part in parts]


WITHOUT = f"""
import json, os, signal, sys
import click, numba, pandas, pyarrow.parquet, pydantic, ruamel.yaml, tqdm  # each has its own way on Windows
for module, names in (os, {OS.split()}), (signal, {SIGNAL.split()}):
    for name in names:
        delattr(module, name)
sys.modules.update(dict.fromkeys({MODULES}))
{inspect.getsource(everything)}
print(json.dumps(everything(sys.argv[1])))
from ibdata.cli import main
main(["info", sys.argv[1]])
"""


def test_reading_and_simulating_need_no_posix(dataset):
    done = python("-c", WITHOUT, dataset.path)
    assert done.returncode == 0, done.stderr
    found, _, told = done.stdout.partition("\n")
    assert json.loads(found) == everything(dataset.path)
    assert dataset.content_root in told
