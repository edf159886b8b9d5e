"""A server of S3, and an empty bucket."""

from helpers.buckets import bucket, server  # noqa: F401
