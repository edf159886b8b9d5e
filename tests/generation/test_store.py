"""Making a dataset at a URL: each shard goes to the hidden part, and the manifest to the place last.

scripts/bridges does this with a server of S3 and with processes that are killed.
"""

import os
import random
import shutil
import signal
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from helpers import FULL
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.datasets import four_shards_at
from helpers.folders import contents
from helpers.fork_server import whole
from helpers.refusals import refused

import ibdata
from ibdata._system import runs
from ibdata._system.storage import Remote
from ibdata.cli import main
from ibdata.dataset import manifest
from ibdata.errors import BusyError, DatasetError, IbdataError, Interrupted, UsageError
from ibdata.generation import generate as generation
from ibdata.generation import store, workers
from ibdata.generation.build import Build
from ibdata.generation.place import place_at

METHODS = ("put", "copy_from", "remove", "size", "sizes", "names", "read")


class Lost(OSError):
    """The store, or the host, is lost."""


def interrupted(monkeypatch, at, methods=METHODS, before=True):
    """Let the k-th request, or its answer, be lost; return a list that gets an entry for each request."""
    done, lock = [], threading.Lock()

    def counting(name, method):
        def call(self, *args):
            with lock:
                done.append(name)
                number = len(done)
            if number == at and before:
                raise Lost("connection lost")
            answer = method(self, *args)
            if number == at:
                raise Lost("connection lost")
            return answer

        return call

    for name in methods:
        monkeypatch.setattr(Remote, name, counting(name, getattr(Remote, name)))
    return done


def interrupt():
    raise Lost("connection lost")


@pytest.fixture(autouse=True)
def _objects_are_whole(monkeypatch, tmp_path_factory):
    """As in a store: a file that is being written is not there."""
    objects = str(tmp_path_factory.mktemp("objects"))
    for name in ("put", "copy_from"):
        monkeypatch.setattr(Remote, name, whole(getattr(Remote, name), objects))


def outcome(url):
    try:
        four_shards_at(url)
    except IbdataError as error:
        return str(error)


@pytest.fixture
def is_whole(tiny, files):
    """Whether the dataset at the URL has the files of one in a folder, and nothing is beside it."""
    return lambda: files("there") == files(tiny[0].path) and not files(".there.part")


def test_the_files_of_a_folder_are_there_the_manifest_last(url, tiny, is_whole, monkeypatch, capsys):
    """Until all other files are there, nobody takes the place for a dataset."""
    seen, put = [], Remote.put

    def noting(self, source, path, size):
        put(self, source, path, size)
        seen.append((self.url == url, path, Path("there", manifest.PATH).exists()))

    with monkeypatch.context() as patched:
        patched.setattr(Remote, "put", noting)
        dataset = four_shards_at(url)
    assert is_whole()
    assert [path for at_place, path, _ in seen if at_place][-1] == manifest.PATH
    assert [path for _, path, is_there in seen if is_there] == [manifest.PATH]
    assert dataset.table().equals(tiny[0].table())
    assert (dataset.place, dataset.content_root) == (url, tiny[0].content_root)
    assert capsys.readouterr().err == ""
    assert four_shards_at(url).manifest == dataset.manifest
    assert capsys.readouterr().err == f"ibdata: {url}: already there; nothing was written\n"


def test_no_name_is_left_for_a_file_that_waits(url, monkeypatch):
    """A process that is killed leaves nothing on its disk."""
    seen, put, folder = [], Remote.put, Path("temporary").absolute()
    folder.mkdir()

    def looking(self, *args):
        seen.append([path.name for path in folder.iterdir()])
        put(self, *args)

    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setattr(Remote, "put", looking)
    four_shards_at(url)
    assert len(seen) > 10
    assert not any(seen)


def test_a_lost_request_is_one_line_and_the_same_command_goes_on(url, is_whole, monkeypatch, tiny, files):
    """Each request in turn, before it and after it was done. A glob over the place meets no row twice."""
    with monkeypatch.context() as patched:
        done = interrupted(patched, None)
        four_shards_at(url)
        count = len(done)
    assert count > 40
    for at in range(1, count + 1, 3 if FULL else 10):
        for before in (True, False):
            shutil.rmtree("there", ignore_errors=True)
            with monkeypatch.context() as broken:
                interrupted(broken, at, before=before)
                said = outcome(url)
            assert said is None or (said.startswith(url) and "connection lost" in said), said
            shards = list(Path("there/data").glob("*"))
            assert len({path.name[:10] for path in shards}) == len(shards)
            four_shards_at(url)
            assert is_whole(), (at, before)


@pytest.mark.parametrize(
    ("is_lost", "words"), [(True, "connection lost"), (False, "found 0 bytes after [0-9]+ were written")]
)
def test_a_part_of_an_object_does_not_count(url, is_whole, monkeypatch, is_lost, words):
    """pyarrow completes an upload that failed."""
    put = Remote.put

    def cutting(self, source, path, size):
        if path.endswith(".parquet"):
            data = source.read()
            with self._in_folder(self._files.open_output_stream, f"{self._base}/{path}") as stream:
                stream.write(data[:-7])
            if is_lost:
                raise Lost("connection lost")
            source.seek(size)
        put(self, source, path, size)

    with monkeypatch.context() as patched:
        patched.setattr(Remote, "put", cutting)
        line = f"there: cannot be written: .*{words}; the same command goes"
        refused(line, four_shards_at, url, error=IbdataError)
    four_shards_at(url)
    assert is_whole()


def test_a_store_that_shows_an_object_late_gives_no_wrong_row(url, is_whole, monkeypatch):
    """One of twenty answers does not know of what is there. The same command goes on."""
    generator, size, sizes, names = random.Random(1), Remote.size, Remote.sizes, Remote.names

    def some(found):
        return [each for each in found if generator.random() > 0.05]

    with monkeypatch.context() as late:
        late.setattr(Remote, "size", lambda self, path: (some([size(self, path)]) or [None])[0])
        late.setattr(Remote, "sizes", lambda self: {path: sizes(self)[path] for path in some(sizes(self))})
        late.setattr(Remote, "names", lambda self, folder: some(names(self, folder)))
        said = [outcome(url) for _ in range(10)]
    assert any(said)
    four_shards_at(url)
    assert is_whole()


def test_ranges_of_several_hosts_make_one_dataset(url, tiny, is_whole, capsys):
    """At the same time, some twice; then one completes it, or two at once. Nothing is left to remove."""
    with ThreadPoolExecutor(3) as hosts:
        ranges = ("1/2", "2/2", "1/1")
        made = list(hosts.map(lambda each: ibdata.generate(TINY, url, workers=1, shards=each), ranges))
    assert {each.missing for each in made} >= {0}
    with pytest.raises(
        DatasetError, match=r"there: no finished .*; an unfinished run has 4 of 4 shards here"
    ):
        ibdata.open(url)
    with ThreadPoolExecutor(2) as hosts:
        roots = {dataset.content_root for dataset in hosts.map(ibdata.finalize, [url, url])}
    assert roots == {tiny[0].content_root}
    assert is_whole()
    assert "remove" not in capsys.readouterr().err


def test_another_experiment_is_refused_as_in_a_folder(url, capsys):
    """A run that has made no shard is in nobody's way."""
    other = TINY.model_copy(update={"seed": 1})
    ibdata.generate(TINY, url, workers=1, shards="1/4")
    with pytest.raises(UsageError) as error:
        ibdata.generate(other, url, workers=1)
    (run,) = Path(".there.part").iterdir()
    place = f"{url.replace('/there', '/.there.part')}/{run.name}"
    assert str(error.value) == (
        f"{url}: holds an unfinished run of another experiment (seed: found 0, expected 1), 1 of 4 shards; "
        f"remove {place} to drop it, or choose another out"
    )
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["ls", url.removesuffix("/there")])
    assert f"{place}  " in capsys.readouterr().out
    shutil.rmtree(run / "receipts")
    ibdata.generate(other, url, workers=1)
    refused(rf"there: holds the dataset of another .*; remove {url} to drop it", four_shards_at, url)


@pytest.mark.parametrize("moment", ["before", "after"])
def test_of_two_experiments_that_are_published_at_once_one_waits(url, is_whole, monkeypatch, moment):
    """Which looks for others before its mark is there, or after."""
    publishing, other = store.Store._publishing, TINY.model_copy(update={"seed": 1})

    def meeting(place):
        monkeypatch.setattr(store.Store, "_publishing", publishing)
        found = publishing(place) if moment == "before" else None
        with monkeypatch.context() as patched:
            patched.setattr(Build, "_other_run", lambda build: None)  # it has begun before there were shards
            with pytest.raises(BusyError, match=r"there: another run is being published here, or was until"):
                ibdata.generate(other, url, workers=1)
        return publishing(place) if found is None else found

    gather = store.Store.gather

    def gathering(*args):
        monkeypatch.setattr(store.Store, "gather", gather)
        monkeypatch.setattr(store.Store, "_publishing", meeting)
        gather(*args)

    monkeypatch.setattr(store.Store, "gather", gathering)
    four_shards_at(url)
    assert Path("there", manifest.PATH).exists()
    refused("the dataset of another experiment", ibdata.generate, other, url, workers=1)
    shutil.rmtree(".there.part")
    assert is_whole()


@pytest.mark.parametrize(
    ("where", "name", "shards"), [(Build, "_gather", None), (generation, "_make_shards", "1/2")]
)
def test_a_run_that_another_host_has_finished_is_finished(url, is_whole, monkeypatch, where, name, shards):
    """While this host published it, or made its part."""
    real = getattr(where, name)

    def late(*args):
        monkeypatch.setattr(where, name, real)
        four_shards_at(url)
        real(*args)

    monkeypatch.setattr(where, name, late)
    made = ibdata.generate(TINY, url, workers=1, **({"shards": shards} if shards else {}))
    assert made.missing == 0 if shards else len(made) == 20
    assert is_whole()


def test_a_run_that_ends_while_somebody_looks_is_a_dataset(url, is_whole, monkeypatch):
    """Its shards were there at the first look, and its mark is gone at the next."""
    publishing = store.Store._publishing

    def ending(place):
        monkeypatch.setattr(store.Store, "_publishing", publishing)
        four_shards_at(url)
        return publishing(place)

    with monkeypatch.context() as patched:
        patched.setattr(store.Store, "appear", lambda *args: interrupt())
        refused("connection lost", four_shards_at, url, error=IbdataError)
    monkeypatch.setattr(store.Store, "_publishing", ending)
    place = place_at(url)
    place.found()
    assert place.size_of(manifest.PATH)
    assert is_whole()


@pytest.mark.parametrize("shards", [None, "1/2"])
@pytest.mark.parametrize("place", ["folder", "there"])
def test_a_host_that_comes_last_finds_the_dataset(url, place, shards, monkeypatch, capsys):
    """Another host has published it after this one looked."""
    out = url.replace("there", place) if place == "there" else place
    real = Build.look

    def looking(build, **options):
        found = real(build, **options)
        monkeypatch.setattr(Build, "look", real)
        four_shards_at(out)
        return found

    monkeypatch.setattr(Build, "look", looking)
    made = ibdata.generate(TINY, out, workers=1, **({"shards": shards} if shards else {}))
    assert made.missing == 0 if shards else len(made) == 20
    assert ibdata.validate(out) == []


def test_an_object_of_a_session_leaves_no_run(url):
    """Nobody could go on with it."""

    class Failing:
        def predict(self, observations):
            if len(list(Path(".there.part").glob("*/receipts/*"))) > 1:
                raise KeyboardInterrupt
            return observations[:, 1:4] * 0.0

    experiment = {**TINY.plain(), "policies": [Failing()], "splits": {}}
    with pytest.raises(KeyboardInterrupt):
        ibdata.generate(experiment, url, workers=1)
    assert not contents(".")
    assert len(four_shards_at(url)) == 20


def test_what_is_no_name_of_a_place_is_refused(url):
    """Another reader of the URL may take it for another place."""
    for name in ("fr#x", "z/..", "z/../x"):
        with pytest.raises(
            UsageError, match=r"found #, \. or \.\. in the URL, expected the path without them"
        ):
            four_shards_at(f"{url}/{name}")
    four_shards_at(f"{url}%2Fq", shards="1/2")
    assert ibdata.generate(TINY, f"{url}%2Fq", workers=2).content_root


def test_other_files_are_named_and_left_alone(url, monkeypatch, is_whole):
    """Also those that come while the dataset is published; stale shards of a run that is lost go."""
    Path("there").mkdir()
    Path("there/notes.txt").write_text("mine")
    refused("there: not a dataset of ibdata, left as it is; move it away", four_shards_at, url)
    Path("there/notes.txt").unlink()
    gather = store.Store.gather

    def meeting(*args):
        Path("there/data").mkdir(parents=True)
        Path("there/data/part-00000-0123456789abcdef.parquet").write_text("stale")
        Path("there/notes.txt").write_text("mine")
        gather(*args)

    with monkeypatch.context() as patched:
        patched.setattr(store.Store, "gather", meeting)
        refused(r"there/notes.txt: found a file that is not the dataset's; move", four_shards_at, url)
    assert Path("there/notes.txt").read_text() == "mine"
    Path("there/notes.txt").unlink()
    four_shards_at(url)
    assert is_whole()


def test_a_signal_stops_between_two_shards(url, monkeypatch, is_whole):
    add, made = runs.StoreRun.add, []

    def stopping(*args):
        made.append(1)
        if len(made) == 3:
            os.kill(os.getpid(), signal.SIGTERM)
        return add(*args)

    with monkeypatch.context() as patched:
        patched.setattr(runs.StoreRun, "add", stopping)
        patched.setattr(workers, "MOST_THREADS", 1)
        with pytest.raises(Interrupted, match=r"; 2 shards are finished; the same command goes on$"):
            four_shards_at(url)
    four_shards_at(url)
    assert is_whole()


def test_a_run_is_removed_though_that_was_cut_short(url, is_whole, monkeypatch):
    """A store removes many objects in any order. While something is left, the note says whose it is."""

    def cut(self, path=""):
        (self.folder / "run.json").unlink(missing_ok=True)
        raise Lost("connection lost")

    with monkeypatch.context() as patched:
        patched.setattr(Remote, "remove", cut)
        four_shards_at(url)
    assert Path(".there.part").exists()
    four_shards_at(url)
    assert is_whole()


def test_a_signal_does_not_stop_what_is_published(url, is_whole, monkeypatch):
    remove = runs.StoreRun.remove

    def stopping(run):
        os.kill(os.getpid(), signal.SIGTERM)
        remove(run)

    monkeypatch.setattr(runs.StoreRun, "remove", stopping)
    four_shards_at(url)
    assert is_whole()


def test_what_a_url_cannot_do_is_refused(url, tmp_path):
    """An object store cannot exchange two folders; and a URL may name a folder of this machine."""
    four_shards_at(url)
    before = contents()
    with pytest.raises(UsageError, match=f"^{url}: overwrite=True is for folders; remove what is there, or"):
        ibdata.generate(TINY, url, workers=1, seed=1, overwrite=True)
    refused("lies within the dataset", four_shards_at, f"file://{tmp_path}/there/data/in")
    Path("there/meta/statistics.json").write_text("{}")
    problem = f"{url}/meta/statistics.json: missing or not whole, but the dataset is finished"
    refused(f"^{problem}; remove {url} to make it again$", four_shards_at, url, error=DatasetError)
    assert contents().keys() == before.keys()
