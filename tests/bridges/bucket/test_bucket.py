"""Readers of other libraries read the same bits from a bucket, as the page of scale shows."""

import subprocess
import sys

import boto3
import numpy as np
from helpers import ROOT
from helpers.pages import blocks

import ibdata

KEPT = """
import numpy as np
rows = {"polars": by_polars, "duckdb": by_duckdb, "ray": by_ray}
np.savez("read.npz", **{name: np.asarray(found["reward"]) for name, found in rows.items()})
"""


def test_the_snippet_of_the_page_reads_a_bucket(bucket, monkeypatch):
    """The server here answers without TLS, which polars must be told."""
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    boto3.client("s3").create_bucket(Bucket="my-bucket")
    made = ibdata.generate("safe", "s3://my-bucket/safe", overrides=["output.shard_rows=2000"])
    page = (ROOT / "docs/scale.md").read_text().partition("## Reading from a bucket")[2]
    subprocess.run([sys.executable, "-c", blocks(page, "python")[0] + KEPT], check=True, timeout=300)
    expected = np.sort(made.table(["reward"])["reward"].to_numpy()).tobytes()
    found = np.load("read.npz")
    assert len(found.files) == 3
    for reader in found.files:
        assert np.sort(found[reader]).tobytes() == expected, reader
